"""Laws of motions: one filter for all, an even grid, and what is too short."""

from dataclasses import replace

import numpy as np
import pytest

from ident.errors import RecordingError
from ident.motion import stretches
from ident.motion.filter import Lowpass
from ident.motion.motion import Motion, prepare
from ident.motion.stretches import choose_runs, cut, hold, runs_recorded
from ident.recordings.recording import Recording, Session
from ident.sessions import load_robot
from tests.ident.diagnosis.planted import load_arm
from tests.ident.made_up import made_motions, two_joint_arm


def _run(time: np.ndarray, name: str = "run", effort: np.ndarray | None = None) -> Recording:
    """Two joints on known sines."""
    q = np.stack([np.sin(2 * time), 0.5 * np.cos(3 * time)], axis=1)
    noise = 1e-6 * np.random.default_rng(len(time)).standard_normal(q.shape)
    return Recording(name, ("a", "b"), time, q + noise, q * 10.0 if effort is None else effort)


@pytest.mark.parametrize("cutoff", [float("nan"), -1.0, -0.0, 1e-300, 50.1])
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
    """Positions at uneven times become states on an even grid: the true ones within 5.5 of the standard deviations that
    the smoother tells (about 2 µrad, 0.2 mrad/s, 0.03 rad/s²) at every sample.
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


def test_short_runs_are_left_out() -> None:
    """Runs under a second, of one sample too, do not stop the others and do not enter the noise levels."""
    long, rest = _run(0.01 * np.arange(500), "long"), _run(10 + 0.01 * np.arange(50), "short")
    single = _run(np.array([20.0]), "single")
    motions = prepare(Session("s", (long, rest, single)))
    assert [motion.name for motion in motions] == ["long"]
    assert np.array_equal(motions[0].dq, prepare(Session("s", (long,)))[0].dq)


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
    # Logged without noise it has no band either: its filter's reach is a number all the same.
    assert 1 <= motion.blurred[0] <= motion.blurred[1]


@pytest.fixture(scope="module")
def motions() -> tuple[Motion, ...]:
    """Six runs of 3 s at 100 Hz, one of them with temperatures."""
    arm = load_arm()
    made = made_motions(arm, arm.inverse_dynamics, range(6), 3.0, 100.0)
    made[2] = replace(made[2], temperature=30.0 + made[2].q)
    return tuple(made)


def test_a_short_session_is_held_whole(motions: tuple[Motion, ...]) -> None:
    """Law: up to the limit the motions are handed back themselves."""
    held = hold(iter(motions))
    assert all(one is other for one, other in zip(held.motions, motions, strict=True))
    assert (held.source, held.in_part) == (tuple(range(6)), False)


def test_pieces_of_a_long_run_make_it_up(motions: tuple[Motion, ...]) -> None:
    """Law: pieces, end to end, are the run; they are about equal, keep its clock, and count as one run."""
    motion = motions[2]
    pieces = list(cut(motion, 120))
    assert [len(piece.time) for piece in pieces] == pytest.approx([len(motion.time) / 3] * 3, abs=1)
    for name in ("time", "tau", "temperature"):
        assert np.array_equal(np.concatenate([getattr(piece, name) for piece in pieces]), getattr(motion, name))
    assert len({piece.name for piece in pieces}) == 3
    assert [piece.continues for piece in pieces] == [False, True, True]
    assert runs_recorded(pieces) == 1
    assert runs_recorded(motions) == 6


def test_stretches_come_from_all_over_a_long_session(
    motions: tuple[Motion, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Law: about as many samples as are held, in order, from every part; stretches of one run count as pieces of it."""
    monkeypatch.setattr(stretches, "STRETCH_SAMPLES", 30)
    length = len(motions[0].time)
    for most, runs in ((4 * length, 6), (2 * length, 5), (length // 2, 3)):
        held = hold(motions, most)
        assert held.in_part
        assert held.samples == 6 * length
        assert sum(len(one.time) for one in held.motions) == pytest.approx(most, abs=30)
        assert list(held.source) == sorted(held.source)
        assert len(set(held.source)) >= runs
        assert [one.continues for one in held.motions] == [
            a == b for a, b in zip(held.source, [-1, *held.source], strict=False)
        ]
        starts = [(number, one.time[0]) for number, one in zip(held.source, held.motions, strict=True)]
        assert starts == sorted(set(starts))
        for number, one in zip(held.source, held.motions, strict=True):
            whole = motions[number]
            assert np.array_equal(one.tau, whole.tau[np.searchsorted(whole.time, one.time)])
            assert (one.temperature is None) == (whole.temperature is None)
            assert not np.shares_memory(one.tau, whole.tau)


@pytest.mark.parametrize("every", [2, 3, 4, 8, 9, 27, 54])
@pytest.mark.parametrize("kinds", [2, 3, 5, 8, 11])
def test_all_kinds_of_motion_are_chosen(every: int, kinds: int) -> None:
    """Law: of a recording that goes through its kinds of motion in turn, every kind is among the chosen runs, and none
    has more than 2.5 times its part; whether the turn takes as many runs as a stretch, or any other number.
    """
    met = np.bincount(np.array(choose_runs(100 * every, every)) % kinds, minlength=kinds)
    assert met.min() > 0
    assert met.max() < 2.5 * 100 / kinds


def test_lowpass_has_no_phase() -> None:
    """A swing at a fifth of the corner passes without delay or loss (1e-3), one at four times is gone."""
    lowpass = Lowpass.design(250.0)
    assert (lowpass.cutoff, lowpass.factor) == (10.0, 6)
    time = np.arange(2500) / 250.0
    slow, fast = np.sin(2 * np.pi * 2.0 * time), np.sin(2 * np.pi * 40.0 * time)
    middle = slice(40, -40)
    assert np.allclose(lowpass(slow)[middle], slow[:: lowpass.factor][middle], atol=1e-3)
    assert np.abs(lowpass(fast)[middle]).max() < 1e-3


def test_lowpass_is_one_linear_map_for_torque_and_columns() -> None:
    """Filtering is linear: filtered columns times parameters = filtered product, on every shape, to 1e-12."""
    arm = two_joint_arm()
    motion = made_motions(arm, lambda q, dq, ddq: arm.inverse_dynamics(q, dq, ddq), [1], duration=4.0)[0]
    regressor = arm.regressor(motion.q, motion.dq, motion.ddq)
    product = motion.filtered(regressor) @ arm.inertial_parameters
    assert product.shape == motion.tau_filtered.shape
    assert np.allclose(product, motion.tau_filtered, atol=1e-10)
    pair = motion.filtered(np.stack([motion.ddq, motion.dq], axis=-1))
    assert np.allclose(pair[..., 1], motion.filtered(motion.dq), atol=1e-12)
