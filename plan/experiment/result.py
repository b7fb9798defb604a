"""What `plan excite` answers: the motion, what it tells and how long it takes; `plan.excite/1`."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pyarrow as pa
import pyarrow.csv as pacsv

from ident.diagnosis.selection.settings import USUAL_SELECTION
from ident.files import atomic_folder
from ident.results import Result
from ident.trajectories.reference import TICK_S, ReferenceMotion
from plan.experiment.run_set import Programme, duration_of
from plan.geometry.arm_shapes import NO_SHAPES, ArmShapes
from plan.geometry.scene import Unchecked

SCHEMA = "plan.excite/1"
RECORD_NAME = "excite.json"
MOTION_KIND = "motion"
Status = Literal["ready", "one_sided", "needs_set_up"]
# Odds at which a class counts as decided.
ODDS = 20.0
LARGEST_ODDS = 1e9
# Of a millisecond's ticks one in this many is written: 250 Hz.
THINNING = 4

Distances = Mapping[tuple[str, str], float]


def odds_of(distance: float) -> float:
    """Odds of the right name against the wrong one that a distance lets expect: exp(T D)."""
    return float(min(np.exp(min(USUAL_SELECTION.temper * distance, 700.0)), LARGEST_ODDS))


def minutes_to_odds(distance: float, seconds: float) -> float | None:
    """Minutes until the odds are 20 : 1, at the rate of a motion of so many seconds; None if they never are."""
    if distance <= 1e-9:
        return None
    return float(np.log(ODDS) / (USUAL_SELECTION.temper * distance) * seconds / 60.0)


@dataclass(frozen=True, eq=False)
class Excitation(Result):
    """A motion that answers a question, or the set-up that must change first.

    Attributes:
        robot: Name of the arm.
        status: `ready`; `one_sided` where motion shows one effect if it is that, but the other only with another
            set-up; `needs_set_up` where no motion tells them apart.
        aim: `separate`, `show` or `identify`.
        effects: Their ids.
        joint: The joint that moves most.
        programme: Family and figures.
        runs: The runs.
        distances: Of the proposed motion [nats].
        tellable: The pairs (true, rival) that motion can tell; None for all.
        random: The same of random motion of equal length, the median of some.
        information: Gained on a single model's parameters by the proposed and by random motion [nats].
        noise: Of each joint [N m].
        sources: Where noise and sizes come from.
        clearance: Proven between the links [m]; None where no pair of them is looked at.
        set_up: Advice beside the motion, or None.
        evaluations, seconds, seed: Of the search.
        unchecked: Pairs of links of whose clearance nothing is said.
        shapes: Where the links' shapes come from.
        obstacles: Names of what stands around the arm.
        carried: What it carries, and the frame on which each of it hangs.
    """

    SHOWN_BY = "plan.show.results"

    robot: str
    status: Status
    aim: str
    effects: tuple[str, ...]
    joint: str
    programme: Programme
    runs: tuple[ReferenceMotion, ...]
    distances: Distances
    tellable: tuple[tuple[str, str], ...] | None
    random: Distances
    information: tuple[float, float]
    noise: Mapping[str, float]
    sources: Mapping[str, str]
    clearance: float | None
    set_up: str | None
    evaluations: int
    seconds: float
    seed: int
    unchecked: tuple[Unchecked, ...] = ()
    shapes: ArmShapes = NO_SHAPES
    obstacles: tuple[str, ...] = ()
    carried: tuple[dict[str, object], ...] = ()

    @property
    def duration(self) -> float:
        """Of all runs [s]."""
        return duration_of(list(self.runs))

    @property
    def smallest(self) -> tuple[float, float]:
        """Smallest distance that motion can tell, of the proposed motion and of random motion [nats]."""
        counted = [pair for pair in self.distances if not self.tellable or pair in self.tellable]
        if not counted:
            return self.information
        return min(self.distances[pair] for pair in counted), min(self.random[pair] for pair in counted)

    def to_dict(self) -> dict[str, Any]:
        proposed, by_chance = self.smallest
        told = self.distances if self.tellable is None else self.tellable
        return {
            "schema": SCHEMA,
            "robot": self.robot,
            "status": self.status,
            "aim": self.aim,
            "separates": list(self.effects),
            "joint": self.joint,
            "set_up": self.set_up,
            "told_by_motion": [f"{true} against {rival}" for true, rival in told],
            "motion": {
                "family": self.programme.family,
                "figures": dict(self.programme.figures),
                "home_rad": [float(value) for value in self.programme.home],
                "runs": len(self.runs),
                "minutes": self.duration / 60.0,
                "files": file_names(self.runs),
                "clearance_m": self.clearance,
            },
            "joints": list(self.noise),
            "obstacles": list(self.obstacles),
            "carried": list(self.carried),
            "unchecked_pairs": [pair.to_dict() for pair in self.unchecked],
            **self.shapes.to_dict(),
            "distance": {
                "proposed": _keyed(self.distances),
                "random": _keyed(self.random),
                "smallest": proposed,
                "smallest_random": by_chance,
            },
            "odds": odds_of(proposed),
            "odds_random": odds_of(by_chance),
            "minutes_to_20_to_1": minutes_to_odds(proposed, self.duration) if self.distances else None,
            "minutes_to_20_to_1_random": minutes_to_odds(by_chance, self.duration) if self.distances else None,
            "information_nats": {"proposed": self.information[0], "random": self.information[1]},
            "noise_Nm": dict(self.noise),
            "sources": dict(self.sources),
            "temper": USUAL_SELECTION.temper,
            "evaluations": self.evaluations,
            "seconds": self.seconds,
            "seed": self.seed,
            "provenance": self.provenance.to_dict(),
        }

    def write(self, folder: str | Path) -> None:
        """The runs as command files and `excite.json`, whole or not at all."""
        with atomic_folder(folder, MOTION_KIND) as part:
            for name, run in zip(file_names(self.runs), self.runs, strict=True):
                pacsv.write_csv(command_table(run, tuple(self.noise)), part / name)
            (part / RECORD_NAME).write_text(json.dumps(self.to_dict(), indent=1) + "\n", encoding="utf-8")


def _keyed(distances: Distances) -> dict[str, float]:
    return {f"{true} against {rival}": float(value) for (true, rival), value in distances.items()}


def file_names(runs: tuple[ReferenceMotion, ...]) -> list[str]:
    """One file a run, in order."""
    width = max(len(str(len(runs))), 2)
    return [f"{number:0{width}d}_{run.name}.csv" for number, run in enumerate(runs, start=1)]


def command_table(run: ReferenceMotion, joints: tuple[str, ...]) -> pa.Table:
    """Commands of a run at 250 Hz in native columns: positions [rad] and velocities [rad/s] from rest to rest."""
    q, dq = run.q[::THINNING], run.dq[::THINNING]
    columns = {"time": np.round(np.arange(len(q)) * THINNING * TICK_S, 6)}
    for j, name in enumerate(joints):
        columns[f"{name}/position_command"] = np.round(q[:, j], 8)
        columns[f"{name}/velocity_command"] = np.round(dq[:, j], 7)
    return pa.table(columns)
