"""Exit statuses of the commands; 0 is done, whatever the verdict, and 1 our own fault."""

from __future__ import annotations

# The user's input is at fault: one line says what, and the remedy.
USER = 2
# `ident verify`: a limit is not kept.
NOT_PASSED = 3
# The system's own faults, a full disk or memory (sysexits.h: EX_IOERR).
SYSTEM = 74
# After a signal: this and its number.
SIGNALLED = 128
