"""What each format says of each effect, what stands in where it has no words for one, and how far
off that is.

The table of effects says which part of a file carries a law; where none does, the losses nearest to
the law stand in for it, and the module has the law. How near a file comes is measured: the torque
that the effect adds to the loaded file, against the law's along the same motions. `yes` is what
agrees to a per cent, `no` what is off by more than a tenth, `approximate` what lies between.
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
from ident.export.loaded import LawModel, SimulatorModel, WrittenFile
from ident.laws.acting import acting_torque
from ident.laws.motion import Losses, MovingArm
from ident.model.carried import describe_arm
from ident.robot.arm import ArmModel

FORMATS = ("urdf", "mjcf", "parameters", "module")
# Formats of whole arms, which a simulator loads.
LOADED = ("urdf", "mjcf")
NEAREST = "nearest to the law stand in for it"
FRICTIONS = {
    "urdf": Expression("no", f"the <dynamics> (damping and friction) {NEAREST}"),
    "mjcf": Expression("no", f"the polynomial damping and frictionloss {NEAREST}"),
}
UNKNOWN = "an effect outside the catalogue, whose law is known to its file only"
# Of the torque that an effect adds, what a file may be off by that states it, and that states
# something near.
SAME = 0.01
NEAR = 0.1
# States at which laws are compared with losses where no recording is given: how long, how dense
# [s], which speed as a share of the limit, and the limit where a URDF has none [rad/s].
USUAL_TIME = 20.0
USUAL_STEP = 0.01
USUAL_SHARE = 0.5
USUAL_LIMIT = 3.0
# A joint that may be faster has no limit in its URDF [rad/s].
LARGEST_SPEED = 50.0
# Losses are also to be near at speeds up to this many times those of the runs, at a tenth of the
# weight.
BEYOND = 1.5
BEYOND_WEIGHT = 0.1

Run = tuple[Array, Array, Array, float]
"""Position, speed, acceleration of shape (T, n), and the sampling interval [s]."""

Runs = Sequence[Run]
Shares = dict[str, float]
"""By format."""


def express(change: Change, form: str) -> Expression:
    """How a format (`urdf`, `mjcf`, `parameters`, `module`) expresses an effect, by the table."""
    effect = change.kind
    if form == "parameters":
        return Expression("yes", "all parameters with their intervals")
    if effect is None:
        return Expression("no", f"{UNKNOWN}: give it with --catalogue")
    if form != "module":
        return optional.expressed(effect, form, change.values) or FRICTIONS[form]
    if not change.has_law:
        return Expression("no", effect.left_open or "its class gives no `law` for the module")
    if effect.left_open:
        return Expression("approximate", effect.left_open)
    return Expression("yes", "the law")


def describe(change: Change, off: Shares) -> dict[str, object]:
    """An effect and how each format expresses it, for a record.

    Args:
        change: The effect.
        off: By format the share of its torque that the file is off by, where that was measured.
    """
    formats: dict[str, dict[str, Any]] = {}
    for form in FORMATS:
        stated: dict[str, Any] = dict(express(change, form).to_dict())
        if form in off:
            share = off[form]
            stated |= {"off": share, "expressed": _answer(share)}
            if share > SAME:
                stated["how"] += (
                    f"; it lacks {100.0 * share:.0f} % of its torque along these motions"
                )
        formats[form] = stated
    parameters = {name: interval.to_dict() for name, interval in change.parameters.items()}
    return {
        "effect": change.effect,
        "joints": list(change.joints),
        "parameters": parameters,
        "formats": formats,
    }


def _answer(share: float) -> str:
    """Whether a file that is off by a share of an effect's torque states the effect."""
    if share <= SAME:
        return "yes"
    return "approximate" if share <= NEAR else "no"


def measure_off(identified: IdentifiedArm, form: str, runs: Runs, folder: Path) -> list[Shares]:
    """How far each effect's torque in a loaded file is from its law along motions, as a share of
    it, by format.

    Links that are changed are compared as bodies (`WrittenFile.check`), and what has no law with
    nothing. What a file has a part for is measured on an arm without dry friction, of which
    simulators have another sign at rest.
    """
    frictionless = replace(identified.losses, coulomb=np.zeros(identified.nominal.n))
    smooth = replace(identified, losses=frictionless)

    def both(arm: IdentifiedArm, changes: tuple[Change, ...]) -> tuple[Array, Array]:
        """Torque of the loaded file and of the law along all runs, of an arm with some effects."""
        arm = replace(arm, changes=changes)
        model = WrittenFile.write(form, folder, state_arm(arm, form, runs)).load()
        return _torque_along(model, runs), _torque_along(LawModel.of(arm), runs)

    shares: list[Shares] = []
    plain = {arm: both(arm, ()) for arm in (identified, smooth)}
    for change in identified.changes:
        if not change.has_law or change.part(form) == "inertial":
            shares.append({})
            continue
        arm = smooth if express(change, form).part else identified
        file, law = both(arm, (change,))
        file_without, law_without = plain[arm]
        by_law = law - law_without
        size = float(np.linalg.norm(by_law))
        error = float(np.linalg.norm(file - file_without - by_law))
        shares.append({form: error / size} if size > 0.0 else {})
    return shares


def _torque_along(model: SimulatorModel, runs: Runs) -> Array:
    """What a log of a model reads along motions, one run after the other [N m]."""
    logs = []
    for q, dq, ddq, interval in runs:
        torque = model.joint_torque(q, dq, ddq, interval)
        logs.append(model.read_log(torque, interval))
    return np.concatenate(logs)


def state_arm(identified: IdentifiedArm, form: str, runs: Sequence[Run]) -> IdentifiedArm:
    """What a file holds of an identified arm: effects that it has words for, losses that stand in
    for the others.

    Of a form that is neither `urdf` nor `mjcf` losses alone; they stand in for laws along the
    motions of `runs`.
    """
    stated = []
    for change in identified.changes:
        if form not in LOADED or express(change, form).answer == "no":
            continue
        # A sensor's flat top has no bend before it: the law without its coefficients.
        is_flat = change.part(form) == "cutoff"
        stated.append(replace(change, law=None) if is_flat else change)
    unsaid = [change for change in stood_in(identified.changes, form) if change.has_law]
    losses = stand_in(identified, unsaid, runs, form == "mjcf")
    return replace(identified, losses=losses, changes=tuple(stated))


def is_of_the_log(change: Change) -> bool:
    """Whether an effect is one of the recording, as a gain's error, and not of the arm."""
    return change.kind is not None and change.kind.of_the_log


def stood_in(changes: Iterable[Change], form: str) -> list[Change]:
    """Joints' effects that a format has no words for, so that losses have to stand in for them."""
    unsaid = []
    for change in changes:
        if form in LOADED and express(change, form).answer != "no":
            continue
        if change.joint >= 0 and not is_of_the_log(change):
            unsaid.append(change)
    return unsaid


def stand_in(identified: IdentifiedArm, laws: Sequence[Change], runs: Runs, bends: bool) -> Losses:
    """Losses that are nearest to an arm's own losses and some laws together, joint by joint.

        min Σ (f_c s + C v + b₁ |v| v + b₂ v³ − τ_losses − τ_laws)²,  f_c, C ≥ 0

    over the motions of `runs`; b₁ and b₂ only of a format that `bends`. A polynomial that would
    drive the joint at some speed gives way to a straight line.
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
            friction = losses.viscous * moving.dq + losses.coulomb * moving.direction
            torque.append(weight * (friction + acting_torque(effects, moving)))
            speed = np.abs(moving.dq)
            powers = [moving.direction, moving.dq, speed * moving.dq, speed**2 * moving.dq]
            rows.append(weight * np.stack(powers, -1))
    target = np.concatenate(torque)
    columns = np.concatenate(rows)
    nearest = np.stack([losses.coulomb, losses.viscous, *losses.bend.T])
    limit = identified.nominal.known_limits.speed
    top = np.maximum(np.where(limit < LARGEST_SPEED, limit, 0.0), 1.0)
    for j in {law.joint for law in laws}:
        for size in (4, 2) if bends else (2,):
            x = columns[:, j, :size]
            bounds = ([0.0, 0.0, -np.inf, -np.inf][:size], np.inf)
            scale = np.maximum(np.linalg.norm(x, axis=0), 1e-12)
            solution = lsq_linear(x / scale, target[:, j], bounds, tol=1e-14).x / scale
            nearest[:, j] = np.append(solution, np.zeros(4 - size))
            curve = np.polynomial.Polynomial(nearest[:, j])
            braking = curve(np.linspace(0.0, top[j], 200))
            if braking.min() >= 0.0:
                break
    return replace(losses, coulomb=nearest[0], viscous=nearest[1], bend=nearest[2:].T)


def usual_run(arm: ArmModel) -> Run:
    """Waves of all joints within their limits, as fast as joints usually go."""
    known = arm.known_limits
    low = np.maximum(known.lower, -np.pi)
    high = np.minimum(known.upper, np.pi)
    limit = np.where(known.speed < LARGEST_SPEED, known.speed, USUAL_LIMIT)
    size = np.minimum(0.4 * (high - low), 1.0)
    growing = 1.0 + 0.1 * np.arange(arm.n) / arm.n
    pulse = USUAL_SHARE * limit / size * growing
    time = np.arange(0.0, USUAL_TIME, USUAL_STEP)[:, None]
    angle = pulse * time + np.arange(arm.n)
    wave = size * np.sin(angle)
    slope = size * pulse * np.cos(angle)
    return 0.5 * (low + high) + wave, slope, -(pulse**2) * wave, USUAL_STEP
