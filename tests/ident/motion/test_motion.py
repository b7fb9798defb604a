"""Laws of motions: one filter for all, an even grid, and what is too short."""

import numpy as np
import pytest

from ident.errors import RecordingError
from ident.model.loss import loss_columns
from ident.motion.motion import Lowpass, prepare
from ident.recordings.recording import Payload, Recording, Session
from ident.robot.arm import ArmModel
from ident.sessions import load_robot
from tests.ident.made_up import made_motions, two_joint_arm


def _run(time: np.ndarray, name: str = "run", effort: np.ndarray | None = None) -> Recording:
    """Two joints on known sines."""
    q = np.stack([np.sin(2 * time), 0.5 * np.cos(3 * time)], axis=1)
    noise = 1e-6 * np.random.default_rng(len(time)).standard_normal(q.shape)
    return Recording(name, ("a", "b"), time, q + noise, q * 10.0 if effort is None else effort)


def test_lowpass_is_one_linear_map_for_torque_and_columns() -> None:
    """Filtering is linear: filtered columns times figures = filtered product, on every shape, to 1e-12."""
    arm = two_joint_arm()
    motion = made_motions(arm, lambda q, dq, ddq: arm.inverse_dynamics(q, dq, ddq), [1], duration=4.0)[0]
    regressor = arm.regressor(motion.q, motion.dq, motion.ddq)
    product = motion.filtered(regressor) @ arm.inertial_parameters
    assert product.shape == motion.tau_filtered.shape
    assert np.allclose(product, motion.tau_filtered, atol=1e-10)
    columns = loss_columns(motion, np.full(2, 0.01))
    assert np.allclose(columns[..., 1], motion.filtered(motion.dq), atol=1e-12)


def test_lowpass_has_no_phase() -> None:
    """A swing at a fifth of the corner passes without delay or loss (1e-3), one at four times is gone."""
    lowpass = Lowpass.design(250.0)
    assert (lowpass.cutoff, lowpass.factor) == (10.0, 6)
    time = np.arange(2500) / 250.0
    slow, fast = np.sin(2 * np.pi * 2.0 * time), np.sin(2 * np.pi * 40.0 * time)
    middle = slice(40, -40)
    assert np.allclose(lowpass(slow)[middle], slow[:: lowpass.factor][middle], atol=1e-3)
    assert np.abs(lowpass(fast)[middle]).max() < 1e-3


@pytest.mark.parametrize(
    ("rate", "cutoff", "expected"), [(30.0, None, 6.0), (125.0, None, 10.0), (1000.0, 25.0, 25.0), (30.0, 25.0, 6.0)]
)
def test_corner_stays_below_a_fifth_of_the_rate(rate: float, cutoff: float | None, expected: float) -> None:
    """At least four samples a period of the corner are kept, whatever the log rate."""
    lowpass = Lowpass.design(rate, cutoff)
    assert lowpass.cutoff == expected
    assert rate / lowpass.factor >= 4 * lowpass.cutoff


@pytest.mark.parametrize("cutoff", [float("nan"), -1.0, -0.0, 1e-300])
def test_a_corner_that_is_no_frequency_is_told(cutoff: float) -> None:
    with pytest.raises(RecordingError, match="--cutoff"):
        Lowpass.design(250.0, cutoff)


def test_no_robot_at_all_is_told() -> None:
    """Law: where neither an option nor a recording names one; an empty name is none."""
    for robot in (None, ""):
        with pytest.raises(RecordingError, match="no robot is named"):
            load_robot(robot, ())


@pytest.mark.parametrize("jitter", [0.0, 0.35], ids=["even", "jittered"])
def test_a_known_motion_is_reproduced_on_an_even_grid(jitter: float) -> None:
    """Positions at uneven times become states on an even grid: the true ones within 5.5 of the standard

    deviations that the smoother tells (about 2 µrad, 0.2 mrad/s, 0.03 rad/s²) at every sample.
    """
    rng = np.random.default_rng(1)
    time = 0.01 * (np.arange(1500) + jitter * rng.uniform(-1, 1, 1500))
    motion = prepare(Session("s", (_run(time),)))[0]
    assert np.allclose(np.diff(motion.time), motion.interval, atol=1e-9)
    t, middle = motion.time, slice(30, -30)
    truth = (
        np.stack([np.sin(2 * t), 0.5 * np.cos(3 * t)], axis=1),
        np.stack([2 * np.cos(2 * t), -1.5 * np.sin(3 * t)], axis=1),
        np.stack([-4 * np.sin(2 * t), -4.5 * np.cos(3 * t)], axis=1),
    )
    for values, expected, std in zip((motion.q, motion.dq, motion.ddq), truth, motion.std, strict=True):
        assert np.abs((values - expected) / std)[middle].max() < 5.5
    assert motion.std[:, 0].tolist() == pytest.approx([2e-6, 2e-4, 0.03], rel=0.5)
    assert np.allclose(motion.tau[middle], 10 * truth[0][middle], atol=5e-3)  # linear between samples


def test_resampling_bridges_missing_samples_with_a_quintic() -> None:
    """A fifth of the samples lost at random: the states stay true to 1e-4 rad, 5e-3 rad/s."""
    rng = np.random.default_rng(2)
    keep = np.sort(rng.permutation(1500)[:1200])
    time = 0.008 * np.arange(1500)[keep]
    motion = prepare(Session("s", (_run(time),)))[0]
    middle = slice(40, -40)
    assert np.allclose(motion.q[middle, 0], np.sin(2 * motion.time[middle]), atol=1e-4)
    assert np.allclose(motion.dq[middle, 0], 2 * np.cos(2 * motion.time[middle]), atol=5e-3)


def test_short_runs_are_left_out() -> None:
    """Runs under a second, of one sample too, do not stop the others and do not enter the noise levels."""
    long, rest = _run(0.01 * np.arange(500), "long"), _run(10 + 0.01 * np.arange(50), "short")
    single = _run(np.array([20.0]), "single")
    motions = prepare(Session("s", (long, rest, single)))
    assert [motion.name for motion in motions] == ["long"]
    alone = prepare(Session("s", (long,)))[0]
    assert np.array_equal(motions[0].dq, alone.dq)


@pytest.mark.parametrize("samples", [1, 2, 50])
def test_nothing_long_enough_is_refused(samples: int) -> None:
    """A session of short runs only is refused with its place and what to record."""
    with pytest.raises(RecordingError, match=r"s: no run lasts 1 s; record longer motions"):
        prepare(Session("s", (_run(0.01 * np.arange(samples)),)))


def test_moving_is_where_the_speed_is_sure() -> None:
    """A joint at rest nowhere moves; a swinging one nearly always does."""
    time = 0.01 * np.arange(1000)
    q = np.stack([np.sin(2 * time), np.full(1000, 0.3)], axis=1)
    motion = prepare(Session("s", (Recording("r", ("a", "b"), time, q, q),)))[0]
    assert motion.moving.shape == motion.tau_filtered.shape
    assert motion.moving[:, 0].mean() > 0.95
    assert not motion.moving[:, 1].any()


def test_selected_joints_keep_their_columns() -> None:
    """`select` is the same run of fewer joints, in the order asked for."""
    arm = ArmModel.load("tm5-900")
    payload = Payload(1.0)
    motion = made_motions(arm, lambda q, dq, ddq: q + 2 * dq, [1], duration=2.0, payload=payload)[0]
    part = motion.select(("joint_5", "joint_2"))
    assert part.joints == ("joint_5", "joint_2")
    assert np.array_equal(part.tau, motion.tau[:, [4, 1]])
    assert np.array_equal(part.std, motion.std[:, [4, 1]])
    assert part.payload == payload
