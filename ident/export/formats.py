"""What each format says of each effect, what stands in where it has no words for one, and how far off that is.

The table of effects says which part of a file carries a law; where none does, the losses nearest to the law stand in
for it, and the module has the law. How near a file comes is measured: the torque that the effect adds to the loaded
file, against the law's along the same motions. `yes` is what agrees to a per cent, `no` what is off by more than a
tenth, `approximate` what lies between.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import lsq_linear

from ident.arrays import Array
from ident.effects import optional
from ident.effects.effect_info import Expression
from ident.export.identified import Change, IdentifiedArm, in_module
from ident.export.loaded import LawModel, WrittenFile
from ident.laws.acting import acting_torque
from ident.laws.motion import Losses, MovingArm
from ident.model.carried import describe_arm
from ident.robot.arm import ArmModel

FORMATS = ("urdf", "mjcf", "parameters", "module")
# Formats of whole arms, which a simulator loads.
LOADED = ("urdf", "mjcf")
FRICTIONS = {
    "urdf": Expression("no", "the <dynamics> (damping and friction) nearest to the law stand in for it"),
    "mjcf": Expression("no", "the polynomial damping and frictionloss nearest to the law stand in for it"),
}
_UNKNOWN = "an effect outside the catalogue, whose law is known to its file only: give it with --catalogue"
# Of the torque that an effect adds, what a file may be off by that states it, and that states something near.
SAME = 0.01
NEAR = 0.1

# States at which laws are compared with losses where no recording is given: how long, how dense [s], which speed as a
# share of the limit, and the limit where a URDF has none [rad/s].
USUAL_TIME = 20.0
USUAL_STEP = 0.01
USUAL_SHARE = 0.5
USUAL_LIMIT = 3.0
# Position, speed, acceleration of shape (T, n), and the sampling interval.
Run = tuple[Array, Array, Array, float]
# Losses are also to be near at speeds up to this many times those of the runs, at a tenth of the weight.
BEYOND = 1.5
BEYOND_WEIGHT = 0.1


def express(change: Change, form: str) -> Expression:
    """How a format (`urdf`, `mjcf`, `parameters`, `module`) expresses an effect, by the table."""
    effect = change.kind
    if form == "parameters":
        return Expression("yes", "all parameters with their intervals")
    if effect is None:
        return Expression("no", _UNKNOWN)
    if form != "module":
        return optional.expressed(effect, form, change.values) or FRICTIONS[form]
    if not change.has_law:
        return Expression("no", effect.left_open or "its class gives no `law` for the module")
    return Expression("approximate", effect.left_open) if effect.left_open else Expression("yes", "the law")


def describe(change: Change, off: dict[str, float]) -> dict[str, Any]:
    """An effect and how each format expresses it, for a record; `off` by which share, where that was measured."""
    formats: dict[str, dict[str, Any]] = {}
    for form in FORMATS:
        said = express(change, form)
        formats[form] = dict(said.to_dict())
        if form in off:
            near = "approximate" if off[form] <= NEAR else "no"
            formats[form] |= {"off": off[form], "expressed": "yes" if off[form] <= SAME else near}
            if off[form] > SAME:
                formats[form]["how"] += f"; it lacks {100.0 * off[form]:.0f} % of its torque along these motions"
    parameters = {name: one.to_dict() for name, one in change.parameters.items()}
    return {"effect": change.effect, "joints": list(change.joints), "parameters": parameters, "formats": formats}


def measure_off(identified: IdentifiedArm, form: str, runs: Sequence[Run], folder: Path) -> list[dict[str, float]]:
    """How far each effect's torque in a loaded file is from its law along motions, as a share of it, by format.

    Links that are changed are compared as bodies (`WrittenFile.check`), and what has no law with nothing. What a file
    has a part for is measured on an arm without dry friction, of which simulators have another sign at rest.
    """
    smooth = replace(identified, losses=replace(identified.losses, coulomb=np.zeros(identified.nominal.n)))

    def both(arm: IdentifiedArm, changes: tuple[Change, ...]) -> tuple[Array, Array]:
        arm = replace(arm, changes=changes)
        models = WrittenFile.write(form, folder, state_arm(arm, form, runs)).load(), LawModel.of(arm)
        file, law = ([one.read_log(one.joint_torque(*run), run[-1]) for run in runs] for one in models)
        return np.concatenate(file), np.concatenate(law)

    found: list[dict[str, float]] = []
    plain = {arm: both(arm, ()) for arm in (identified, smooth)}
    for change in identified.changes:
        if not change.has_law or change.part(form) == "inertial":
            found.append({})
            continue
        arm = smooth if express(change, form).part else identified
        file, law = (with_it - without for with_it, without in zip(both(arm, (change,)), plain[arm], strict=True))
        size = float(np.linalg.norm(law))
        found.append({form: float(np.linalg.norm(file - law)) / size} if size > 0.0 else {})
    return found


def state_arm(identified: IdentifiedArm, form: str, runs: Sequence[Run]) -> IdentifiedArm:
    """What a file holds of an identified arm: effects that it has words for, losses that stand in for the others.

    Of a form that is neither `urdf` nor `mjcf` losses alone; they stand in for laws along the motions of `runs`.
    """
    said = tuple(c for c in identified.changes if form in LOADED and express(c, form).answer != "no")
    unsaid = [c for c in stood_in(identified.changes, form) if c.has_law]
    # A sensor's flat top has no bend before it: the law without its coefficients.
    flat = tuple(replace(c, law=None) if c.part(form) == "cutoff" else c for c in said)
    return replace(identified, losses=stand_in(identified, unsaid, runs, form == "mjcf"), changes=flat)


def stood_in(changes: Iterable[Change], form: str) -> list[Change]:
    """Joints' effects that a format has no words for, so that losses have to stand in for them."""
    unsaid = (c for c in changes if form not in LOADED or express(c, form).answer == "no")
    return [change for change in unsaid if change.joint >= 0 and not (change.kind and change.kind.of_the_log)]


def stand_in(identified: IdentifiedArm, laws: Sequence[Change], runs: Sequence[Run], bends: bool) -> Losses:
    """Losses that are nearest to an arm's own losses and some laws together, joint by joint.

        min Σ (f_c s + C v + b₁ |v| v + b₂ v³ − τ_losses − τ_laws)²,  f_c, C ≥ 0

    over the motions of `runs`; b₁ and b₂ only of a format that `bends`. A polynomial that would drive the joint at some
    speed gives way to a straight line.
    """
    losses = identified.losses
    if not laws:
        return losses
    arm = describe_arm(identified.tuned)
    effects = in_module(laws)
    torque = []
    rows = []
    for q, dq, ddq, interval in runs:
        for faster, weight in ((1.0, 1.0), (BEYOND, BEYOND_WEIGHT)):
            moving = MovingArm(arm, losses, q, faster * dq, ddq, interval)
            own = losses.viscous * moving.dq + losses.coulomb * moving.direction
            torque.append(weight * (own + acting_torque(effects, moving)))
            speed = np.abs(moving.dq)
            rows.append(weight * np.stack([moving.direction, moving.dq, speed * moving.dq, speed**2 * moving.dq], -1))
    target = np.concatenate(torque)
    columns = np.concatenate(rows)
    found = np.stack([losses.coulomb, losses.viscous, *losses.bend.T])
    speed = identified.nominal.known_limits.speed
    top = np.maximum(np.where(speed < 50.0, speed, 0.0), 1.0)
    for j in {law.joint for law in laws}:
        for size in (4, 2) if bends else (2,):
            x = columns[:, j, :size]
            bounds = ([0.0, 0.0, -np.inf, -np.inf][:size], np.inf)
            scale = np.maximum(np.linalg.norm(x, axis=0), 1e-12)
            near = lsq_linear(x / scale, target[:, j], bounds, tol=1e-14).x / scale
            found[:, j] = np.append(near, np.zeros(4 - size))
            if np.polynomial.Polynomial(found[:, j])(np.linspace(0.0, top[j], 200)).min() >= 0.0:
                break
    return replace(losses, coulomb=found[0], viscous=found[1], bend=found[2:].T)


def usual_run(arm: ArmModel) -> Run:
    """Waves of all joints within their limits, as fast as joints usually go."""
    known = arm.known_limits
    low = np.maximum(known.lower, -np.pi)
    high = np.minimum(known.upper, np.pi)
    limit = np.where(known.speed < 50.0, known.speed, USUAL_LIMIT)
    size = np.minimum(0.4 * (high - low), 1.0)
    pulse = USUAL_SHARE * limit / size * (1.0 + 0.1 * np.arange(arm.n) / arm.n)
    angle = pulse * np.arange(0.0, USUAL_TIME, USUAL_STEP)[:, None] + np.arange(arm.n)
    wave = size * np.sin(angle)
    slope = size * pulse * np.cos(angle)
    return 0.5 * (low + high) + wave, slope, -(pulse**2) * wave, USUAL_STEP
