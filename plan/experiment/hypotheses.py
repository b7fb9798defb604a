"""What the next motion is to part.

Which models, which effect at all, or simply what the arm's inertias are.

Some effects are the same torque in every motion: only another set-up of the arm tells them apart. A
payload at the flange and a wrong last link are one body; torque readings that are all too large by
a share and masses that are all too large by it give the same log, since friction is fitted anyway.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np

from ident.arrays import Array, Float
from ident.effects.base import Effect, SessionContext, Variant
from ident.effects.catalogue import CATALOGUE, find_effect
from ident.effects.effect_info import KNOWN_MASS, family_for, setup_for
from ident.effects.sensing import TorqueGainError
from ident.errors import InputError
from ident.robot.arm import ArmModel
from ident.safe_read import read_json, require_finite
from plan.experiment.distance import PredictedDesign, Reported

# Motion that would take longer than this to tell two effects apart does not tell them apart [min].
LONGEST_MINUTES = 30.0
SCHEMA = "ident.diagnosis/1"
NO_DIAGNOSIS: dict[str, Any] = {"findings": [], "not_testable": [], "gap": {}}
REMEDY = "give the file of `ident diagnose --json`"
# What the mean of all distances counts beside the smallest.
REST_SHARE = 1e-3
# Positions at which joints' loads are compared.
POSITIONS = 64
# Of a large class, the nearest are asked for: each pair costs time.
MOST_EFFECTS = 4


class AllMasses(Effect):
    """Every link heavier by one share."""

    id = "all_masses"
    scope = "arm"
    rows = "all"
    inertia_like = True
    figures = ("share",)
    prior = (0.2,)
    summary = "all links are heavier or lighter by one share"
    set_ups: ClassVar[Mapping[str, str]] = {TorqueGainError.id: KNOWN_MASS}

    def columns(
        self, session: SessionContext, joint: int, variant: Variant
    ) -> list[Float[Array, "T ..."]]:
        return [run.rigid[:, :, None] for run in session.runs]


class AllGains(Effect):
    """Every joint's torque reads too high by one share; all else is as of the error of one gain."""

    id = TorqueGainError.id
    scope = "arm"
    rows = "all"
    summary = "all torque readings are too large or small by one share"

    def columns(
        self, session: SessionContext, joint: int, variant: Variant
    ) -> list[Float[Array, "T ..."]]:
        return [run.total[:, :, None] for run in session.runs]


def widen(ids: Sequence[str], catalogue: Sequence[Effect] = CATALOGUE) -> list[Effect]:
    """Effects by their ids.

    Beside `all_masses`, which no catalogue names, a gain error is one of all joints.
    """
    special: dict[str, Effect] = {}
    if AllMasses.id in ids:
        special = {effect.id: effect for effect in (AllMasses(), AllGains())}
    return [special.get(name) or find_effect(name, tuple(catalogue)) for name in ids]


Aim = Literal["separate", "show", "identify"]
"""`separate` effects from each other, `show` effects, or `identify` the base parameters."""

Status = Literal["ready", "one_sided", "needs_set_up"]
"""Whether motion can part all that is asked, one way of some pairs only, or nothing."""

Distances = Mapping[tuple[str, str], float]


@dataclass(frozen=True, eq=False)
class Hypotheses:
    """What is asked of the arm."""

    aim: Aim
    effects: tuple[tuple[Effect, int], ...]  # effects and their joints (0 for one of the whole arm)
    joint: int  # the joint that moves most
    # What a diagnosis knows of their sizes, by effect.
    reported: Mapping[str, Reported] = field(default_factory=dict)
    noise: Array | None = None  # noise of each joint [N m], or None
    # Of the pairs (true, rival) those that motion can part; None for all.
    testable: tuple[tuple[str, str], ...] | None = None

    @property
    def ids(self) -> tuple[str, ...]:
        """Ids of the effects, in their order."""
        return tuple(effect.id for effect, _ in self.effects)

    @property
    def status(self) -> Status:
        """What motion can do for the question."""
        if self.testable is None:
            return "ready"
        return "one_sided" if self.testable else "needs_set_up"

    @property
    def family(self) -> str:
        """The kind of motion that is known to answer such questions."""
        if not self.ids:
            return "fourier"
        return family_for(self.ids, [effect for effect, _ in self.effects])

    @property
    def set_up(self) -> str | None:
        """The change of set-up that parts the effects where motion can't, or hardly.

        None if none is known.
        """
        return setup_for(self.ids, [effect for effect, _ in self.effects])

    def distances(self, view: PredictedDesign) -> Distances:
        """All that must be large [nats]: nothing where the base parameters are asked for."""
        if self.aim == "identify":
            return {}
        return view.between() if self.aim == "separate" else view.visible()

    def counted(self, distances: Distances) -> list[float]:
        """Of the distances between effects those that motion can make large.

        Args:
            distances: By pair (true, rival) [nats].

        Returns:
            Their sizes [nats]; those of all pairs where `testable` names none.
        """
        if not self.testable:
            return list(distances.values())
        return [distance for pair, distance in distances.items() if pair in self.testable]

    def score(self, view: PredictedDesign) -> float:
        """What the search makes large.

        The smallest distance; the information on a single model's parameters.
        """
        if len(self.effects) < 2:
            return view.information()
        distances = self.counted(self.distances(view))
        # Where one effect is nearly contained in another, the rest still decides between motions.
        return min(distances) + REST_SHARE * float(np.mean(distances))


def ask(
    arm: ArmModel,
    separate: str | None,
    joint: str | None,
    diagnosis: Mapping[str, Any] | str | Path | None,
    catalogue: Sequence[Effect] = CATALOGUE,
) -> Hypotheses:
    """What options ask for.

    Args:
        arm: The arm.
        separate: Effects' ids, with commas.
        joint: Name or number from 1.
        diagnosis: JSON file of `ident diagnose`, or its record.
        catalogue: The effects that may be asked for.

    Raises:
        InputError: Unknown effect or joint, or a file that is no diagnosis of this arm.
    """
    ids = [name.strip() for name in (separate or "").split(",") if name.strip()]
    if diagnosis is None:
        return _ask(arm, ids, joint, NO_DIAGNOSIS, catalogue)
    where = Path(diagnosis) if isinstance(diagnosis, str | Path) else Path("diagnosis")
    record = dict(diagnosis) if isinstance(diagnosis, Mapping) else read_json(where, REMEDY)
    robot = record.get("robot", arm.name)
    joints = record.get("joints")
    if record.get("schema") != SCHEMA:
        raise InputError(where, f"is no {SCHEMA}", REMEDY)
    if robot != arm.name:
        what = f"it is of {robot!r}, the robot is {arm.name!r}"
        raise InputError(where, what, "give --robot as for `ident diagnose`")
    if not isinstance(joints, list) or not joints:
        raise InputError(where, f"its joints are {joints!r}, not a list of names", REMEDY)
    for name in joints:
        if name not in arm.joint_names:
            what = f"it speaks of {name}, which {arm.name} lacks"
            raise InputError(where, what, "give the robot that it is of")
    try:
        return _ask(arm, ids, joint, {**NO_DIAGNOSIS, **record}, catalogue)
    except (AttributeError, IndexError, KeyError, TypeError, ValueError) as error:
        what = f"it is damaged ({type(error).__name__}: {error})"
        raise InputError(where, what, "write it anew with `ident diagnose … --json`") from None


def _ask(
    arm: ArmModel,
    ids: list[str],
    joint: str | None,
    record: Mapping[str, Any],
    catalogue: Sequence[Effect],
) -> Hypotheses:
    aim: Aim = "separate" if len(ids) > 1 else "show"
    findings = record["findings"]
    places = [finding["joints"][0] for finding in findings if set(ids) & set(finding["class"])]
    if not ids:
        ids, places, aim = _open_question(record, catalogue)
    effects = widen(list(dict.fromkeys(ids))[:MOST_EFFECTS], catalogue)
    index = _joint(arm, joint or (str(places[0]) if places else None))
    reported: dict[str, Reported] = {}
    for finding in findings:
        figures = {}
        for name, figure in finding["parameters"].items():
            figures[name] = require_finite(figure["value"], name)
        reported[finding["effect"]] = figures
    return Hypotheses(
        aim=aim,
        effects=tuple((effect, index if effect.scope == "joint" else 0) for effect in effects),
        joint=index,
        reported=reported,
        noise=_noise_floors(arm, record["gap"] or {}),
    )


def _noise_floors(arm: ArmModel, gap: Mapping[str, Any]) -> Array | None:
    """Noise of each joint as a diagnosis found it [N m]; None where it does not say all.

    Raises:
        ValueError: One is no number, or below zero.
    """
    known = [name for name in arm.joint_names if name in gap]
    floors = [
        require_finite(gap[name]["noise_floor_Nm"], f"noise floor of {name}") for name in known
    ]
    if min(floors, default=0.0) < 0.0:
        raise ValueError("a noise floor is below zero")
    return np.array(floors) if len(floors) == arm.n else None


def _open_question(
    record: Mapping[str, Any], catalogue: Sequence[Effect]
) -> tuple[list[str], list[str], Aim]:
    """The first tied class and its joints.

    Else the effects that one kind of motion would show, and where most lack.
    """
    known = {effect.id: effect.shown_by for effect in catalogue}
    for finding in record["findings"]:
        tied = [name for name in finding["class"] if name in known]
        if len(tied) > 1:
            return tied, list(finding["joints"]), "separate"
    unseen = [entry for entry in record["not_testable"] if entry["effect"] in known]
    if not unseen:
        return [], [], "identify"
    effects = dict.fromkeys(entry["effect"] for entry in unseen)
    family = _most_common(known[effect] for effect in effects)
    wanted = [entry for entry in unseen if known[entry["effect"]] == family]
    joint = _most_common(chain.from_iterable(entry["joints"] for entry in wanted))
    return [effect for effect in effects if known[effect] == family], [joint], "show"


def _most_common(values: Iterable[str]) -> str:
    """The value that stands there most often; of several, that which came first."""
    return Counter(values).most_common(1)[0][0]


def _joint(arm: ArmModel, name: str | None) -> int:
    """Its index; of the joint that carries most, where none is named."""
    if name is None:
        poses = np.random.default_rng(0).uniform(-1.0, 1.0, (POSITIONS, arm.n))
        return int(np.argmax(np.std(arm.gravity(poses), axis=0)))
    if name in arm.joint_names:
        return arm.joint_names.index(name)
    if name.isdecimal() and 1 <= int(name) <= arm.n:
        return int(name) - 1
    raise InputError("--joint", f"no joint {name!r}", f"choose from: {', '.join(arm.joint_names)}")
