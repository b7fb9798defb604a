"""What the next motion is to tell: which models apart, which effect at all, or simply the arm's inertias."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np

from ident.arrays import Array
from ident.effects.base import Effect
from ident.effects.catalogue import CATALOGUE
from ident.effects.effect_info import family_for
from ident.errors import InputError
from ident.robot.arm import ArmModel
from ident.safe_read import read_json, require_finite
from plan.experiment.distance import PredictedDesign
from plan.experiment.indistinguishable import widen
from plan.experiment.sizes import Told

Aim = Literal["separate", "show", "identify"]
SCHEMA = "ident.diagnosis/1"
# Of a large class, the nearest are asked for: each pair costs time.
MOST_EFFECTS = 4


@dataclass(frozen=True, eq=False)
class Question:
    """A question to the arm.

    Attributes:
        aim: `separate` effects from each other, `show` effects, or `identify` the base parameters.
        effects: Effects and their joints (0 for one of the whole arm).
        joint: The joint that moves most.
        told: What a diagnosis knows of their sizes, by effect.
        noise: Noise of each joint [N m], or None.
        tellable: Of the pairs (true, rival) those that motion can tell; None for all.
    """

    aim: Aim
    effects: tuple[tuple[Effect, int], ...]
    joint: int
    told: Mapping[str, Told] = field(default_factory=dict)
    noise: Array | None = None
    tellable: tuple[tuple[str, str], ...] | None = None

    @property
    def ids(self) -> tuple[str, ...]:
        return tuple(effect.id for effect, _ in self.effects)

    @property
    def family(self) -> str:
        """The kind of motion that is known to answer such questions."""
        return family_for(self.ids, self.asked) if self.ids else "wide"

    @property
    def asked(self) -> tuple[Effect, ...]:
        """The effects without their joints."""
        return tuple(effect for effect, _ in self.effects)

    def distances(self, view: PredictedDesign) -> dict[tuple[str, str], float]:
        """All that must be large [nats]: nothing where the base parameters are asked for."""
        if self.aim == "identify":
            return {}
        return view.between() if self.aim == "separate" else view.visible()

    def counted(self, distances: Mapping[tuple[str, str], float]) -> list[float]:
        """Those distances that motion can make large; all where it can make none large [nats]."""
        return [value for pair, value in distances.items() if not self.tellable or pair in self.tellable]

    def score(self, view: PredictedDesign) -> float:
        """What the search makes large: the smallest distance; the information on a single model's parameters."""
        if len(self.effects) < 2:
            return view.information()
        found = self.counted(self.distances(view))
        # Where one effect is nearly contained in another, the rest still decides between motions.
        return min(found) + 1e-3 * float(np.mean(found))


def ask(
    arm: ArmModel,
    separate: str | None,
    joint: str | None,
    diagnosis: Mapping[str, Any] | str | Path | None,
    catalogue: Sequence[Effect] = CATALOGUE,
) -> Question:
    """The question that options ask.

    Args:
        arm: The arm.
        separate: Effects' ids, with commas.
        joint: Name or number from 1.
        diagnosis: JSON file of `ident diagnose`, or its record.
        catalogue: The effects that may be asked for.

    Raises:
        InputError: Unknown effect or joint, or a file that is no diagnosis of this arm.
    """
    record = {} if diagnosis is None else _read(diagnosis, arm)
    try:
        return _ask(arm, separate, joint, record, catalogue)
    except (AttributeError, IndexError, KeyError, TypeError, ValueError) as error:
        if diagnosis is None:
            raise
        path = Path(diagnosis) if isinstance(diagnosis, str | Path) else Path("diagnosis")
        what = f"it is damaged ({type(error).__name__}: {error})"
        raise InputError(path, what, "write it anew with `ident diagnose … --json`") from None


def _ask(
    arm: ArmModel, separate: str | None, joint: str | None, record: Mapping[str, Any], catalogue: Sequence[Effect]
) -> Question:
    ids = [name.strip() for name in (separate or "").split(",") if name.strip()]
    names: list[str] = []
    aim: Aim = "separate" if len(ids) > 1 else "show"
    if not ids and record:
        ids, names, aim = _open_question(record, catalogue)
    effects = widen(list(dict.fromkeys(ids))[:MOST_EFFECTS], catalogue)
    at = _joint(arm, joint or (names[0] if names else _told_joint(record, ids)))
    placed = tuple((effect, at if effect.scope == "joint" else 0) for effect in effects)
    return Question(aim if ids else "identify", placed, at, _told(record), _noise(record, arm))


def _read(diagnosis: Mapping[str, Any] | str | Path, arm: ArmModel) -> dict[str, Any]:
    path = Path(diagnosis) if isinstance(diagnosis, str | Path) else Path("diagnosis")
    remedy = "give the file of `ident diagnose --json`"
    record = read_json(path, remedy) if isinstance(diagnosis, str | Path) else dict(diagnosis)
    if record.get("schema") != SCHEMA:
        raise InputError(path, f"is no {SCHEMA}", remedy)
    robot = record.get("robot", arm.name)
    if robot != arm.name:
        raise InputError(path, f"it is of {robot!r}, the robot is {arm.name!r}", "give --robot as for `ident diagnose`")
    named = record.get("joints")
    if not isinstance(named, list) or not named:
        raise InputError(path, f"its joints are {named!r}, not a list of names", remedy)
    unknown = [name for name in named if name not in arm.joint_names]
    if unknown:
        raise InputError(path, f"it speaks of {unknown[0]}, which {arm.name} lacks", "give the robot that it is of")
    return record


def _open_question(record: Mapping[str, Any], catalogue: Sequence[Effect]) -> tuple[list[str], list[str], Aim]:
    """The first tied class; else the effects that one kind of motion would show."""
    known = {effect.id: effect.shown_by for effect in catalogue}
    for finding in record["findings"]:
        tied = [name for name in finding["class"] if name in known]
        if len(tied) > 1:
            return tied, list(finding["joints"]), "separate"
    unseen = [one for one in record["not_testable"] if one["effect"] in known]
    if not unseen:
        return [], [], "identify"
    family = Counter(known[one] for one in {one["effect"]: 0 for one in unseen}).most_common(1)[0][0]
    wanted = [one for one in unseen if known[one["effect"]] == family]
    joint = Counter(name for one in wanted for name in one["joints"]).most_common(1)[0][0]
    return list(dict.fromkeys(one["effect"] for one in wanted)), [joint], "show"


def _told_joint(record: Mapping[str, Any], ids: Sequence[str]) -> str | None:
    """The joint at which a diagnosis found one of the effects."""
    for finding in record.get("findings", []):
        if set(ids) & set(finding["class"]):
            return str(finding["joints"][0])
    return None


def _joint(arm: ArmModel, name: str | None) -> int:
    """Its index; of the joint that carries most, where none is named."""
    if name is None:
        poses = np.random.default_rng(0).uniform(-1.0, 1.0, (64, arm.n))
        return int(np.argmax(np.std(arm.gravity(poses), axis=0)))
    if name in arm.joint_names:
        return arm.joint_names.index(name)
    if name.isdecimal() and 1 <= int(name) <= arm.n:
        return int(name) - 1
    raise InputError("--joint", f"no joint {name!r}", f"choose from: {', '.join(arm.joint_names)}")


def _told(record: Mapping[str, Any]) -> dict[str, dict[str, float]]:
    return {
        finding["effect"]: {
            name: require_finite(figure["value"], name) for name, figure in finding["parameters"].items()
        }
        for finding in record.get("findings", [])
    }


def _noise(record: Mapping[str, Any], arm: ArmModel) -> Array | None:
    gap = record.get("gap") or {}
    if any(name not in gap for name in arm.joint_names):
        return None
    floors = [require_finite(gap[name]["noise_floor_Nm"], f"noise floor of {name}") for name in arm.joint_names]
    if min(floors) < 0.0:
        raise ValueError("a noise floor is below zero")
    return np.array(floors)
