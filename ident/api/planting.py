"""Effects of one's own: whether a class keeps to the laws, and whether the diagnosis finds what is
planted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ident.api.diagnosing import diagnose
from ident.api.simulating import simulate
from ident.arrays import Array
from ident.diagnosis.result import Diagnosis
from ident.effects import check
from ident.effects.base import Effect, SessionContext
from ident.effects.catalogue import CATALOGUE
from ident.errors import InputError
from ident.recordings.recording import Session
from ident.regression.baseline import fit_baseline
from ident.regression.decimation import prepare_slower
from ident.regression.runs import build_session
from ident.robot.arm import ArmModel
from ident.robot.names import data_path
from ident.sessions import Given, Robot, Sources, inspect_sources

# Recordings of the shipped arm that move all joints over wide poses.
SHIPPED = "logs/tm5_900/E1"


@dataclass(frozen=True, eq=False)
class PlantedEffect:
    """An effect that was planted, and what became of it."""

    effect: str  # its id
    joint: str  # where; "" for an effect of the whole arm
    rms: float  # root mean square of its torque at the joint where it acts most [N m]
    session: Session  # the recordings with it
    diagnosis: Diagnosis  # what they were found to be

    @property
    def found(self) -> bool:
        """Whether a finding at its joint holds it in its class."""
        for finding in self.diagnosis.findings:
            here = not self.joint or self.joint in finding.joints
            if here and self.effect in finding.estimate.rivals:
                return True
        return False

    def __repr__(self) -> str:
        named = [
            f"{finding.effect} at {', '.join(finding.joints)}"
            for finding in self.diagnosis.findings
        ]
        names = ", ".join(named) or "nothing"
        where = f" at {self.joint}" if self.joint else ""
        outcome = "found" if self.found else "not found"
        return f"{self.effect}{where}, {self.rms:.2g} N m rms: {outcome} (named: {names})"


def check_effect(effect: Effect, source: Sources | None = None, robot: Robot = "tm5-900") -> None:
    """Tries the laws that every effect keeps to, in recordings.

        check_effect(Magnet())

    What is asked stands in `ident.effects.check`; every effect of the catalogue passes.

    Args:
        effect: The effect.
        source: Recordings that can show it; a shipped session of the shipped arm if None.
        robot: URDF path, name or arm.

    Raises:
        InputError: The effect breaks a law: which, and what to do.
    """
    _require_effect(effect)
    given = data_path(SHIPPED) if source is None else source
    session, arm = _read(given, robot)
    check.check_effect(effect, _as_effects_see(session, arm))


def plant(
    effect: Effect,
    joint: str | None = None,
    source: Sources | None = None,
    robot: Robot = "tm5-900",
    *,
    coefficients: Sequence[float] | None = None,
) -> PlantedEffect:
    """Adds an effect's torque to recordings of an arm without it, and diagnoses them.

        assert plant(Magnet(), "joint_2").found

    Args:
        effect: The effect; of its inner grid the first point is planted.
        joint: Where; None takes the second joint. Of no matter for an effect of the whole arm.
        source: Recordings of the arm without it; a simulated arm's if None.
        robot: URDF path, name or arm.
        coefficients: Of its columns; half of what `prior_scale` says is plausible if None.

    Raises:
        InputError: No such joint, recordings that can't show the effect, or no size to plant it
            with.
    """
    _require_effect(effect)
    given = [simulate(robot=str(robot), runs=10)] if source is None else source
    session, arm = _read(given, robot)
    number = _joint_number(effect, joint, arm.joint_names)
    seen = _as_effects_see(session, arm)
    torques = _torque_of(effect, seen, number, coefficients)
    spoilt = _with_torque(session, seen, torques)
    known = {built_in.id for built_in in CATALOGUE}
    further = [] if effect.id in known else [effect]
    squares = np.concatenate(torques) ** 2
    rms = float(np.sqrt(np.mean(squares, axis=0)).max())
    where = arm.joint_names[number] if effect.scope == "joint" else ""
    diagnosis = diagnose(spoilt, arm, catalogue=further)
    return PlantedEffect(effect.id, where, rms, spoilt, diagnosis)


def _require_effect(effect: object) -> None:
    """Raises for what is no effect, such as its class."""
    if not isinstance(effect, Effect):
        what = f"a {type(effect).__name__} is no effect"
        raise InputError("effect", what, "give an object of a class of ident.Effect")


def _read(source: Sources, robot: Robot) -> tuple[Session, ArmModel]:
    """The first session of some recordings, and its arm."""
    read = inspect_sources(Given(source, robot))
    return next(iter(read.reports)).session, read.arm


def _as_effects_see(session: Session, arm: ArmModel) -> SessionContext:
    """Recordings as effects see them: motions, and modelled torques of a tuned baseline."""
    motions = list(prepare_slower(session))
    return build_session(fit_baseline(motions, arm), motions, common_clock=session.common_clock)


def _joint_number(effect: Effect, joint: str | None, names: tuple[str, ...]) -> int:
    """The number of the joint where an effect is to act; 0 for one of the whole arm."""
    if joint is not None and joint not in names:
        raise InputError("joint", f"there is no {joint!r}", f"give one of: {', '.join(names)}")
    if effect.scope == "arm":
        return 0
    return names.index(joint) if joint else min(1, len(names) - 1)


def _torque_of(
    effect: Effect, session: SessionContext, joint: int, coefficients: Sequence[float] | None
) -> list[Array]:
    """An effect's torque on all joints in every run, each of shape (T, n) [N m]."""
    if reason := effect.untestable(session, joint):
        raise InputError(effect.id, reason, "give recordings that can show it")
    variant = effect.variants(session, joint)[0]
    if coefficients is not None:
        weights = np.asarray(coefficients, dtype=float)
    else:
        scale = effect.prior_scale(session, joint, variant)
        if scale is None:
            what = "its prior_scale says nothing of its size"
            raise InputError(effect.id, what, "give coefficients")
        weights = 0.5 * scale
    torques = []
    for columns in effect.columns(session, joint, variant):
        torque = columns @ weights
        if torque.ndim == 1:
            whole = np.zeros((len(torque), session.n))
            whole[:, joint] = torque
            torque = whole
        torques.append(torque)
    return torques


def _with_torque(session: Session, seen: SessionContext, torques: Sequence[Array]) -> Session:
    """The recordings with a torque added; runs that were too short for a motion are left out."""
    added = {}
    for run, torque in zip(seen.runs, torques, strict=True):
        added[run.motion.name] = (run.motion.time, torque)
    recordings = []
    for recording in session.runs:
        if recording.name not in added:
            continue
        time, torque = added[recording.name]
        columns = [np.interp(recording.time, time, column) for column in torque.T]
        recordings.append(recording.replace(effort=recording.effort + np.stack(columns, axis=1)))
    return session.replace(runs=recordings)
