"""What waits on disk comes back as it went, a run at a time."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from ident.errors import InputError
from ident.motion import out_of_core as spooling
from ident.motion.motion import Motion
from ident.motion.out_of_core import CHANNELS, SpooledArrays, SpooledMotions, choose_runs, cut, few, hold, runs_recorded
from tests.ident.diagnosis.planted import load_arm
from tests.ident.made_up import made_motions


@pytest.fixture(scope="module")
def motions() -> tuple[Motion, ...]:
    """Six runs of 3 s at 100 Hz, one of them with temperatures."""
    arm = load_arm()
    made = made_motions(arm, arm.inverse_dynamics, range(6), 3.0, 100.0)
    made[2] = replace(made[2], temperature=30.0 + made[2].q)
    return tuple(made)


def test_arrays_of_any_shape_come_back() -> None:
    """Law: entry by entry, from either end and in slices, the numbers are those that went; nothing can write them."""
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
    held = hold(iter(motions))
    assert all(one is other for one, other in zip(held, motions, strict=True))
    monkeypatch.setattr(spooling, "HELD_SAMPLES", 2 * len(motions[0].time))
    assert isinstance(hold(motions[:2]), tuple)
    spooled = hold(motions)
    assert isinstance(spooled, SpooledMotions)
    assert [one.name for one in spooled] == [one.name for one in motions]
    assert [one.name for one in few(spooled)] == [motions[k].name for k in choose_runs(6, 3)]
    assert few(motions) is motions


def test_no_more_than_the_limit_is_held_while_spooling(
    motions: tuple[Motion, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Law: beyond the limit the next run is only asked for when the last one lies on disk."""
    monkeypatch.setattr(spooling, "HELD_SAMPLES", 2 * len(motions[0].time))
    written: list[str] = []
    bare = spooling._with_channels  # what stays of a run whose signals lie on disk
    monkeypatch.setattr(spooling, "_with_channels", lambda one, none: (written.append(one.name), bare(one, none))[1])
    ahead = []

    def coming() -> Iterator[Motion]:
        for k, motion in enumerate(motions):
            ahead.append(k - len(written))
            yield motion

    hold(coming())
    assert ahead == [0, 1, 2, 0, 0, 0]


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


@pytest.mark.parametrize("every", [1, 2, 7, 54])
def test_one_run_of_each_stretch_is_chosen(every: int) -> None:
    """Law: one run of each stretch, the last of which may be short, in order and always the same one."""
    chosen = choose_runs(500, every)
    assert [k // every for k in chosen] == list(range(-(-500 // every)))
    assert chosen[-1] < 500
    assert chosen == choose_runs(500, every)


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
        def seek(self, place: int) -> None:
            raise OSError(28, "No space left on device")

    spooled = SpooledArrays()
    monkeypatch.setattr(spooled, "_file", Full())
    with pytest.raises(InputError, match="No space left on device; free some space there"):
        spooled.append(np.zeros(3))
