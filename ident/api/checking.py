"""The check on withheld effects: what `ident blind` does."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ident.benchmark.run import BlindOptions, Progress, Say, run_blind
from ident.benchmark.summary import BlindReport


def blind(
    cases: int = 40,
    *,
    out: str | Path = "out/blind",
    say: Say = lambda line: None,
    progress: Progress = lambda step, done, total: None,
    **options: Any,
) -> BlindReport:
    """Draws effects, simulates, seals, diagnoses from the recordings alone, opens, scores.

    Args:
        cases: Number of cases.
        out: Folder for everything; a check that was stopped there goes on.
        say: Told the seals, line by line, before any diagnosis.
        progress: Told what is being done, how many cases are done, and of how many.
        options: Further fields of `ident.benchmark.run.BlindOptions`: seed, workers, robot, runs, duration, …

    Raises:
        InputError: Options that make no sense, or another check in the folder.
    """
    return run_blind(BlindOptions.of("blind", {"cases": cases, "out": Path(out), **options}), say, progress)
