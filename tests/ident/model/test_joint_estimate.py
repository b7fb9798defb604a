"""Laws of the joint estimate and of its intervals.

Effort without friction: rows near reversals count, losses are zero; and never where a joint has friction.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from ident.arrays import Array
from ident.command_options import FitOptions
from ident.errors import RecordingError
from ident.fitting.fit_sums import FitSums
from ident.fitting.identification import Identified, identify
from ident.fitting.in_words import describe
from ident.model.bodies import solve_bounded
from ident.model.inertia import base_parameters
from ident.model.loss import NAMES
from ident.motion.motion import Motion
from ident.regression.settings import USUAL_REGRESSION
from ident.robot.arm import ArmModel
from ident.robot.tolerance import parameter_scale
from tests.ident.made_up import exact_motion, made_motions, multisine

TRUTH = np.array([[0.6, 10.0, 8.0], [0.8, 6.0, 5.0]])  # rotor inertia, viscous, Coulomb of each joint
RATE = 100.0


def _measured(arm: ArmModel, seed: int, runs: int = 8, spread: float = 0.0, seconds: float = 12.0) -> list[Motion]:
    """Runs whose friction changes by a share from run to run, under coloured noise of 0.3 N m."""
    rng, motions = np.random.default_rng(seed), []
    time = np.arange(int(seconds * RATE)) / RATE
    for k in range(runs):
        q, dq, ddq = multisine(rng, time, 2)
        change = 1.0 + spread * rng.standard_normal((2, 2))
        friction = TRUTH[:, 1] * change[:, 0] * dq + TRUTH[:, 2] * change[:, 1] * np.sign(dq)
        noise = 0.3 * np.sqrt(1 - 0.9**2) * lfilter([1.0], [1.0, -0.9], rng.standard_normal(dq.shape), axis=0)
        tau = arm.inverse_dynamics(q, dq, ddq) + TRUTH[:, 0] * ddq + friction + noise
        motions.append(exact_motion(time, (q, dq, ddq), tau, arm.joint_names, f"run_{k}"))
    return motions


def identified(motions: list[Motion], nominal: ArmModel, options: FitOptions | None = None) -> Identified:
    """What a fit of runs identifies."""
    return identify(FitSums.gather(motions, nominal, options or FitOptions()))


def _inside(found: Identified) -> Array:
    low, high = np.moveaxis(found.loss.conf_int()[:, :3], -1, 0)
    return np.asarray((low <= TRUTH) & (high >= TRUTH))


def test_intervals_hold_the_truth_when_friction_changes_from_run_to_run(two_joints: ArmModel) -> None:
    """Of 16 arms, 95 % of the friction figures or more lie in their intervals, and the spread itself is found.

    Of four figures nothing proves that friction did not wander: the intervals allow for that, within bounds.
    """
    inside, spreads, widths = [], [], []
    for seed in range(16):
        found = identified(_measured(two_joints, seed, spread=0.02), two_joints, FitOptions())
        inside.append(_inside(found))
        spreads.append(found.estimate.spread)
        widths.append(np.diff(found.loss.conf_int()[:, 1:3], axis=-1)[..., 0] / TRUTH[:, 1:])
    assert np.mean(inside) >= 0.90
    assert np.median(widths) < 2 * 2.0 * 0.02 * 2.0 / np.sqrt(8.0)  # twice what independent changes alone would leave
    assert np.median(spreads) == pytest.approx(0.02, abs=0.007)


def test_a_wrong_urdf_is_measured_and_widens_what_rests_on_it(two_joints: ArmModel) -> None:
    """Link numbers 5 % off: told as such; held inertias then leave wide intervals that hold the truth."""
    rng = np.random.default_rng(4)
    scale = parameter_scale(two_joints)
    links = two_joints.inertial_parameters + 0.05 * scale * rng.standard_normal(len(scale))
    nearest = solve_bounded(np.eye(len(scale)), np.zeros(len(scale)), (), links, scale)
    real = two_joints.with_inertial_parameters(links + scale * nearest)
    right = identified(_measured(two_joints, 5), two_joints, FitOptions(inertia="nominal"))
    wrong = identified(_measured(real, 5), two_joints, FitOptions(inertia="nominal"))
    assert right.urdf_share < 0.01 < 0.02 < wrong.urdf_share < 0.12
    widths = [np.diff(found.loss.conf_int()[:, 0], axis=-1).mean() for found in (right, wrong)]
    assert widths[1] > 3 * widths[0]
    assert _inside(wrong).all()


def test_inertias_have_intervals_that_hold_them(two_joints: ArmModel) -> None:
    """Base parameters of a changed arm lie in their intervals; what only acts as a sum is told as tied."""
    real = two_joints.with_inertial_parameters(1.1 * two_joints.inertial_parameters)
    found = identified(_measured(real, 6), two_joints, FitOptions(inertia="base"))
    true = base_parameters(two_joints).mapping @ real.inertial_parameters
    inside = [f.low <= value <= f.high for f, value in zip(found.inertias, true, strict=True)]
    assert np.mean(inside) >= 0.8
    # Rotor 1 turns about the same axis as link 1: only their sum acts.
    assert any("joint_1.motor_inertia" in (one, other) for one, other, _ in found.tied)


def test_a_urdf_that_is_right_narrows_what_rests_on_it(two_joints: ArmModel) -> None:
    """Intervals of base parameters are as wide as this URDF is off, not as any URDF may be; all hold the truth."""
    scale = parameter_scale(two_joints)
    off = two_joints.inertial_parameters * (1.0 + 0.15 * np.resize([1.0, -1.0], 10).repeat(2))
    widths = []
    for real in (two_joints, two_joints.with_inertial_parameters(off)):
        found = identified(_measured(real, 9), two_joints, FitOptions(inertia="base"))
        true = base_parameters(two_joints).mapping @ real.inertial_parameters
        size = np.abs(base_parameters(two_joints).mapping) @ scale
        assert np.mean([f.low <= value <= f.high for f, value in zip(found.inertias, true, strict=True)]) >= 0.8
        widths.append(np.mean([f.high - f.low for f in found.inertias] / size))
    assert widths[0] < 0.7 * widths[1]


def test_losses_are_never_negative(two_joints: ArmModel) -> None:
    """A joint whose torque asks for less than no friction gets none, and is said to be on its bound."""
    motions = [replace(m, tau=m.tau - (TRUTH[:, 2] + 1.0) * np.sign(m.dq)) for m in _measured(two_joints, 8, runs=3)]
    for mode in ("nominal", "base", "consistent"):
        loss = identified(motions, two_joints, FitOptions(inertia=mode)).loss  # type: ignore[arg-type]
        assert np.all(loss.params.coulomb >= -1e-6)
        assert all("coulomb" in names for names in loss.at_bound)


def test_one_run_is_enough_for_figures(two_joints: ArmModel) -> None:
    """Of one run nothing is known of repeats: the intervals allow for the usual ones, and the figures are there."""
    found = identified(_measured(two_joints, 10, runs=1, seconds=30.0), two_joints, FitOptions())
    assert np.allclose(found.loss.params.coulomb, TRUTH[:, 2], rtol=0.05)
    limits = found.loss.conf_int()
    assert np.all(np.isfinite(limits))
    assert np.all(np.diff(limits[:, 1:3])[..., 0] > 2 * USUAL_REGRESSION.usual_spread * TRUTH[:, 1:])
    for seed in range(3):
        assert _inside(
            identified(
                _measured(two_joints, 30 + seed, runs=1, seconds=30.0, spread=0.01),
                two_joints,
                FitOptions(inertia="base"),
            )
        ).all()


def test_a_joint_that_never_moves_is_refused_by_name(two_joints: ArmModel) -> None:
    """Its losses can't be known: the error names the joint and what to do."""
    resting = []
    for motion in _measured(two_joints, 11, runs=2):
        states = tuple(values * [1.0, 0.0] for values in (motion.q, motion.dq, motion.ddq))
        resting.append(exact_motion(motion.time, states, motion.tau, motion.joints))  # type: ignore[arg-type]
    with pytest.raises(RecordingError, match=r"joint_2 hardly moves.*lock it"):
        identified(resting, two_joints, FitOptions(inertia="base"))


def test_robust_weights_let_a_bad_stretch_go(two_joints: ArmModel) -> None:
    """A stretch with foreign torque pulls the plain estimate, and the robust one less."""
    motions = _measured(two_joints, 12)
    tau = np.array(motions[0].tau)
    tau[300:450] += 60.0 * np.sign(motions[0].dq[300:450])
    spoilt = [replace(motions[0], tau=tau), *motions[1:]]
    errors = []
    for robust in (False, True):
        params = identified(spoilt, two_joints, FitOptions(inertia="nominal", robust=robust)).loss.params
        errors.append(np.abs(np.stack([getattr(params, name) for name in NAMES[:3]], 1) - TRUTH)[:, 2].max())
    assert errors[1] < 0.5 * errors[0]


def test_a_wider_level_has_a_wider_interval_about_the_same_estimate(two_joints: ArmModel) -> None:
    """And the summary has a row for each parameter that was fitted: joint, name, value, interval, unit."""
    loss = identified(_measured(two_joints, 3, runs=3), two_joints, FitOptions(inertia="base")).loss
    narrow, wide = loss.conf_int(0.95)[:, :3], loss.conf_int(0.99)[:, :3]
    assert np.all(wide[..., 0] < narrow[..., 0])
    assert np.all(narrow[..., 1] < wide[..., 1])
    values = np.stack([getattr(loss.params, name) for name in NAMES[:3]], axis=1)
    assert np.allclose(narrow.mean(axis=-1), wide.mean(axis=-1))
    assert np.all((narrow[..., 0] <= values) & (values <= narrow[..., 1]))
    lines = loss.summary().splitlines()
    assert len(lines) == 1 + 2 * 3
    assert "95 % interval" in lines[0]
    assert lines[6].split()[:3] == ["joint_2", "dry", "friction"]
    assert lines[6].endswith("N m")
    assert float(lines[6].split()[3]) == pytest.approx(values[1, 2], rel=1e-3)


NOISE_NM = np.array([2.0, 1.0])


def drawn(arm: ArmModel, coulomb: tuple[float, float], seeds: list[int]) -> list[Motion]:
    """Runs of an arm that is heavier than its drawing, with noise in its torque."""
    rng = np.random.default_rng([7, *seeds])
    true = arm.with_inertial_parameters(1.2 * arm.inertial_parameters)

    def law(q: Array, dq: Array, ddq: Array) -> Array:
        dry = np.array(coulomb) * np.sign(dq)
        return true.inverse_dynamics(q, dq, ddq) + dry + NOISE_NM * rng.standard_normal(q.shape)

    return list(made_motions(arm, law, seeds, duration=12.0))


def error(found: Identified, arm: ArmModel, test: list[Motion]) -> float:
    """Error of the torque against the truth without noise [N m]."""
    true = arm.with_inertial_parameters(1.2 * arm.inertial_parameters)
    losses = found.loss.params
    off = []
    for motion in test:
        states = (motion.q, motion.dq, motion.ddq)
        rigid = found.inertia.arm.inverse_dynamics(*states) - true.inverse_dynamics(*states)
        dry = losses.coulomb * np.sign(motion.dq)
        off.append(rigid + losses.motor_inertia * motion.ddq + losses.viscous * motion.dq + dry)
    return float(np.sqrt(np.mean(np.concatenate(off) ** 2)))


def test_torque_at_the_link_has_no_losses(two_joints: ArmModel, monkeypatch: pytest.MonkeyPatch) -> None:
    """Law: they are exactly zero, that is reported, and the torque is nearer to the truth than with friction sought."""
    test, errors = drawn(two_joints, (0.0, 0.0), [90]), []
    for seed in range(1, 7):
        train = drawn(two_joints, (0.0, 0.0), [seed])
        found = identified(train, two_joints)
        assert found.lossless == two_joints.joint_names
        params = found.loss.params
        assert np.all(np.stack([params.motor_inertia, params.viscous, params.coulomb]) < 1e-9)
        assert "torque at the link" in "\n".join(describe(found))
        with monkeypatch.context() as patch:
            patch.setattr(
                "ident.fitting.identification.find_frictionless", lambda found, n, again: (np.zeros(n, bool), found)
            )
            sought = identified(train, two_joints)
        errors.append([error(one, two_joints, test) for one in (found, sought)])
    known, unknown = np.sqrt(np.mean(np.square(errors), axis=0))
    assert known < 0.95 * unknown


@pytest.mark.parametrize("coulomb", [(8.0, 0.0), (0.0, 4.0), (8.0, 4.0)])
def test_where_one_joint_has_friction_none_is_without(two_joints: ArmModel, coulomb: tuple[float, float]) -> None:
    """Law: effort is of one kind at all joints; then nothing changes."""
    found = identified(drawn(two_joints, coulomb, [1]), two_joints, FitOptions())
    assert found.lossless == ()
    assert found.loss.params.coulomb == pytest.approx(coulomb, abs=0.6)
