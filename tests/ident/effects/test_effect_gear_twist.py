"""Elastic joints and play, against two bodies simulated step by step."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from scipy.interpolate import CubicSpline
from smooth_motion import make_session

from ident.effects.base import RunContext, SessionContext
from ident.effects.catalogue import find_effect
from ident.effects.gear import deflect, felt_torque
from ident.robot.arm import ArmModel

SUBSTEPS = 8


def simulate_link(run: RunContext, joint: int, gear: Callable[[float, float], float], start: float) -> np.ndarray:
    """Torque of all joints when one drives its link through a gear; the motors follow the recorded motion.

    `gear` gives the torque from twist and its rate (motor less link); `start` is the first twist.
    """
    time, step = run.motion.time, run.interval / SUBSTEPS
    fine = time[0] + step * np.arange((len(time) - 1) * SUBSTEPS + 1)
    q, dq, ddq = (CubicSpline(time, values)(fine) for values in (run.motion.q, run.motion.dq, run.motion.ddq))
    place, speed = q[0, joint] - start, dq[0, joint]
    torque, data = np.empty_like(q), run.arm.model.createData()
    for k in range(len(fine)):
        state = q[k].copy(), dq[k].copy(), ddq[k].copy()
        gear_torque = gear(q[k, joint] - place, dq[k, joint] - speed)
        state[0][joint], state[1][joint] = place, speed
        state[2][joint] = 0.0
        still = pin.rnea(run.arm.model, data, *state).copy()
        state[2][joint] = 1.0
        pushed = pin.rnea(run.arm.model, data, *state).copy()
        acceleration = (gear_torque - still[joint]) / (pushed[joint] - still[joint])
        torque[k] = still + (pushed - still) * acceleration
        speed += step * acceleration
        place += step * speed
    # What a drive logs at a sample is the mean around it.
    kernel = np.ones(SUBSTEPS + 1) / (SUBSTEPS + 1)
    padded = np.pad(torque, ((SUBSTEPS // 2, SUBSTEPS // 2), (0, 0)), mode="edge")
    return np.stack([np.convolve(column, kernel, "valid")[::SUBSTEPS] for column in padded.T], axis=1)


@pytest.fixture(scope="module")
def short(arm: ArmModel) -> SessionContext:
    """Six seconds: the reference is slow."""
    return make_session(arm, seconds=6.0, runs=1)


def explained(run: RunContext, column: np.ndarray, torque: np.ndarray) -> tuple[float, float]:
    """Coefficient of one column, and the share of the torque's mean square that it explains."""
    x, y = run.motion.filtered(column).ravel(), run.motion.filtered(torque).ravel()
    coefficient = float(x @ y / (x @ x))
    return coefficient, 1.0 - float(np.sum((y - coefficient * x) ** 2) / (y @ y))


@pytest.mark.parametrize("stiffness", [5e3, 9e3])
def test_an_elastic_joint_is_found_with_its_stiffness(short: SessionContext, stiffness: float) -> None:
    """Near the arm's resonance at 5 to 7 Hz, on and between the points of the grid."""
    run, effect = short.runs[0], find_effect("joint_elasticity")
    start = float(run.link[0, 1]) / stiffness
    torque = simulate_link(run, 1, lambda twist, rate: stiffness * twist + 40.0 * rate, start) - run.rigid
    fits = []
    for variant in effect.variants(short, 1):
        coefficient, share = explained(run, effect.columns(short, 1, variant)[0][:, :, 0], torque)
        figures = effect.parameters(short, 1, variant, np.array([coefficient]), np.array([[1e-12]]))
        fits.append((share, figures["stiffness_Nm_rad"].value))
    share, found = max(fits)
    assert share > 0.95
    np.testing.assert_allclose(found, stiffness, rtol=0.05)


def test_a_law_that_swings_up_without_bound_says_nothing(short: SessionContext) -> None:
    """Velocity torques that feed a swing faster than the gear damps it leave no deflection, and no overflow."""
    run = replace(short.runs[0])
    position, velocity, inertia = run.derivatives
    run.__dict__["derivatives"] = position, velocity - 400.0 * np.eye(run.n), inertia
    for gap in (0.0, 0.004):
        twist, rate = deflect(run, 1, 9e3, 10.0, gap)
        assert not twist.any()
        assert not rate.any()


def knocking(run: RunContext, gap: float) -> np.ndarray:
    """What play of joint 3 adds to the torque of all joints, simulated with stops that hardly rebound."""
    stiffness, damping = 2.4e4, 300.0

    def through(width: float) -> np.ndarray:
        def gear(twist: float, rate: float) -> float:
            depth = abs(twist) - width / 2
            push = np.sign(twist) * stiffness * depth + damping * rate
            return float(push) if depth > 0 and push * twist > 0 else 0.0

        load = float(run.link[0, 2])
        return simulate_link(run, 2, gear, load / stiffness + np.sign(load) * width / 2)

    return through(gap) - through(0.0)


def test_play_is_found_with_its_width(short: SessionContext) -> None:
    """Two millimetres a metre of play in joint 3; what the stops' stiffness does is left out."""
    run, effect, gap = short.runs[0], find_effect("backlash"), 0.002
    torque = knocking(run, gap)
    fits = [explained(run, effect.columns(short, 2, v)[0][:, :, 0], torque) for v in effect.variants(short, 2)]
    found, share = max(fits, key=lambda fit: fit[1])
    assert share > 0.6
    np.testing.assert_allclose(found, gap, rtol=0.3)


@pytest.mark.parametrize("gap", [0.011, 0.027])
def test_wide_play_is_looked_for_at_every_width(short: SessionContext, gap: float) -> None:
    """The longer the fall, the less one width looks like another: between the points of the grid, too, one is near."""
    run = short.runs[0]
    torque = knocking(run, gap)
    effect = find_effect("backlash").screened(short, [run.motion.filtered(torque)])
    variants = [variant for variant in effect.variants(short, 2) if variant.inner]
    assert min(abs(np.log(variant.inner["gap_rad"] / gap)) for variant in variants) < np.log(1.15)
    fine = [finer for variant in variants for finer in effect.refined(short, 2, variant)]
    fits = [
        (explained(run, effect.columns(short, 2, one)[0][:, :, 0], torque)[1], one.inner["gap_rad"]) for one in fine
    ]
    share, found = max(fits)
    assert share > 0.6
    np.testing.assert_allclose(found, gap, rtol=0.1)


def test_play_shows_only_where_the_load_changes_sign(session: SessionContext) -> None:
    """Away from zero load its columns die out; a joint whose load keeps its sign says so."""
    effect = find_effect("backlash")
    run = session.runs[0]
    column = np.abs(run.motion.filtered(effect.columns(session, 1, effect.variants(session, 1)[0])[0])[:, 1, 0])
    load = run.motion.filtered(np.abs(run.link[:, 1]))
    assert column[load < 2.0].mean() > 5 * column[load > 30.0].mean()

    def pressed(context: RunContext) -> RunContext:
        link = np.abs(context.link) + 1.0
        return RunContext(context.motion, context.arm, context.rigid, link, context.friction, context.direction)

    one_sided = SessionContext(
        tuple(pressed(r) for r in session.runs), True, session.joint_names, None, session.rated_torque
    )
    assert "never changes sign" in str(effect.untestable(one_sided, 1))


def test_an_elastic_joint_at_rest_shows_gravity_only(arm: ArmModel) -> None:
    """Standing still, the link lies lower by load / K, and gravity's torque is that of this angle."""
    session = make_session(arm, seconds=2.0, runs=1, size=0.0)
    run, effect = session.runs[0], find_effect("joint_elasticity")
    variant = effect.variants(session, 1)[0]
    stiffness = variant.shape["stiffness_Nm_rad"]
    q = run.motion.q[:1].copy()
    for _ in range(20):
        q[:, 1] = run.motion.q[:1, 1] - arm.gravity(q)[:, 1] / stiffness
    change = arm.gravity(q)[0] - run.rigid[0]
    np.testing.assert_allclose(effect.columns(session, 1, variant)[0][-1, :, 0] / stiffness, change, atol=2e-3)


def test_every_joint_feels_an_elastic_one(short: SessionContext) -> None:
    """The pattern over the joints is that of the mass matrix: it is not the twisted joint's torque alone."""
    effect = find_effect("joint_elasticity")
    column = effect.columns(short, 1, effect.variants(short, 1)[-1])[0][:, :, 0]
    size = np.sqrt(np.mean(column**2, axis=0))
    assert np.all(size[:3] > 0.1 * size[1])


def test_what_is_felt_of_a_deflection_is_the_link_s_own_law(short: SessionContext) -> None:
    """Law: −(M δ'' + V δ' + P δ) with the whole column of each derivative, of all joints or some, in any unit."""
    run = short.runs[0]
    twist, rate = 1e-3 * np.random.default_rng(2).normal(size=(2, len(run.motion.time)))
    position, velocity, inertia = (part[:, :, 1] for part in run.derivatives)
    change = np.gradient(rate, run.interval)
    expected = -(inertia * change[:, None] + velocity * rate[:, None] + position * twist[:, None])
    assert np.allclose(felt_torque(run, 1, twist, rate), expected, rtol=1e-13)
    assert np.allclose(felt_torque(run, 1, twist, rate, slice(1, 3), 0.004), expected[:, 1:3] / 0.004, rtol=1e-13)
