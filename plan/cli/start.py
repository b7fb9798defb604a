"""The entry of the `plan` command, as light as that of `ident`."""

from __future__ import annotations

from functools import partial

from ident.cli import start

main = partial(start.main, "plan")
