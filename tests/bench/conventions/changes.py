"""Changes of a log's conventions or of its URDF, drawn at random, and the hypothesis that undoes them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ident.arrays import Array
from ident.checks.conventions.hypothesis import COMPENSATED, GEARS, UNITS, ZEROS, Hypothesis
from ident.checks.conventions.model import Model
from ident.checks.conventions.readings import Log
from ident.robot.arm import ArmModel
from tests.bench.conventions.arms import Case

GRAVITY = 9.81
KINDS = (
    "order",
    "effort_order",
    "direction",
    "zero",
    "unit",
    "unit_of_one",
    "gear",
    "share",
    "effort_sign",
    "effort_sign_of_one",
    "gravity",
    "compensated",
    "mass_factor",
    "effort_scale",
    "body",
)
OF_MASSES = frozenset({"mass_factor", "effort_scale", "body"})
OF_COLUMNS = frozenset({"order", "effort_order"})
EXCLUSIVE = (frozenset({"gravity", "compensated"}), frozenset({"unit", "unit_of_one"}))
# All masses: grams, kilograms read as grams, and wrong by much.
FACTORS = (1e-3, 1e3, 1.9, 1.0 / 1.9, 2.5, 0.4)
# One joint's effort: tenths, per cent, a current's gain, per mille.
SCALES = (10.0, 100.0, 0.05, 1000.0)


def draw_kinds(case: Case, rng: np.random.Generator) -> tuple[str, ...]:
    """One to three kinds of change that a log can show together; none of masses where they are unknown anyway."""
    while True:
        kinds = tuple(str(kind) for kind in rng.choice(KINDS, int(rng.integers(1, 4)), replace=False))
        if any(pair <= {*kinds} for pair in EXCLUSIVE):
            continue
        if not case.is_sound and OF_MASSES & {*kinds}:
            continue
        # One joint alone tells neither an order, nor its torque's unit from its masses'.
        if case.arm.n < 2 and (OF_COLUMNS | OF_MASSES) & {*kinds}:
            continue
        if "share" in kinds and not Model(case.arm).after_parallel:
            continue
        return kinds


def draw(case: Case, kinds: tuple[str, ...], rng: np.random.Generator) -> Hypothesis:
    """A reading that undoes what is to be changed: the truth."""
    truth = Hypothesis.as_it_is(case.arm.n)
    for kind in kinds:
        truth = _draw_one(case, truth, kind, rng)
    return truth


def _draw_one(case: Case, truth: Hypothesis, kind: str, rng: np.random.Generator) -> Hypothesis:
    """The truth with one more change."""
    n = case.arm.n
    joint = int(rng.choice(np.flatnonzero(~case.arm.sliding_joints)))
    if kind == "order":
        order = _draw_order(case.arm, rng)
        return replace(truth, order=order, effort_order=order)
    if kind == "effort_order":
        return replace(truth, effort_order=_exchanged(truth.effort_order, rng))
    if kind == "direction":
        return truth.with_entry("direction", joint, -1)
    if kind == "zero":
        return truth.with_entry("quarters", joint, int(rng.integers(1, 4)))
    if kind == "unit":
        return replace(truth, unit=(str(rng.choice(["deg", "turns"])),) * n)
    if kind == "unit_of_one":
        return truth.with_entry("unit", joint, "deg")
    if kind == "gear":
        return truth.with_entry("gear", joint, float(rng.choice(GEARS)))
    if kind == "share":
        joint = int(rng.choice(Model(case.arm).after_parallel))
        return truth.with_entry("share", joint, int(rng.choice([-1, 1])))
    if kind == "effort_sign":
        return replace(truth, effort_sign=(-1,) * n)
    if kind == "effort_sign_of_one":
        return truth.with_entry("effort_sign", joint, -1)
    if kind == "gravity":
        x, y, z = (float(value) for value in case.arm.model.gravity.linear)
        return replace(truth, gravity=(x, y, z))
    if kind == "compensated":
        return replace(truth, gravity=COMPENSATED)
    if kind == "mass_factor":
        return replace(truth, mass_factor=float(rng.choice(FACTORS)))
    if kind == "effort_scale":
        return replace(truth, effort_scale=((joint, float(rng.choice(SCALES))),))
    mass = float(rng.choice([-1.0, 1.0])) * rng.uniform(0.1, 0.3) * arm_mass(case.arm)
    place = rng.uniform(-0.1, 0.1, 3) + 0.1 * np.sign(rng.standard_normal(3))
    x, y, z = (float(mass * value) for value in place)
    return replace(truth, body=(float(mass), x, y, z))


def _draw_order(arm: ArmModel, rng: np.random.Generator) -> tuple[int, ...]:
    """Two columns exchanged, or all of them in alphabetical order, or from the tip on where that is the robot's."""
    plain = tuple(range(arm.n))
    if rng.uniform() < 0.5 or arm.n < 3:
        return _exchanged(plain, rng)
    columns = sorted(arm.joint_names)
    order = tuple(columns.index(name) for name in arm.joint_names)
    return order[::-1] if order == plain else order


def _exchanged(order: tuple[int, ...], rng: np.random.Generator) -> tuple[int, ...]:
    """An order with two of its entries exchanged."""
    changed = list(order)
    i, j = (int(k) for k in rng.choice(len(order), 2, replace=False))
    changed[i], changed[j] = changed[j], changed[i]
    return tuple(changed)


def arm_mass(arm: ArmModel) -> float:
    """Mass of the moving links [kg]."""
    return float(arm.inertial_parameters[::10].sum())


def spoil(case: Case, truth: Hypothesis, rng: np.random.Generator) -> tuple[Log, ArmModel]:
    """The log and the URDF that the truth, read of them, makes those of the case."""
    q, dq, ddq, tau = (np.zeros_like(case.log.q) for _ in range(4))
    torque: Array = np.array(case.log.tau)
    if truth.gravity == COMPENSATED:  # as large as it is in the recording, whatever the URDF's masses are
        torque -= case.sizes * case.arm.gravity(case.log.q)
    for joint, scale in truth.effort_scale:
        torque[:, joint] *= scale
    for j, (column, effort) in enumerate(zip(truth.order, truth.effort_order, strict=True)):
        unit = 1.0 if case.arm.sliding_joints[j] else UNITS.get(truth.unit[j], 1.0)  # a slide has none
        factor = truth.direction[j] * truth.gear[j] * unit
        share = truth.share[j]
        q[:, column] = (_counted(case.log.q, j, share) - ZEROS[truth.quarters[j]]) / factor
        dq[:, column] = _counted(case.log.dq, j, share) / factor
        ddq[:, column] = _counted(case.log.ddq, j, share) / factor
        tau[:, effort] = truth.direction[j] * truth.effort_sign[j] * torque[:, j]
    return Log(q, dq, ddq, tau), _spoilt_arm(case.arm, truth, rng)


def _counted(angles: Array, joint: int, share: int) -> Array:
    """A joint's angle, or a derivative of it, without the part that the joint before has of it."""
    if not share:
        return np.asarray(angles[:, joint])
    return np.asarray(angles[:, joint] - share * angles[:, joint - 1])


def _spoilt_arm(arm: ArmModel, truth: Hypothesis, rng: np.random.Generator) -> ArmModel:
    """The URDF of which the truth makes the arm."""
    parameters = np.array(arm.inertial_parameters)
    if truth.body is not None:
        parameters[-10:-6] -= np.array(truth.body)
    spoilt = arm.with_inertial_parameters(parameters / truth.mass_factor)
    if isinstance(truth.gravity, str):
        return spoilt
    down = np.array(truth.gravity) / GRAVITY
    axes = [axis for axis in np.concatenate([np.eye(3), -np.eye(3)]) if axis @ down < 0.9]
    return spoilt.with_gravity(GRAVITY * axes[int(rng.integers(len(axes)))])
