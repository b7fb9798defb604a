"""Options of planning, each once: the functions take them by name, and the commands and their help
are made of them.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ident.command_options import option

DEFAULT_METHOD = "sqp"
# What a search may spend unless it is given: trajectories evaluated and processor time [s]; brute
# force more.
USUAL_BUDGET = (200_000, 120.0)
BRUTE_BUDGET = (20_000_000, 3600.0)
# Generations of the genetic algorithm: in `plan solve`, and where the paper's experiments are
# repeated.
GENERATIONS = 200
PAPER_GENERATIONS = 2000


@dataclass(frozen=True)
class TaskOptions:
    """How a scene file is taken: what is best, what may be moved, which shapes and limits count."""

    objective: str = option("energy", "energy or time.")
    metric: str = option("absolute", "signed (the paper's), positive, absolute or copper.")
    variables: str | None = option(
        None, "What is searched: vias, times or both. Energy: vias; time: both, if not given."
    )
    shapes: str | None = option(
        None,
        "For links without <collision>: visual (their visual shapes), capsules or boxes (fitted).",
    )
    beyond: bool = option(
        False,
        "Leave what is known: the model's training range or, without a model, "
        "the maker's advised acceleration.",
    )
    inside: bool = option(
        False, "Refuse a start or goal beyond the model's training, too.", "--stay-inside"
    )
    reserve: bool = option(True, "Set torque aside for what the model's intervals leave open.")


@dataclass(frozen=True)
class SolveOptions(TaskOptions):
    """How one trajectory is looked for, and what may be spent on it."""

    method: str = option(DEFAULT_METHOD, "sqp, reference, cma, ppo, ga, brute, compress or toppra.")
    seed: int = option(0, "Seed of all randomness.", min=0)
    evaluations: int | None = option(None, "Most trajectories evaluated.", min=1)
    seconds: float | None = option(
        None, "Processor time that all may take, from the start to the certificate [s].", min=0.0
    )
    gap: bool = option(True, "Run the default method too and report the gap to it.")
    workers: int = option(
        1, "Processes that search at once, each from its own chance.", min=1, max=64
    )
    controller: str | None = option(
        None,
        "Who executes the plan: its curve is certified. tmscript, tm_ros2, ros2_control, "
        "ur_spline, ur_servoj or ur_servoj_cb3; by the ending of --out, if not given.",
    )

    @property
    def budget(self) -> tuple[int, float]:
        """Evaluations and processor time [s]: what is asked for, and of the rest its method's
        usual.
        """
        usual = BRUTE_BUDGET if self.method == "brute" else USUAL_BUDGET
        asked = self.evaluations, self.seconds
        return usual[0] if asked[0] is None else asked[0], usual[1] if asked[1] is None else asked[
            1
        ]


@dataclass(frozen=True)
class CompareOptions(TaskOptions):
    """Which methods are compared, and where."""

    methods: str | None = option(None, "Names, with commas; all that can do the task if not given.")
    seeds: int = option(5, "Number of seeds.", min=1)
    evaluations: int = option(2100, "Evaluations at which costs are compared.", min=1)
    seconds: float = option(1.0, "Time at which costs are compared [s].", min=0.0)


@dataclass(frozen=True)
class PaperOptions:
    """How much of the paper's experiments is run."""

    epochs: int = option(500, "PPO's epochs on Table 3's task (the paper's: 500).", min=1)
    generations: int = option(
        PAPER_GENERATIONS, "The genetic algorithm's on the obstacle task.", min=1
    )
    trials: int = option(5, "Trials of each tester and method.", min=1, max=5)
    levels: int = option(11, "Values of each variable in the brute force search.", min=2)


@dataclass(frozen=True)
class ExciteOptions:
    """What the next motion to record has to tell, its length, and where the arm stands."""

    separate: str | None = option(None, "Effects to tell apart, or one to show: ID,ID.")
    joint: str | None = option(None, "The joint in question: its name or number.")
    minutes: float | None = option(
        None,
        "Length of the motion, of four runs at the least; as long as odds of 20 : 1 take, "
        "if not given.",
        min=0.1,
        max=240,
    )
    evaluations: int = option(120, "Most motions that the search evaluates.", min=8)
    shapes: str | None = option(
        None,
        "For links without <collision>: visual (their visual shapes), capsules or boxes (fitted).",
    )
    scene: Path | None = option(
        None,
        "Scene file (TOML): obstacles, floor, what is carried, limits; its task is left aside.",
    )
    floor: str = option(
        "0", "Height of the floor above the base [m], or none; a scene's own floor counts instead."
    )
    top_speed: float | None = option(None, "Top speed of every joint that turns [deg/s].", min=1e-3)
    seed: int = option(0, "Seed of all randomness.", min=0)
