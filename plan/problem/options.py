"""Options of planning, each once: the functions take them by name, and the commands and their help are made of them."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

DEFAULT_METHOD = "sqp"


def option(default: Any, text: str, *names: str, **bounds: float) -> Any:
    """A field with its help, its names on the command line if they are not its own, and bounds (`min`, `max`)."""
    return field(default=default, metadata={"help": text, "names": names, "bounds": bounds})


@dataclass(frozen=True)
class TaskOptions:
    """How a scene file is taken: what is best, what may be moved, which shapes and limits count."""

    objective: str = option("energy", "energy or time.")
    metric: str = option("absolute", "signed (the paper's), positive, absolute or copper.")
    variables: str | None = option(
        None, "What is searched: vias, times or both. Energy: vias; time: both, if not given."
    )
    vias: Path | None = option(None, "File of taught via points ([[trial]] tables) to start from.")  # noqa: RUF009
    trial: int = option(1, "Which of the taught motions, from 1.", min=1)
    shapes: str | None = option(
        None, "For links without <collision>: visual (their visual shapes), capsules or boxes (fitted)."
    )
    inside: bool = option(
        False, "Keep positions, speeds and accelerations where the model was fitted.", "--stay-inside"
    )
    reserve: bool = option(True, "Set torque aside for what the model's intervals leave open.")


@dataclass(frozen=True)
class SolveOptions(TaskOptions):
    """How one trajectory is looked for, and what may be spent on it."""

    method: str = option(DEFAULT_METHOD, "sqp, reference, cma, ppo, ga, brute, compress or toppra.")
    seed: int = option(0, "Seed of all randomness.", min=0)
    evaluations: int | None = option(None, "Most trajectories evaluated.", min=1)
    seconds: float | None = option(None, "Longest search, in processor time [s].", min=0.0)
    gap: bool = option(True, "Run the default method too and report the gap to it.")
    resume: Path | None = option(None, "Checkpoint file: written on the way, taken up if there.")  # noqa: RUF009
    workers: int = option(1, "Processes that share the starts.", min=1)


@dataclass(frozen=True)
class CompareOptions(TaskOptions):
    """Which methods are compared, and where."""

    methods: str | None = option(None, "Names, with commas; all that can do the task if not given.")
    seeds: int = option(5, "Number of seeds.", min=1)
    evaluations: int = option(2100, "Evaluations at which costs are compared.", min=1)
    seconds: float = option(1.0, "Time at which costs are compared [s].", min=0.0)
