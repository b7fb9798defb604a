"""Laws of motions: one filter for all, an even grid, and what is too short."""

from dataclasses import replace

import numpy as np
import pytest

from ident.errors import InputError, RecordingError
from ident.model.linearisation import loss_columns
from ident.motion import out_of_core as spooling
from ident.motion.filter import Lowpass
from ident.motion.motion import Motion, prepare
from ident.motion.out_of_core import (
    CHANNELS,
    SpooledArrays,
    SpooledMotions,
    choose_runs,
    choose_stretches,
    cut,
    few,
    hold,
    runs_recorded,
)
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


def test_arrays_of_any_shape_come_back() -> None:
    """Law: entry by entry, from either end and in slices, what was written last; others in one file stay."""
    arrays = [np.random.default_rng(k).normal(size=shape) for k, shape in enumerate([(5,), (2, 3), (0, 4), (7, 1, 2)])]
    spooled = SpooledArrays()
    for k, array in enumerate(arrays):
        spooled.append(array)
        assert np.array_equal(spooled[k], array)
    assert all(np.array_equal(one, array) for one, array in zip(spooled, arrays, strict=True))
    assert np.array_equal(spooled[-1], arrays[-1])
    assert [one.shape for one in spooled[::2]] == [(5,), (0, 4)]
    assert not spooled[0].flags.writeable
    with pytest.raises(IndexError):
        spooled[4]
    other = SpooledArrays(arrays, beside=spooled)
    other[0], other[1] = np.arange(9.0), np.zeros((2, 3))
    assert [one.sum() for one in other] == [36.0, 0.0, 0.0, arrays[3].sum()]
    assert all(np.array_equal(one, array) for one, array in zip(spooled, arrays, strict=True))


def test_motions_come_back(motions: tuple[Motion, ...]) -> None:
    """Law: a spooled motion is the one that was spooled, in all its signals and all else; what it lacked it lacks."""
    for spooled, motion in zip(SpooledMotions(motions), motions, strict=True):
        assert (spooled.name, spooled.joints, spooled.lowpass) == (motion.name, motion.joints, motion.lowpass)
        for name in CHANNELS:
            one, other = getattr(spooled, name), getattr(motion, name)
            assert (one is None) == (other is None)
            assert one is None or np.array_equal(one, other)
        assert np.array_equal(spooled.settled, motion.settled)


def test_short_sessions_stay_in_memory(motions: tuple[Motion, ...], monkeypatch: pytest.MonkeyPatch) -> None:
    """Law: up to the limit the motions are handed back themselves; beyond it they are spooled, all of them."""
    assert all(one is other for one, other in zip(hold(iter(motions)), motions, strict=True))
    monkeypatch.setattr(spooling, "HELD_SAMPLES", 2 * len(motions[0].time))
    assert isinstance(hold(motions[:2]), tuple)
    spooled = hold(motions)
    assert isinstance(spooled, SpooledMotions)
    assert [one.name for one in spooled] == [one.name for one in motions]
    assert [one.name for one in few(spooled)] == [motions[k].name for k in choose_runs(6, 3)]
    assert few(motions) is motions


def test_pieces_of_a_long_run_make_it_up(motions: tuple[Motion, ...], monkeypatch: pytest.MonkeyPatch) -> None:
    """Law: pieces, end to end, are the run; they are about equal, keep its clock, and count as one run."""
    motion = motions[2]
    pieces = list(cut(motion, 120))
    assert [len(piece.time) for piece in pieces] == pytest.approx([len(motion.time) / 3] * 3, abs=1)
    for name in ("time", "tau", "temperature"):
        assert np.array_equal(np.concatenate([getattr(piece, name) for piece in pieces]), getattr(motion, name))
    assert len({piece.name for piece in pieces}) == 3
    assert [piece.continues for piece in pieces] == [False, True, True]
    monkeypatch.setattr(spooling, "PIECE_SAMPLES", 120)
    spooled = SpooledMotions(motions)
    assert (len(spooled), runs_recorded(spooled)) == (18, 6)
    assert sum(not piece.continues for piece in spooled) == 6
    assert runs_recorded(motions) == 6


def test_stretches_come_from_all_over_a_long_session(
    motions: tuple[Motion, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Law: about as many samples as are held, in order, from every part; stretches of one run count as pieces of it.

    What is held in memory is handed back whole.
    """
    assert choose_stretches(motions) == motions
    monkeypatch.setattr(spooling, "STRETCH_SAMPLES", 30)
    length = len(motions[0].time)
    for most, runs in ((2 * length, 6), (length // 2, 3)):
        chosen = choose_stretches(SpooledMotions(motions, most))
        assert sum(len(one.time) for one in chosen) == pytest.approx(most, rel=0.15)
        starts = [(one.name.split(" (")[0], one.time[0]) for one in chosen]
        assert starts == sorted(starts)
        names = [name for name, _ in starts]
        assert len(set(names)) >= runs
        assert [one.continues for one in chosen] == [
            name == last for name, last in zip(names, ["", *names], strict=False)
        ]
        for one in chosen:
            of = next(motion for motion in motions if one.name.startswith(motion.name))
            at = np.searchsorted(of.time, one.time)
            assert np.array_equal(one.tau, of.tau[at])
            assert (one.temperature is None) == (of.temperature is None)


@pytest.mark.parametrize("every", [2, 3, 4, 8, 9, 27, 54])
@pytest.mark.parametrize("kinds", [2, 3, 5, 8, 11])
def test_all_kinds_of_motion_are_chosen(every: int, kinds: int) -> None:
    """Law: of a recording that goes through its kinds of motion in turn, every kind is among the chosen runs, and none
    has more than 2.5 times its part; whether the turn takes as many runs as a stretch, or any other number.
    """
    met = np.bincount(np.array(choose_runs(100 * every, every)) % kinds, minlength=kinds)
    assert met.min() > 0
    assert met.max() < 2.5 * 100 / kinds


def test_full_disk_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """Law: where the disk of temporary files is full, one line says where and what helps."""

    class Full:
        def seek(self, place: int, whence: int = 0) -> None:
            raise OSError(28, "No space left on device")

    spooled = SpooledArrays()
    monkeypatch.setattr(spooled, "_file", Full())
    with pytest.raises(InputError, match="No space left on device; free some space there"):
        spooled.append(np.zeros(3))


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
    columns = loss_columns(motion, np.full(2, 0.01))
    assert np.allclose(columns[..., 1], motion.filtered(motion.dq), atol=1e-12)
