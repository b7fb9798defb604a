"""Numbers in sentences and on cards are those of the fitted law, evaluated at the states that the sentence names."""

import re
from collections.abc import Callable, Sequence
from string import Formatter

import numpy as np
import pytest

from ident.arrays import Array
from ident.effects import optional
from ident.effects.base import Effect, SessionContext, Variant
from ident.effects.catalogue import CATALOGUE
from ident.effects.effect_info import STATE
from ident.effects.interval import UNIT_SCALE
from ident.export.identified import Change
from ident.laws.acting import LAWS, link_change, payload_parameters, read_log, turned_gravity
from ident.laws.motion import Losses, MovingArm
from ident.robot.arm import ArmModel
from ident.show.report.words import parameter_cells
from tests.ident.effects.smooth_motion import make_session

DRAWS, JOINT = 50, 1
Figures = dict[str, float]


@pytest.fixture(scope="module")
def session() -> SessionContext:
    """Two runs of 8 s."""
    return make_session(ArmModel.load("tm5-900"), seconds=8.0, runs=2)


def law(effect: str, p: Figures, joint: int = JOINT, **states: Sequence[float]) -> Array:
    """Torque of the written module's law at one joint, its load and others' speed given [N m]."""
    count = max(len(values) for values in states.values())
    q, dq, load = (np.zeros((count, 6)) for _ in range(3))
    for name, values in states.items():
        kind, at = name.split("_")
        {"q": q, "dq": dq, "load": load}[kind][:, joint if at == "own" else int(at) - 1] = values
    ones = np.ones(6)
    motion = MovingArm(None, Losses(*(ones, ones, 0 * ones, ones, ones)), q, dq, 0 * q, 1e-3, np.sign(dq), 1.0)  # type: ignore[arg-type]
    vars(motion)["rigid"] = load
    return np.asarray(LAWS[effect](motion, joint, p)[:, joint])


def wave(effect: str, p: Figures, **states: Sequence[float]) -> float:
    """Largest torque over the angle."""
    turn = np.linspace(0.0, 2.0 * np.pi / (p.get("turns") or p["order"]), 721)
    return float(np.abs(law(effect, p, q_own=turn, **{k: np.repeat(v, len(turn)) for k, v in states.items()})).max())


def stribeck(p: Figures) -> list[float]:
    speed = p["at_speed_rad_s"]
    return [*law("stribeck_friction", p, dq_own=[1e-9 * speed, speed]), speed]


def curved(p: Figures) -> list[float]:
    speed = p["at_speed_rad_s"]
    half, whole = law("nonlinear_viscous_friction", p, dq_own=[speed, 2.0 * speed])
    return [speed, half - 0.5 * whole]


def loaded(p: Figures) -> list[float]:
    speed, load = p["at_speed_rad_s"], p["at_load_Nm"]
    both = law("load_dependent_friction", p, dq_own=[speed, speed], load_own=[load, -load])
    return [100.0 * both.mean() / load, load, speed]


def placed(p: Figures) -> list[float]:
    ends = [p["at_low_rad"], p["at_high_rad"]]
    low, high = law("position_dependent_friction", p, q_own=ends, dq_own=[1.0, 1.0])
    return [0.5 * (high - low), *ends]


def asymmetric(p: Figures) -> list[float]:
    speed = p["at_speed_rad_s"]
    return [law("asymmetric_friction", p, dq_own=[speed, -speed]).sum(), speed]


def hysteresis(p: Figures) -> list[float]:
    travel = p["at_travel_rad"]
    slid, back = law("presliding_hysteresis", p, q_own=[0.0, 1.0, 1.0 - travel])[1:]
    return [1e3 * travel, slid - back]


def thermal(p: Figures) -> list[float]:
    minutes = [round(max(2.0 * p["time_constant_s"] / 60.0, 1.0))] if "time_constant_s" in p else []
    return [*minutes, 100.0 * float(law("thermal_friction", p, dq_own=[1.0])[0])]


def coupling(p: Figures) -> list[float]:
    other, speed = round(p["other_joint"]), p["at_speed_rad_s"]
    return [other, speed, float(law("joint_coupling", p, **{f"dq_{other}": [speed]})[0])]


def spring(p: Figures) -> list[float]:
    ends = [p["at_low_rad"], p["at_high_rad"]]
    low, high = law("spring_torque", p, q_own=ends)
    return [low, ends[0], high, ends[1]]


def ripple(p: Figures) -> list[float]:
    load = p["at_load_Nm"]
    return [wave("torque_ripple", p, load_own=[load]), *([load] if load else [])]


def read(name: str, p: Figures, torque: float) -> float:
    return float(read_log([(name, 0, p)], np.array([[torque]]), 0.0)[0, 0])


def milliradians_and_degrees(angle: float) -> list[float]:
    """An angle [rad] as a sentence tells it."""
    return [1e3 * angle, np.degrees(angle)]


def tilt(p: Figures) -> list[float]:
    x, y = (turned_gravity(np.array([0.0, 0.0, -1.0]), {**p, f"tilt_{gone}_rad": 0.0}) for gone in "yx")
    return [*milliradians_and_degrees(np.arcsin(abs(x[1]))), *milliradians_and_degrees(np.arcsin(abs(y[0])))]


# Of effects whose sentence names what the law gives at some state, the numbers of the sentence.
EVALUATED: dict[str, Callable[[Figures], list[float]]] = {
    "stribeck_friction": stribeck,
    "nonlinear_viscous_friction": curved,
    "load_dependent_friction": loaded,
    "thermal_friction": thermal,
    "presliding_hysteresis": hysteresis,
    "position_dependent_friction": placed,
    "asymmetric_friction": asymmetric,
    "joint_coupling": coupling,
    "joint_elasticity": lambda p: [p["stiffness_Nm_rad"]],
    "backlash": lambda p: [1e3 * p["gap_rad"]],
    "torque_ripple": ripple,
    "spring_torque": spring,
    "payload": lambda p: [payload_parameters(p)[0]],
    # A mass on the second link of an upright arm turns about a fixed point: its moment about the axis is reported.
    "link_inertial_error": lambda p: [float(np.hypot(*link_change(np.eye(10)[0], p)[1:3]))],
    "gravity_misalignment": tilt,
    "torque_gain_error": lambda p: [100.0 * (read("torque_gain_error", p, 1.0) - 1.0)],
    "torque_offset": lambda p: [read("torque_offset", p, 0.0)],
    "torque_delay": lambda p: [1e3 * p["delay_s"]],
    "torque_saturation": lambda p: [
        read("torque_saturation", p, p["at_knee_Nm"]),
        read("torque_saturation", p, p["at_peak_Nm"]),
        p["at_peak_Nm"],
    ],
    "encoder_offset": lambda p: milliradians_and_degrees(p["offset_rad"]),
}
# How a place in a sentence that shows a number, not a word, does not begin.
WORD = "?"
NUMBER = r"[-−]?\d+(?:\.\d+)?(?:e[+-]?\d+)?"


def numbers_of_sentence(effect: Effect, values: Figures, reported: Sequence[str]) -> list[float]:
    """The numbers that a sentence has to show: evaluated, or those of the parameters that it names.

    Args:
        effect: The effect.
        values: All parameters of its law.
        reported: Names of the reported ones, all of which a sentence shows that its row leaves out.
    """
    if effect.id in EVALUATED:
        return EVALUATED[effect.id](values)
    if not effect.sentence:
        return [values[name] for name in reported]
    numbers = []
    for _, name, how, _ in Formatter().parse(effect.sentence):
        if name is None or name == "where" or (how or "").startswith(WORD):
            continue
        numbers.append(UNIT_SCALE.get((how or "").lstrip("=|"), 1.0) * values[name])
    return numbers


def draw(effect: Effect, session: SessionContext, rng: np.random.Generator) -> tuple[Variant, Array]:
    """A point of the grid and coefficients of a plausible size."""
    joint = JOINT if effect.scope == "joint" else 0
    variants = effect.variants(session, joint)
    variant = variants[rng.integers(len(variants))]
    finer = optional.refined(effect, session, joint, variant)
    variant = finer[rng.integers(len(finer))]
    scale = effect.prior_scale(session, joint, variant)
    width = effect.columns(session, joint, variant)[0].shape[-1]
    beta = rng.uniform(0.1, 1.0, width) * np.resize(scale, width)
    free = ~np.isin(np.arange(width), optional.signed(effect, variant))
    beta[free] *= rng.choice([-1.0, 1.0], int(free.sum()))
    if variant.shape.get("mix"):  # the sign of the viscous part says what rubs
        beta = np.abs(beta) * (1.0, variant.shape["mix"])
    return variant, beta


@pytest.mark.parametrize("effect", [one for one in CATALOGUE if not one.event], ids=lambda effect: effect.id)
def test_every_number_of_a_sentence_is_the_law_s(effect: Effect, session: SessionContext) -> None:
    """Sentence, card and module agree within 1 % at every named state, over random points of the grid and sizes."""
    rng, joint = np.random.default_rng(3), JOINT if effect.scope == "joint" else 0
    for _ in range(DRAWS):
        variant, beta = draw(effect, session, rng)
        figures = effect.parameters(session, joint, variant, beta, np.diag((0.05 * beta) ** 2))
        seen = optional.without_dry_friction(effect, beta, variant)[0] if effect.open_law else beta
        shape = {**variant.shape, **variant.inner}
        known = {"coefficients": list(seen), "shape": shape} if optional.tells_law(effect, variant) else None
        values = Change(effect.id, joint, (), figures, known, effect).values
        sentence = effect.action("the joint", figures).replace("−", "-")
        intervals = re.findall(rf"({NUMBER}) [^\[\d]*\[({NUMBER}), ({NUMBER})\]", sentence)
        assert all(float(low) <= float(value) <= float(high) for value, low, high in intervals), sentence
        shown = [float(number) for number in re.findall(NUMBER, re.sub(r"\[[^\]]*\]", "", sentence))]
        wanted = numbers_of_sentence(effect, values, list(figures))
        assert np.abs(shown) == pytest.approx(np.abs(wanted), rel=1e-2, abs=1e-9), sentence
        for name, figure in figures.items():
            row = parameter_cells(name, figure.to_dict())
            assert float(row["value"].replace("−", "-").replace(" ", "")) == pytest.approx(figure.value, rel=1e-2)
            assert bool(row["interval"]) != name.startswith(STATE) or name in ("order", "other_joint")
