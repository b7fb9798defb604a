"""Effects one by one: planted torques are found again with their parameters, and what can't show says why."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.optimize import nnls
from smooth_motion import COULOMB, VISCOUS, Recover, edit_runs, make_session

from ident.arrays import Array
from ident.effects.base import RunContext, SessionContext, Variant
from ident.effects.catalogue import find_effect
from ident.effects.optional import stands_for
from ident.robot.arm import ArmModel
from tests.ident.made_up import sliding_arm

Torque = Callable[[RunContext], Array]


def turn(run: RunContext, joint: int) -> Array:
    """Direction of dry friction."""
    return np.tanh(run.motion.dq[:, joint] / 0.01)


def stribeck(size: float, speed: float, exponent: float, joint: int) -> Torque:
    """Friction that fades with the speed."""
    return lambda run: size * turn(run, joint) * np.exp(-(np.abs(run.motion.dq[:, joint] / speed) ** exponent))


def power_law(exponent: float) -> Torque:
    """4 N m at 1 rad/s."""
    return lambda run: turn(run, 1) * 4.0 * np.abs(run.motion.dq[:, 1]) ** exponent


def gear_loss(run: RunContext) -> Array:
    """8 % of the load while driving, 5 % while backdriving."""
    return np.where(run.link[:, 1] * run.motion.dq[:, 1] > 0, 0.08, 0.05) * turn(run, 1) * np.abs(run.link[:, 1])


def lopsided(run: RunContext) -> Array:
    """Friction of (9, 7) N m and (11, 9) N m s/rad in the two directions, less its mean."""
    v, slip = run.motion.dq[:, 0], turn(run, 0)
    return (9.0 * slip + 11.0 * v) * (v > 0) + (7.0 * slip + 9.0 * v) * (v <= 0) - 8.0 * slip - 10.0 * v


def build_up(law: Callable[[float, float], float]) -> Torque:
    """2 N m of a state in [-1, 1] that follows the path of joint 5, step by step."""

    def torque(run: RunContext) -> Array:
        state, values = 0.0, []
        for step in np.diff(run.motion.q[:, 4], prepend=run.motion.q[0, 4]):
            state = law(state, step)
            values.append(2.0 * state)
        return np.array(values)

    return torque


def dahl(state: float, step: float) -> float:
    """Builds up as 1 − 2 exp(−x / 8 mrad)."""
    goal = float(np.sign(step))
    return goal + (state - goal) * float(np.exp(-abs(step) / 0.008))


def shifted_zero(run: RunContext) -> Array:
    """Every joint's torque where the angle of joint 2 is 12 mrad above the logged one."""
    m = run.motion
    return run.arm.inverse_dynamics(m.q + 0.012 * np.eye(6)[1], m.dq, m.ddq) - run.rigid


# Effect, joint, its torque, and by parameter the value with its tolerance; without one it lies in the interval.
PLANTED: dict[str, tuple[str, int, Torque, dict[str, tuple[float, ...]]]] = {
    "Stribeck": ("stribeck_friction", 0, stribeck(3.0, 0.025, 2.0, 0),
                 {"amplitude_Nm": (3.0,), "stribeck_velocity_rad_s": (0.025, 0.0), "exponent": (2.0, 0.0)}),
    # The grid owns what it can't resolve.
    "between two points": ("stribeck_friction", 2, stribeck(2.0, 0.04, 1.0, 2), {"stribeck_velocity_rad_s": (0.04,)}),
    "root of speed": ("nonlinear_viscous_friction", 1, power_law(0.5), {"coefficient": (4.0,), "exponent": (0.5, 0.0)}),
    "square of it": ("nonlinear_viscous_friction", 1, power_law(2.0), {"coefficient": (4.0,), "exponent": (2.0, 0.0)}),
    "load": ("load_dependent_friction", 1, gear_loss, {"mu": (0.065, 0.002)}),
    "position": ("position_dependent_friction", 3,
                 lambda run: 1.5 * run.direction[:, 3] * np.cos(2 * (run.motion.q[:, 3] - 0.4)),
                 {"order": (2.0, 0.0), "amplitude_Nm": (1.5,), "phase_rad": (0.8,)}),
    "two directions": ("asymmetric_friction", 0, lopsided,
                       {"coulomb_difference_Nm": (2.0, 0.04), "viscous_difference_Nms_rad": (2.0, 0.04)}),
    # A sharp build-up counts as two thirds as long as it is.
    "spring and slider": ("presliding_hysteresis", 4,
                          build_up(lambda state, step: min(max(state + step / 0.004, -1.0), 1.0)),
                          {"displacement_rad": (0.004,), "amplitude_Nm": (2.5, 0.4)}),
    "smooth build-up": ("presliding_hysteresis", 4, build_up(dahl),
                        {"amplitude_Nm": (2.0, 0.5), "displacement_rad": (0.008, 0.002)}),
    "another joint": ("joint_coupling", 3,
                      lambda run: 0.6 * run.direction[:, 4] + 0.9 * run.motion.dq[:, 4] + 0.05 * run.motion.ddq[:, 4],
                      {"other_joint": (5.0, 0.0), "coulomb_Nm": (0.6, 0.012), "viscous_Nms_rad": (0.9, 0.018),
                       "inertia_kgm2": (0.05, 0.001)}),
    "sum of two joints": ("joint_coupling", 5,
                          lambda run: 0.8 * np.tanh((run.motion.dq[:, 4] + run.motion.dq[:, 5]) / 0.01),
                          {"other_joint": (5.0, 0.0), "coulomb_Nm": (0.8, 0.016)}),
    "ripple": ("torque_ripple", 2, lambda run: 1.2 * np.cos(200 * run.motion.q[:, 2] - 0.7),
               {"order": (2.0, 0.0), "amplitude_Nm": (1.2, 0.012), "phase_rad": (0.7, 0.01)}),
    "spring": ("spring_torque", 0, lambda run: 5.0 * (run.motion.q[:, 0] - 0.3),
               {"stiffness_Nm_rad": (5.0,), "rest_rad": (0.3,)}),
    "spring of two rests": ("spring_torque", 0, lambda run: 2.5 * np.sin(2 * (run.motion.q[:, 0] - 0.3)),
                            {"stiffness_Nm_rad": (5.0,), "rest_rad": (0.3,)}),
    "zero": ("encoder_offset", 1, shifted_zero, {"offset_rad": (0.012, 2.4e-4)}),
}  # fmt: skip


@pytest.mark.parametrize("case", PLANTED)
def test_a_planted_torque_is_found_with_its_parameters(case: str, session: SessionContext, recover: Recover) -> None:
    effect, joint, torque, expected = PLANTED[case]
    found = recover(find_effect(effect), session, joint, [torque(run) for run in session.runs])
    for name, (value, *tolerance) in expected.items():
        if tolerance:
            assert found[name].value == pytest.approx(value, abs=tolerance[0])
        else:
            assert found[name].low < value < found[name].high


def edited(**changes: Callable[[RunContext], Any]) -> Callable[[SessionContext], SessionContext]:
    """A session whose runs have other signals; those of the motion by their names."""

    def change(run: RunContext) -> RunContext:
        new = {name: make(run) for name, make in changes.items()}
        own = {name: new.pop(name) for name in ("q", "dq", "std") if name in new}
        return replace(run, motion=replace(run.motion, **own), **new)

    return lambda session: edit_runs(session, change)


def untimed(session: SessionContext) -> SessionContext:
    return replace(session, common_clock=False)


def short(seconds: float, runs: int, size: float = 1.0) -> Callable[[SessionContext], SessionContext]:
    return lambda session: make_session(session.runs[0].arm, seconds, runs, size=size)


def follows_the_first(run: RunContext) -> tuple[Array, Array]:
    """Positions and speeds where joint 2 moves with joint 1, and the others stand."""
    return tuple(np.where(np.arange(6) < 2, part[:, :1], 0.0) for part in (run.motion.q, run.motion.dq))


mild = edited(temperature=lambda run: np.full_like(run.motion.q, 30.0))
# Effect, joint, what the recordings are like, and what is said of them.
UNTESTABLE: list[tuple[str, int, Callable[[SessionContext], SessionContext], str]] = [
    ("asymmetric_friction", 0, edited(dq=lambda run: np.abs(run.motion.dq)), "joint_1 moves in one direction only"),
    ("position_dependent_friction", 0, short(5.0, 1, 0.1), "covers"),
    ("thermal_friction", 0, untimed, "no clock"),
    ("thermal_friction", 0, short(5.0, 2), "lasts 12 s only"),
    ("thermal_friction", 0, lambda session: untimed(mild(session)), "hardly varies, and the runs share no clock"),
    ("presliding_hysteresis", 0,
     edited(q=lambda run: np.cumsum(np.abs(run.motion.dq), axis=0) * run.interval), "reverses"),
    ("presliding_hysteresis", 0, edited(std=lambda run: np.array([[0.02], [1e-3], [0.1]]) * np.ones(6)), "too noisy"),
    ("torque_ripple", 0, edited(dq=lambda run: 3.0 + np.abs(run.motion.dq)), "never slow enough"),
    ("torque_delay", 0, short(5.0, 4, 0.002), "torque changes too slowly in all joints"),
    ("torque_saturation", 5, short(5.0, 1, 0.3), "of its rated torque"),
    ("load_dependent_friction", 0, short(1.0, 1, 0.05), "no torque depends on it: gravity loads joint_1 alike"),
    ("load_dependent_friction", 1, edited(link=lambda run: 0.0 * run.link), "varies by 0.00 N m only"),
    ("encoder_offset", 0, lambda session: session, "no torque depends on the angle of joint_1"),
    ("joint_coupling", 0, edited(q=lambda run: follows_the_first(run)[0], dq=lambda run: follows_the_first(run)[1]),
     "move only together with joint_1"),
]  # fmt: skip


@pytest.mark.parametrize(("effect", "joint", "change", "words"), UNTESTABLE)
def test_what_can_not_show_says_why(
    effect: str, joint: int, change: Callable[[SessionContext], SessionContext], words: str, session: SessionContext
) -> None:
    assert words in str(find_effect(effect).untestable(change(session), joint))


@pytest.mark.parametrize("absorbed", [0.0, 0.6, 1.0])
@pytest.mark.parametrize("gain", [-0.4, 0.05, 0.5])
def test_a_gain_is_found_whatever_of_it_tuning_has_absorbed(
    gain: float, absorbed: float, session: SessionContext, recover: Recover
) -> None:
    """Law: a log that reads so of rigid torque, friction and rotor is off by its gain, however the model was tuned."""
    tuned = 1.0 + absorbed * gain

    def misread(run: RunContext) -> RunContext:
        rotor = 0.6 * run.motion.ddq
        motion = replace(run.motion, tau=(1.0 + gain) * (run.total + rotor))
        rigid, friction, rotor = (tuned * one for one in (run.rigid, run.friction, rotor))
        return replace(run, motion=motion, rigid=rigid, friction=friction, rotor=rotor)

    whole = edit_runs(session, misread)
    torque = [gain / (1.0 + gain) * run.motion.tau[:, 2] for run in whole.runs]
    found = recover(find_effect("torque_gain_error"), whole, 2, torque)["gain"]
    assert found.value == pytest.approx(gain, rel=1e-3)
    assert found.low < gain < found.high


def test_an_offset_is_found_with_its_drift(session: SessionContext, recover: Recover) -> None:
    """0.4 N m in the middle of the session, rising by 2 mN m a second; the interval holds what it was at the start."""
    middle = (session.runs[0].motion.time[0] + session.runs[-1].motion.time[-1]) / 2
    torque = [0.4 + 0.002 * (run.motion.time - middle) for run in session.runs]
    found = recover(find_effect("torque_offset"), session, 0, torque)
    first = 0.4 - 0.002 * (middle - session.runs[0].motion.time[0])
    assert (found["offset_Nm"].low, found["offset_Nm"].high) == pytest.approx((first, 0.8 - first), abs=1e-3)
    assert found["drift_Nm_s"].low < 0.002 < found["drift_Nm_s"].high


def test_warmth_is_found_with_its_time_constant(arm: ArmModel, recover: Recover) -> None:
    """Viscous friction that falls by 40 % as heat builds up by θ' = P − θ/30 s, pauses included."""
    session = make_session(arm, seconds=20.0, runs=5, pause=15.0)
    warmth, heat = [], 0.0
    for run in session.runs:
        values = []
        for v in run.motion.dq[:, 1]:
            values.append(heat)
            power = COULOMB[1] * v * np.tanh(v / 0.01) + VISCOUS[1] * v * v
            heat += run.interval * (power - heat / 30.0)
        warmth.append(np.array(values))
        heat *= np.exp(-(15.0 + run.interval) / 30.0)
    top = max(values.max() for values in warmth)
    mean = float(np.mean(np.concatenate(warmth))) / top
    # The baseline knows the friction of the mean warmth; cold friction is what it and the change imply.
    cold = VISCOUS[1] / (1 - 0.4 * mean)
    torque = [
        -0.4 * cold * run.motion.dq[:, 1] * values / top for run, values in zip(session.runs, warmth, strict=True)
    ]
    found = recover(find_effect("thermal_friction"), session, 1, torque)
    assert found["time_constant_s"].value == 30.0
    np.testing.assert_allclose(found["viscous_change"].value, -0.4, atol=0.01)
    np.testing.assert_allclose(found["coulomb_change"].value, 0.0, atol=0.01)


def test_measured_temperature_stands_in_for_the_heat(session: SessionContext, recover: Recover) -> None:
    """With a temperature no clock is needed, and no time constant is reported."""

    def warm(run: RunContext) -> RunContext:
        rise = 20.0 + 0.1 * run.motion.time[:, None] + np.zeros((1, run.n))
        return replace(run, temperature=rise)

    warmed = replace(edit_runs(session, warm), common_clock=False)
    torque = [0.8 * run.direction[:, 1] * (run.motion.time / warmed.runs[-1].motion.time[-1]) for run in warmed.runs]
    found = recover(find_effect("thermal_friction"), warmed, 1, torque)
    assert set(found) == {"viscous_change", "coulomb_change"}
    # 0.8 N m on top of a cold level of 8 − 0.8/2.
    np.testing.assert_allclose(found["coulomb_change"].value, 0.8 / 7.6, rtol=0.03)


def test_what_is_dry_friction_as_well_is_the_joints() -> None:
    """Law: nothing is lost; what is left adds up to the amplitude that is reported of all ranges; the longest ranges
    stay as they were; ranges that make a smooth build-up are all kept.
    """
    effect = find_effect("presliding_hysteresis")
    variant = Variant(shape={"range_0_rad": 0.0006, "range_1_rad": 0.002, "range_2_rad": 0.018})
    parts = np.array([3.0, 5.0, 9.0])
    kept, dry = effect.without_dry_friction(parts, variant)
    assert kept.sum() + dry == pytest.approx(17.0)
    sizes = np.array(list(variant.shape.values()))
    assert kept.sum() == pytest.approx((parts @ sizes) ** 2 / (2.0 / 3.0 * (parts @ sizes**2)))
    assert 0.0 < kept[0] < 3.0
    assert list(kept[1:]) == [5.0, 9.0]
    bend = Variant(shape={"range_0_rad": 0.006, "range_1_rad": 0.012, "range_2_rad": 0.018})
    whole, none = effect.without_dry_friction(np.array([1.0, 1.0, 1.0]), bend)
    np.testing.assert_array_equal(whole, 1.0)
    assert none == 0.0


def test_what_all_gears_bend_is_no_build_up_of_its_own() -> None:
    """Law: a build-up over less than the shortest range is that of any joint's contacts."""
    short, long = (Variant(shape={"range_0_rad": one, "range_1_rad": 3.0 * one}) for one in (0.002, 0.006))
    stands = find_effect("presliding_hysteresis").stands_for
    assert [stands(short, np.array(parts)) for parts in ([8.9, 1.0], [9.1, 1.0], [1.0, -1.0])] == [True, False, False]
    assert stands(long, np.array([9.0, 0.1]))


@pytest.mark.parametrize("turns", [37.3, 161.0])
def test_ripple_of_an_unknown_gear_is_found_over_the_angle(
    session: SessionContext, recover: Recover, turns: float
) -> None:
    """Law: 0.6 N m of ripple beside 1 N m of noise stands out at its cycles a turn, once refined to a tenth of what the
    joint's travel tells apart; noise alone shows no line.
    """
    effect, unknown, rng = find_effect("torque_ripple"), replace(session, gear_ratios=None), np.random.default_rng(0)
    for ratios in (None, np.ones(6)):  # URDFs hold a reduction of one where nobody knew it
        assert not effect.variants(replace(session, gear_ratios=ratios), 2)
    noise = [rng.normal(size=(run.motion.filtered_length, 6)) for run in session.runs]
    ripple = [0.6 * np.cos(turns * run.motion.q[:, 2] - 0.7) for run in session.runs]
    left = [one.copy() for one in noise]
    for run, values, torque in zip(session.runs, left, ripple, strict=True):
        values[:, 2] += run.motion.filtered(torque)
    assert not any(effect.screened(unknown, noise).lines)
    lines = [effect.screened(unknown, left).lines[j] for j in range(6)]
    assert [len(one) for one in lines] == [0, 0, 1, 0, 0, 0]
    low = min(run.motion.q[:, 2].min() for run in session.runs)
    high = max(run.motion.q[:, 2].max() for run in session.runs)
    screened = effect.screened(unknown, left)
    finer = screened.refined(unknown, 2, screened.variants(unknown, 2)[0])
    nearest = min(abs(one.inner["order"] - turns) for one in finer)
    assert nearest < 0.1 * 2 * np.pi / (high - low)
    found = recover(screened, unknown, 2, ripple)
    np.testing.assert_allclose(found["amplitude_Nm"].value, 0.6, rtol=0.15)


def test_a_gain_error_is_no_load_friction(session: SessionContext) -> None:
    """With coefficients that aren't negative, torque that scales with the load leaves most of itself unexplained."""
    effect = find_effect("load_dependent_friction")
    columns = np.concatenate(effect.columns(session, 1, effect.variants(session, 1)[0]))
    load = np.concatenate([run.link[:, 1] for run in session.runs])
    _, left = nnls(columns, load)
    assert left > 0.9 * np.linalg.norm(load)


def test_a_slide_need_not_go_as_far_in_metres_as_a_turn_in_radians() -> None:
    """Law: what is asked of travel is of a joint's kind: a tenth of a metre shows a spring, a few millimetres none."""
    arm, spring = sliding_arm(), find_effect("spring_torque")
    assert spring.untestable(make_session(arm, 5.0, 2, size=0.05), 1) is None
    assert "m; 0.02 are needed" in str(spring.untestable(make_session(arm, 5.0, 2, size=0.002), 1))


@pytest.mark.parametrize("seed", range(3))
def test_a_spring_has_its_rest_where_one_can_be(session: SessionContext, seed: int) -> None:
    """Law: a line is a spring where it crosses zero within the joint's range and half a turn; a level one never is."""
    rng, joint = np.random.default_rng(seed), 3
    spring = find_effect("spring_torque")
    straight = spring.variants(session, joint)[0]
    nothing = np.zeros((2, 2))
    seen = rng.uniform(-1.0, 1.0, size=100)
    slopes = np.abs(rng.normal(size=100))
    for slope, pull in zip(slopes, 10.0 * seen * slopes, strict=True):
        line = np.array([slope, pull])
        figures = spring.parameters(session, joint, straight, line, nothing)
        rest = spring.physical(session, joint, figures)["rest_rad"]
        inside = rest.low <= figures["rest_rad"].value <= rest.high
        assert stands_for(spring, straight, line) == inside
    assert not stands_for(spring, straight, np.array([0.0, 2.0]))
