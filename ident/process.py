"""What a command owes its system: statuses, signals, and output that may fail without taking the
work along.
"""

from __future__ import annotations

import codecs
import errno
import gc
import importlib
import os
import re
import signal
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import FrameType
from typing import Any, NoReturn, Self, TextIO, cast

from ident.errors import InputError, visible
from ident.misuse import Misuse, misuse
from ident.own_settings import keep_own_settings

# Importable name -> extra of pyproject.toml. The core checks, fits without a net, diagnoses and
# writes pages.
EXTRA_OF = {
    **dict.fromkeys(("torch", "safetensors", "filterpy"), "net"),
    **dict.fromkeys(("mujoco", "example_robot_data", "llvmlite"), "sim"),
    "rerun": "view",
    **dict.fromkeys(("rosbags", "xacro", "yaml", "lz4", "backports"), "bags"),
    **dict.fromkeys(
        ("coal", "clarabel", "casadi", "cma", "daqp", "toppra", "plyfile", "pypcd4", "ruckig"),
        "plan",
    ),
    "tornado": "open",
    **dict.fromkeys(("onnx", "onnxruntime"), "onnx"),
    **dict.fromkeys(("pxr", "newton_usd_schemas"), "usd"),
    **dict.fromkeys(("joblib", "dask", "distributed", "pydantic", "typing_extensions"), "monitor"),
}
# Exit statuses; 0 is done, whatever the verdict, and 1 our own fault. The user's input is at fault:
# one line says what, and the remedy. `ident verify`: a limit is not kept. The system's own faults,
# a full disk or memory (sysexits.h: EX_IOERR). After a signal: this and its number.
USER = 2
NOT_PASSED = 3
SYSTEM = 74
SIGNALLED = 128
# What consoles without these characters show instead.
PLAIN = {
    "±": "+-",
    "→": "->",
    "…": "...",
    "τ": "tau",
    "·": "*",
    "×": "x",
    "²": "2",
    "–": "-",
    "—": "-",
    "°": "deg",
}
# What the system's loader says of a library that there is no room for.
UNMAPPED = ("map segment", "annot allocate memory")
# Names that no file can have are the user's fault, not the system's.
NO_NAME = (errno.ENAMETOOLONG, errno.ELOOP)
# As much of a name as a line shows [characters].
LONGEST_NAME = 200
# The name under which a file is written before it is whole, and the beginning of its own name in
# it.
TEMPORARY = re.compile(r"\.([^/]*)\.armgap-[0-9a-f]{8}-\d+-[0-9a-f]{8}\.part([^/]*)")
MEMORY_FULL = "memory is full; give fewer or shorter sessions, or a larger machine"


def missing_extra(error: BaseException | None) -> InputError | None:
    """What to tell the user where a package of an extra is not installed; None where something else
    is wrong.

    Args:
        error: What an import raised, or what was raised from that.
    """
    while error is not None:
        package = (
            (getattr(error, "name", None) or "").partition(".")[0]
            if isinstance(error, ImportError)
            else ""
        )
        if package in EXTRA_OF:
            remedy = f'pip install "armgap[{EXTRA_OF[package]}]", or armgap[all]'
            return InputError(package, "this package is not installed", remedy)
        error = error.__cause__ or error.__context__
    return None


PLAIN |= {"’": "'", "“": '"', "”": '"', "≤": "<=", "≥": ">=", "√": "sqrt", "µ": "u", "Δ": "d"}


def run_command(name: str, module: str) -> NoReturn:
    """Loads a command's module and runs its `app`; ends the process with one line wherever the user
    can do something.

    Args:
        name: The command's name, for its messages.
        module: Module with a typer application called `app`.
    """
    with _patient_streams(name) as streams, _Signals(name) as signals:
        if (
            not sys.warnoptions
        ):  # a library's warnings are for us: what concerns the user is told as an issue
            warnings.simplefilter("ignore")
        status = _run(name, module, signals)
        for stream in streams:
            stream.flush()
        for failed in (patient.failed for patient in streams if patient.failed is not None):
            if not isinstance(failed, BrokenPipeError):  # who closed a pipe has read enough
                with suppress(OSError, ValueError):
                    reason = failed.strerror or str(failed)
                    print(
                        f"{name}: the screen's output: {reason}; the results' files are written",
                        file=sys.stderr,
                    )
                status = status or SYSTEM
                break
    gc.freeze()  # else Python looks through all that is loaded once more before it ends: 0.3 s
    sys.exit(status)


def _run(name: str, module: str, signals: _Signals) -> int:
    def say(line: str) -> None:
        print(f"{name}: {visible(line)}", file=sys.stderr)

    try:
        keep_own_settings()  # the user may stand in a stranger's folder
        app = importlib.import_module(module).app
        signals.is_loading = False
        status = app(prog_name=name, standalone_mode=False)
    except InputError as error:
        say(str(error))
        return USER
    except OSError as error:
        file = os.fsdecode(error.filename) if isinstance(error.filename, (str, bytes)) else ""
        file = TEMPORARY.sub(r"\1\2", file)
        shown = file if len(file) <= LONGEST_NAME else file[:LONGEST_NAME] + "…"
        place = f"{shown}: " if file else ""
        what = f"{place}{error.strerror or error}"
        if error.errno in NO_NAME:
            say(f"{what}; give the name of a file or folder")
            return USER
        say(f"{what}; free what is full or broken, then run the command again")
        return SYSTEM
    except MemoryError:
        say(MEMORY_FULL)
        return SYSTEM
    except (Exception, KeyboardInterrupt) as error:
        # Interrupted, maybe within a library that made something else of it.
        if signals.came or type(error).__name__ in ("Abort", "KeyboardInterrupt"):
            status = signals.status
        elif type(error).__module__.startswith(("click", "typer")) and hasattr(
            error, "format_message"
        ):
            say(misuse(cast(Misuse, error), name))
            return USER
        elif isinstance(error, ImportError) and any(words in str(error) for words in UNMAPPED):
            say(MEMORY_FULL)
            return SYSTEM
        elif (missing := missing_extra(error)) is not None:
            say(str(missing))
            return USER
        else:
            raise
    if signals.came or status == SIGNALLED + signal.SIGINT:  # typer turns Ctrl-C into this status
        say("stopped")
        return signals.status
    return status if isinstance(status, int) else 0


class _Patient:
    """A stream whose failure does not end the work: results are worth more than the lines that
    speak of them.
    """

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self.failed: OSError | None = None

    def write(self, text: str) -> int:
        self._try(lambda: self._stream.write(text))
        return len(text)

    def flush(self) -> None:
        self._try(self._stream.flush)

    def _try(self, action: Callable[[], object]) -> None:
        if self.failed is not None:
            return
        try:
            action()
        except OSError as error:
            self.failed = error
            # What is left in the stream's buffer must not fail again when Python ends.
            with suppress(OSError, ValueError, AttributeError):
                nowhere = os.open(os.devnull, os.O_WRONLY)
                os.dup2(nowhere, self._stream.fileno())
                os.close(nowhere)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


@contextmanager
def _patient_streams(name: str) -> Iterator[tuple[_Patient, ...]]:
    codecs.register_error("armgap", _replace_unprintable)
    before: tuple[Any, Any] = sys.stdout, sys.stderr
    for stream in before:
        with suppress(AttributeError, OSError, ValueError):
            stream.reconfigure(errors="armgap")
    patient = []
    for stream in before:
        # A closed descriptor leaves no stream at all.
        target = open(os.devnull, "w") if stream is None else stream  # noqa: SIM115
        patient.append(_Patient(target))
    streams = tuple(patient)
    sys.stdout, sys.stderr = streams
    try:
        yield streams
    finally:
        sys.stdout, sys.stderr = before


def _replace_unprintable(error: UnicodeError) -> tuple[str, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    text = "".join(
        PLAIN.get(character) or visible(character)
        for character in error.object[error.start : error.end]
    )
    return text.encode("ascii", "backslashreplace").decode("ascii"), error.end


class _Signals:
    """What Ctrl-C and its like do: nothing but leave while modules are loaded, unwind once, leave
    at the second.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self.is_loading = True
        self.came = False
        self.status = SIGNALLED + signal.SIGINT
        self._before: dict[int, Any] = {}

    def __enter__(self) -> Self:
        for number in (signal.SIGINT, signal.SIGTERM, getattr(signal, "SIGHUP", signal.SIGTERM)):
            with suppress(
                ValueError, OSError
            ):  # not in the main thread: whoever runs us there has their own
                if (
                    signal.getsignal(number) != signal.SIG_IGN
                ):  # nohup and its like stay as they are
                    self._before.setdefault(number, signal.signal(number, self))
        return self

    def __exit__(self, *_error: object) -> None:
        for number, earlier in self._before.items():
            signal.signal(number, earlier)

    def __call__(self, number: int, frame: FrameType | None) -> None:
        self.status = SIGNALLED + number
        if self.is_loading or self.came:
            if not self.came:
                with suppress(OSError):
                    os.write(2, f"{self.name}: stopped\n".encode())
            os._exit(self.status)
        self.came = True
        raise KeyboardInterrupt
