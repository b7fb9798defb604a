"""What each format says of each effect, and what a written file holds where it has no words for one.

`yes`: the format states the same law. `approximate`: it states something near, told in the reason. `no`: it has no
words for it, and the losses that are nearest to the law stand in for it; the module has the law. An effect's class says
what its formats are; what it doesn't speak of is friction.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import nnls

from ident.arrays import Array
from ident.effects.effect_info import Expression
from ident.export.identified import Change, IdentifiedArm, in_module
from ident.export.python import describe_arm
from ident.laws.acting import acting_torque
from ident.laws.motion import Losses, MovingArm
from ident.motion.motion import Motion
from ident.robot.arm import ArmModel

FORMATS = ("urdf", "mjcf", "parameters", "module")
# Formats of whole arms, which a simulator loads.
LOADED = ("urdf", "mjcf")
_FRICTION = "knows damping and dry friction only; the pair that fits best stands in for the law"
_FRICTIONS = {
    "urdf": Expression("no", f"<dynamics> {_FRICTION}"),
    "mjcf": Expression("no", f"<joint> {_FRICTION}; add the module's torque to qfrc_applied"),
}
_UNKNOWN = Expression(
    "no", "an effect outside the catalogue, whose law is known to its file only: give it with --catalogue"
)
_LAWLESS = Expression("no", "its class gives no `law` for the module")

# States at which laws are compared with losses where no recording is given: how long, how dense [s], which speed as a
# share of the limit, and the limit where a URDF has none [rad/s].
USUAL_TIME, USUAL_STEP, USUAL_SHARE, USUAL_LIMIT = 20.0, 0.01, 0.5, 3.0
# Position, speed, acceleration of shape (T, n), and the sampling interval.
Run = tuple[Array, Array, Array, float]
# More samples of a run say no more about a law's nearest losses.
MOST_SAMPLES = 5000


def express(change: Change, form: str) -> Expression:
    """How a format (`urdf`, `mjcf`, `parameters`, `module`) expresses an effect."""
    if form == "parameters":
        return Expression("yes", "all parameters with their intervals")
    effect = change.kind
    if effect is None:
        return _UNKNOWN
    if form != "module":
        return effect.expressed(form, change.values) or _FRICTIONS[form]
    if not change.has_law:
        return Expression("no", effect.left_open) if effect.left_open else _LAWLESS
    return Expression("approximate", effect.left_open) if effect.left_open else Expression("yes", "the law")


def state_arm(identified: IdentifiedArm, form: str, runs: Sequence[Run], alone: Losses | None = None) -> IdentifiedArm:
    """What a file holds of an identified arm: effects that it has words for, losses that stand in for the others.

    Args:
        identified: The arm.
        form: `urdf`, `mjcf`, or another name for a format that knows losses alone.
        runs: Motions along which losses are to stand in for laws; their torque is of no interest.
        alone: Losses fitted to the recordings without the laws: they stand in best where a joint's file tells none.
    """
    said = tuple(c for c in identified.changes if form in LOADED and express(c, form).answer != "no")
    unsaid = [c for c in stood_in(identified.changes, form) if c.has_law]
    losses = stand_in(identified, unsaid, runs)
    if alone is not None:
        of = {c.joint for c in unsaid} - {c.joint for c in said}
        fitted = np.array([j in of and alone.coulomb[j] + alone.viscous[j] > 0.0 for j in range(identified.nominal.n)])
        rubs = {name: np.where(fitted, getattr(alone, name), getattr(losses, name)) for name in ("coulomb", "viscous")}
        losses = replace(losses, **rubs)
    return replace(identified, losses=losses, changes=said)


def stood_in(changes: Iterable[Change], form: str) -> list[Change]:
    """Joints' effects that a format has no words for, so that losses have to stand in for them."""
    unsaid = (c for c in changes if form not in LOADED or express(c, form).answer == "no")
    return [change for change in unsaid if change.joint >= 0 and not change.of_the_log]


def stand_in(identified: IdentifiedArm, laws: Sequence[Change], runs: Sequence[Run]) -> Losses:
    """Losses that are nearest to an arm's own losses and some laws together, joint by joint.

        min Σ (f_c s + C v − τ_losses − τ_laws)²,  f_c, C ≥ 0

    Args:
        identified: The arm.
        laws: Effects of joints.
        runs: Motions over which they are to be near.
    """
    losses = identified.losses
    if not laws:
        return losses
    arm, effects = describe_arm(identified.tuned), in_module(laws)
    torque, slip, speed = [], [], []
    for q, dq, ddq, interval in runs:
        moving = MovingArm(arm, losses, q, dq, ddq, interval)
        own = losses.viscous * dq + losses.coulomb * moving.direction
        torque.append(own + acting_torque(effects, moving))
        slip.append(moving.direction)
        speed.append(dq)
    target, columns = np.concatenate(torque), np.stack([np.concatenate(slip), np.concatenate(speed)], axis=-1)
    coulomb, viscous = np.array(losses.coulomb), np.array(losses.viscous)
    for j in {law.joint for law in laws}:
        coulomb[j], viscous[j] = nnls(columns[:, j], target[:, j])[0]
    return replace(losses, coulomb=coulomb, viscous=viscous)


def recorded_runs(motions: Sequence[Motion]) -> list[Run]:
    """States of recordings, of long ones their first part: the torque is left out."""
    rows = slice(0, max(3, MOST_SAMPLES // max(len(motions), 1)))
    return [(m.q[rows], m.dq[rows], m.ddq[rows], m.interval) for m in motions]


def usual_run(arm: ArmModel) -> Run:
    """Waves of all joints within their limits, as fast as joints usually go."""
    low, high = np.maximum(arm.lower, -np.pi), np.minimum(arm.upper, np.pi)
    limit = np.where((arm.velocity_limit > 0.0) & (arm.velocity_limit < 50.0), arm.velocity_limit, USUAL_LIMIT)
    size = np.minimum(0.4 * (high - low), 1.0)
    pulse = USUAL_SHARE * limit / size * (1.0 + 0.1 * np.arange(arm.n) / arm.n)
    angle = pulse * np.arange(0.0, USUAL_TIME, USUAL_STEP)[:, None] + np.arange(arm.n)
    wave, slope = size * np.sin(angle), size * pulse * np.cos(angle)
    return 0.5 * (low + high) + wave, slope, -(pulse**2) * wave, USUAL_STEP
