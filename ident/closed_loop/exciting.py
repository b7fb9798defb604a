"""What to record next: everyday motion first, then what the last diagnosis leaves open.

The motions are those of `ident.trajectories`, chosen by what each effect says of the motion that shows it. `plan
excite` works such a motion out at more expense; whoever has it gives it as another `Exciter`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np

from ident.effects.catalogue import CATALOGUE
from ident.effects.effect_info import family_for
from ident.robot.arm import ArmModel
from ident.trajectories.kinds import KINDS, plan_motions
from ident.trajectories.reference import ReferenceMotion

# Which of the planned kinds stands for a family of motions (see `ident.effects.effect_info`).
KIND_OF = {
    "ladder": "ladder",
    "slow": "ladder",
    "reversals": "sweep",
    "chirp": "chirp",
    "holds": "hold",
    "poses": "spline",
    "vias": "spline",
    "random": "spline",
    "wide": "fourier",
    "repeat": "fourier",
    "loaded": "fourier",
    "free": "spline",
    "jointwise": "jointwise",
}
# One path there and back at two speeds belongs to every round: a check that only sees what was chosen flatters.
ALWAYS = 4
# Rough duration of a run [s].
RUN_S = 8.0


class Exciter(Protocol):
    """Chooses motions."""

    def choose(self, record: Mapping[str, Any] | None, number: int) -> Sequence[ReferenceMotion]:
        """Motions of a round.

        Args:
            record: The last diagnosis (`ident.diagnosis/1`); None before the first.
            number: Of the round, from 1.
        """
        ...


class KindsExciter:
    """Kinds of planned motion, by what the last diagnosis leaves open; drawn from a seed."""

    def __init__(self, arm: ArmModel, seed: int) -> None:
        self.arm, self.seed = arm, seed

    def choose(self, record: Mapping[str, Any] | None, number: int) -> Sequence[ReferenceMotion]:
        """One run of each kind at first; then a path with its way back, and up to three kinds that are open."""
        rng = np.random.default_rng([self.seed, number])
        if record is None:
            return plan_motions(self.arm, (*tuple(KINDS)[1:], "spline"), len(KINDS) + 1, RUN_S, rng)
        kinds = open_kinds(record)
        wanted = plan_motions(self.arm, kinds, len(kinds), RUN_S, rng)
        return (*wanted, *plan_motions(self.arm, ("spline",), ALWAYS, RUN_S, rng))


def open_kinds(record: Mapping[str, Any], most: int = 3) -> tuple[str, ...]:
    """Kinds of motion that answer what a diagnosis leaves open, the most pressing first.

    Tied classes come first, then the identified effects, whose parameters more of the same motion sharpens, then what
    came nearest without being identified, then what could not be tested.
    """
    findings = record.get("findings", [])
    tied = [list(one["class"]) for one in findings if len(one["class"]) > 1]
    named = [[one["effect"]] for one in findings]
    nearest = record.get("nearest") or {}
    near = [[nearest["effect"]]] if nearest.get("effect") else []
    unseen = [[one["effect"]] for one in record.get("not_testable", [])]
    wanted = [KIND_OF[family_for(one, CATALOGUE)] for one in (*tied, *named, *near, *unseen)]
    found = [kind for kind in dict.fromkeys(wanted) if kind != "spline"]
    usual = [kind for kind in ("fourier", "chirp", "ladder") if kind not in found]
    return tuple((found + usual)[:most])
