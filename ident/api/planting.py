"""Plants an effect in recordings of an arm without it, and sees whether it is found: a test of one's own effect."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ident.api.diagnosing import diagnose
from ident.api.simulating import simulate
from ident.arrays import Array, Float
from ident.diagnosis.regression.baseline import fit_baseline
from ident.diagnosis.regression.decimation import prepare_slower
from ident.diagnosis.regression.runs import build_session
from ident.diagnosis.result import Diagnosis
from ident.effects.base import Effect, SessionContext
from ident.effects.catalogue import CATALOGUE
from ident.errors import InputError
from ident.recordings.recording import Session
from ident.sessions import Given, Robot, Sources, inspect_sources


@dataclass(frozen=True, eq=False)
class PlantedEffect:
    """An effect that was planted, and what became of it.

    Attributes:
        effect: Its id.
        joint: Where; "" for an effect of the whole arm.
        rms: Root mean square of its torque at the joint where it acts most [N m].
        session: The recordings with it.
        diagnosis: What they were found to be.
    """

    effect: str
    joint: str
    rms: float
    session: Session
    diagnosis: Diagnosis

    @property
    def found(self) -> bool:
        """Whether a finding at its joint holds it in its class."""
        return any(
            self.effect in one.estimate.rivals and (not self.joint or self.joint in one.joints)
            for one in self.diagnosis.findings
        )

    def __repr__(self) -> str:
        names = ", ".join(f"{one.effect} at {', '.join(one.joints)}" for one in self.diagnosis.findings) or "nothing"
        where = f" at {self.joint}" if self.joint else ""
        found = "found" if self.found else "not found"
        return f"{self.effect}{where}, {self.rms:.2g} N m rms: {found} (named: {names})"


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
        InputError: No such joint, recordings that can't show the effect, or no size to plant it with.
    """
    if not isinstance(effect, Effect):
        raise InputError(
            "effect", f"a {type(effect).__name__} is no effect", "give an object of a class of ident.Effect"
        )
    given = [simulate(robot=str(robot), runs=10)] if source is None else source
    read = inspect_sources(Given(given, robot))
    session, names = next(iter(read.reports)).session, read.arm.joint_names
    if joint is not None and joint not in names:
        raise InputError("joint", f"there is no {joint!r}", f"give one of: {', '.join(names)}")
    j = 0 if effect.scope == "arm" else names.index(joint) if joint else min(1, len(names) - 1)
    motions = list(prepare_slower(session))
    context = build_session(fit_baseline(motions, read.arm), motions, common_clock=session.common_clock)
    torques = _torques(effect, context, j, coefficients)
    added = {motion.name: (motion.time, torque) for motion, torque in zip(motions, torques, strict=True)}
    runs = [
        run.replace(effort=run.effort + _at(run.time, *added[run.name])) for run in session.runs if run.name in added
    ]
    spoilt = session.replace(runs=runs)
    own = [] if effect.id in {known.id for known in CATALOGUE} else [effect]
    rms = float(np.sqrt(np.mean(np.concatenate(torques) ** 2, axis=0)).max())
    where = names[j] if effect.scope == "joint" else ""
    return PlantedEffect(effect.id, where, rms, spoilt, diagnose(spoilt, read.arm, catalogue=own))


def _torques(
    effect: Effect, context: SessionContext, joint: int, coefficients: Sequence[float] | None
) -> list[Float[Array, "T n"]]:
    """The effect's torque in every run [N m].

    Raises:
        InputError: The runs can't show it, or it has no size.
    """
    if reason := effect.untestable(context, joint):
        raise InputError(effect.id, reason, "give recordings that can show it")
    variant = effect.variants(context, joint)[0]
    scale = effect.prior_scale(context, joint, variant) if coefficients is None else 2.0 * np.asarray(coefficients)
    if scale is None:
        raise InputError(effect.id, "its prior_scale says nothing of its size", "give coefficients")
    return [_everywhere(one @ (0.5 * scale), joint, context.n) for one in effect.columns(context, joint, variant)]


def _everywhere(torque: Array, joint: int, n: int) -> Float[Array, "T n"]:
    """Torque of one joint, or of all, as that of all [N m]."""
    if torque.ndim == 2:
        return torque
    whole = np.zeros((len(torque), n))
    whole[:, joint] = torque
    return whole


def _at(time: Float[Array, " t"], known: Float[Array, " T"], torque: Float[Array, "T n"]) -> Float[Array, "t n"]:
    """A torque at other times than those at which it is known [N m]."""
    return np.stack([np.interp(time, known, column) for column in torque.T], axis=1)
