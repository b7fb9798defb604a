"""Tasks for the workers, importable by their processes."""

import os
import signal
import time
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Errand:
    """Writes the process's id to a file; the first process to take a deadly one dies of it."""

    file: Path
    deadly: bool = False
    seconds: float = 0.0


def run_errand(errand: Errand) -> str:
    mark = errand.file.with_suffix(".died")
    if errand.deadly and not mark.exists():
        mark.write_text(str(os.getpid()))
        os.kill(os.getpid(), signal.SIGKILL)
    time.sleep(errand.seconds)
    with errand.file.open("a") as stream:
        stream.write(f"{os.getpid()}\n")
    return errand.file.stem
