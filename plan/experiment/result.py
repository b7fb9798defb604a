"""What `plan excite` answers: the motion, what it tells and how long it takes; `plan.excite/1`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from ident.files import atomic_folder
from ident.inference.calibration import load_calibration
from ident.records import as_json
from ident.results import Result
from ident.trajectories.files import write_commands
from ident.trajectories.reference import ReferenceMotion
from plan.experiment.hypotheses import Aim, Distances
from plan.experiment.run_set import RunSet, duration_of
from plan.geometry.scene import Scene

SCHEMA = "plan.excite/1"
RECORD_NAME = "excite.json"
MOTION_KIND = "motion"
Status = Literal["ready", "one_sided", "needs_set_up"]
# Odds at which a class counts as decided, and the largest that are believed.
ODDS = 20.0
LARGEST_ODDS = 1e9


def odds_of(distance: float) -> float:
    """Odds of the right name against the wrong one that a distance lets expect: exp(T D)."""
    return float(min(np.exp(min(load_calibration().temper * distance, 700.0)), LARGEST_ODDS))


def minutes_to_odds(distance: float, seconds: float) -> float | None:
    """Minutes until the odds are 20 : 1, at the rate of a motion of so many seconds.

    Args:
        distance: What the motion tells two effects apart by [nats].
        seconds: The motion's duration [s].

    Returns:
        None where the distance is nought: they never are.
    """
    if distance <= 1e-9:
        return None
    return float(np.log(ODDS) / (load_calibration().temper * distance) * seconds / 60.0)


@dataclass(frozen=True, eq=False)
class Excitation(Result):
    """A motion that answers a question, or the set-up that must change first."""

    SHOWN_BY = "plan.show.results"

    robot: str  # name of the arm
    # `ready`; `one_sided` where motion shows one effect if it is that, but the other only with
    # another set-up; `needs_set_up` where no motion tells them apart.
    status: Status
    aim: Aim  # `separate`, `show` or `identify`
    effects: tuple[str, ...]  # their ids
    joint: str  # the joint that moves most
    run_set: RunSet  # family and figures
    runs: tuple[ReferenceMotion, ...]
    distances: Distances  # of the proposed motion [nats]
    # The pairs (true, rival) that motion can part; None for all.
    testable: tuple[tuple[str, str], ...] | None
    random: Distances  # the same of random motion of equal length, the median of some
    # Gained on a single model's parameters by the proposed and by random motion [nats].
    information: tuple[float, float]
    # Of the textbook's Fourier series of as many runs: what it gains [nats], and the median ratio
    # of the proposal's intervals of the base parameters to its own; None where no such series fits
    # the arm.
    against_textbook: tuple[float, float] | None
    noise: Mapping[str, float]  # of each joint [N m]
    sources: Mapping[str, str]  # where noise and sizes come from
    clearance: float | None  # proven between the links [m]; None where no pair of them is looked at
    scene: Scene  # the arm's shapes and what stands around it
    # What it carries, and the frame on which each of it hangs.
    carried: tuple[dict[str, object], ...]
    set_up: str | None  # advice beside the motion, or None
    evaluations: int  # of the search
    seconds: float
    seed: int

    @property
    def duration(self) -> float:
        """Time that all runs take together [s]."""
        return duration_of(self.runs)

    @property
    def smallest(self) -> tuple[float, float]:
        """Smallest distance that motion can tell, of the proposed motion and of random motion
        [nats].
        """
        counted = [pair for pair in self.distances if not self.testable or pair in self.testable]
        if not counted:
            return self.information
        proposed = min(self.distances[pair] for pair in counted)
        by_chance = min(self.random[pair] for pair in counted)
        return proposed, by_chance

    @property
    def minutes(self) -> tuple[float | None, float | None]:
        """Minutes until the odds are 20 : 1, by the proposed motion and by random motion.

        None if they never are.
        """
        if not self.distances:
            return None, None
        proposed, by_chance = self.smallest
        return minutes_to_odds(proposed, self.duration), minutes_to_odds(by_chance, self.duration)

    @property
    def untold(self) -> dict[str, list[str]]:
        """Effects that motion does not tell from others, if they are there.

        Returns:
            By the effect's id, the ids of those others; without those that are told from all.
        """
        untold: dict[str, list[str]] = {}
        for true, rival in self.distances:
            if (true, rival) not in (self.testable or ()):
                untold.setdefault(true, []).append(rival)
        return untold

    @property
    def file_names(self) -> list[str]:
        """One file a run, in order."""
        width = max(len(str(len(self.runs))), 2)
        numbered = enumerate(self.runs, start=1)
        return [f"{number:0{width}d}_{run.name}.csv" for number, run in numbered]

    def to_dict(self) -> dict[str, Any]:
        (proposed, by_chance) = self.smallest
        (needed, needed_by_chance) = self.minutes
        reported = self.distances if self.testable is None else self.testable
        return {
            "schema": SCHEMA,
            "robot": self.robot,
            "status": self.status,
            "aim": self.aim,
            "separates": list(self.effects),
            "joint": self.joint,
            "set_up": self.set_up,
            "told_by_motion": [" against ".join(pair) for pair in reported],
            "motion": {
                "family": self.run_set.family,
                "figures": dict(self.run_set.figures),
                "home_rad": self.run_set.home.tolist(),
                "runs": len(self.runs),
                "minutes": self.duration / 60.0,
                "files": self.file_names,
                "clearance_m": self.clearance,
            },
            "joints": list(self.noise),
            "obstacles": [box.name for box in self.scene.obstacles],
            "carried": list(self.carried),
            **self.scene.to_dict(),
            "distance": {
                "proposed": {
                    " against ".join(pair): value for pair, value in self.distances.items()
                },
                "random": {" against ".join(pair): value for pair, value in self.random.items()},
                "smallest": proposed,
                "smallest_random": by_chance,
            },
            "odds": odds_of(proposed),
            "odds_random": odds_of(by_chance),
            "minutes_to_20_to_1": needed,
            "minutes_to_20_to_1_random": needed_by_chance,
            "information_nats": {
                "proposed": self.information[0],
                "random": self.information[1],
                "textbook": None if self.against_textbook is None else self.against_textbook[0],
            },
            "interval_against_textbook": None
            if self.against_textbook is None
            else self.against_textbook[1],
            "noise_Nm": dict(self.noise),
            "sources": dict(self.sources),
            "temper": load_calibration().temper,
            "evaluations": self.evaluations,
            "seconds": self.seconds,
            "seed": self.seed,
            "provenance": self.provenance.to_dict(),
        }

    def write(self, folder: str | Path) -> None:
        """The runs as command files at 250 Hz in native columns, and `excite.json`.

        Whole or not at all.
        """
        with atomic_folder(folder, MOTION_KIND) as partial:
            self.write_into(partial)

    def write_into(self, folder: Path) -> None:
        """Writes the runs' command files and the record into a folder that is there already.

        Unlike `write`, it leaves it to the caller that the folder is written whole or not at all.
        """
        write_commands(self.runs, list(self.noise), folder)
        (folder / RECORD_NAME).write_text(as_json(self.to_dict()) + "\n", encoding="utf-8")
