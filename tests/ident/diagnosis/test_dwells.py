"""Laws of rest: a hold is one observation within static friction, however long it lasts and however it is cut."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from ident.arrays import Array
from ident.diagnosis.regression.dwells import DwellRows, dwell_rows, find_holds, join_runs, resting
from ident.diagnosis.regression.noise import shorter_filters, whiten_after_gaps
from ident.motion.motion import Motion
from tests.ident.made_up import exact_motion

RATE = 50.0
FRICTION, NOISE = np.array([3.0, 2.0]), np.array([0.1, 0.1])
ANGLES = (0.0, 0.7, 0.2)


def stepped(hold_s: float = 2.0, push: float = 0.0) -> Motion:
    """Two joints: the first rests at some angles and moves between, the second moves all the time."""
    pieces = [np.full(int(hold_s * RATE), ANGLES[0])]
    for old, new in pairwise(ANGLES):
        s = np.arange(int(RATE)) / RATE
        pieces += [old + (10 * s**3 - 15 * s**4 + 6 * s**5) * (new - old), np.full(int(hold_s * RATE), new)]
    first = np.concatenate(pieces)
    time = np.arange(len(first)) / RATE
    q = np.stack([first, np.sin(2.0 * time)], axis=1)
    dq, ddq = (np.stack([part, wave], axis=1) for part, wave in zip(_rates(first), _waves(time), strict=True))
    tau = np.zeros_like(q)
    rest = slice(int((hold_s + 1.0 + 0.4 * hold_s) * RATE), int((hold_s + 1.0 + 0.7 * hold_s) * RATE))
    tau[rest, 0] += push
    return exact_motion(time, (q, dq, ddq), tau, ("a", "b"), "run")


def _rates(q: Array) -> tuple[Array, Array]:
    dq = np.gradient(q, 1.0 / RATE)
    return dq, np.gradient(dq, 1.0 / RATE)


def _waves(time: Array) -> tuple[Array, Array]:
    return 2.0 * np.cos(2.0 * time), -4.0 * np.sin(2.0 * time)


def rows_of(motion: Motion, blocks: Array | None = None) -> DwellRows:
    tables = [np.stack([np.ones(len(motion.tau_filtered)), tau], axis=1) for tau in motion.tau_filtered.T]
    return dwell_rows(motion, tables, FRICTION, NOISE, blocks)[0]


def test_holds_are_where_a_joint_rests_with_the_sign_of_the_motion_that_ended_there() -> None:
    motion = stepped()
    first, second = find_holds(motion)
    assert [one.sign for one in first] == [0.0, 1.0, -1.0]
    assert not second
    assert not motion.moving[:, 0][resting(motion)[motion.coarse, 0]].any()


def test_a_hold_is_worth_one_observation_however_long_it_lasts_and_however_it_is_cut() -> None:
    short, long = rows_of(stepped(2.0)), rows_of(stepped(8.0))
    assert len(short.rows) == len(long.rows) == len(ANGLES)
    np.testing.assert_allclose(long.std, FRICTION[0] / np.sqrt(3.0), rtol=1e-3)
    motion = stepped(8.0)
    cut = rows_of(motion, np.arange(motion.filtered_length) // 50)
    assert len(cut.rows) > 3 * len(ANGLES)
    for hold in range(len(ANGLES)):
        assert np.sum(cut.std[cut.hold == hold] ** -2.0) == pytest.approx(long.std[hold] ** -2.0, rel=1e-2)


@pytest.mark.parametrize(("push", "holds"), [(0.0, 3), (1.0, 3), (20.0, 5)])
def test_a_push_beyond_what_friction_takes_up_parts_a_hold(push: float, holds: int) -> None:
    found = rows_of(stepped(4.0, push))
    assert len(np.unique(found.hold)) == holds
    assert np.ptp(found.rows[:, -1]) == pytest.approx(push if holds > 3 else 0.0, abs=0.05 + 0.4 * push * (holds == 3))


def test_a_joint_that_creeps_on_is_observed_anew_after_each_travel() -> None:
    still = stepped(4.0)
    creep = np.array(still.q)
    creep[:, 0] = np.linspace(0.0, 0.4, len(creep))
    slow = replace(still, q=creep, dq=np.zeros_like(creep))
    assert len(np.unique(rows_of(slow).hold)) == pytest.approx(0.4 / slow.settings.forgetting_travel, abs=1.0)


def test_a_joint_that_nobody_moved_between_two_runs_is_in_one_hold() -> None:
    motion = stepped()
    at_rest = replace(motion, q=0.0 * motion.q, dq=0.0 * motion.q, ddq=0.0 * motion.q)
    one = rows_of(at_rest)
    assert len(np.unique(join_runs([one, one, one]).hold)) == 1
    assert len(np.unique(join_runs([one, one, one], alike=2).hold)) == 2
    moved = replace(one, angle=one.angle + 0.5)
    assert len(np.unique(join_runs([one, moved]).hold)) == 2


def test_rows_after_a_gap_are_whitened_by_what_of_their_past_counts() -> None:
    """However short the stretches: innovations of variance one, none of them alike, and no row is lost."""
    rng, coefficients, innovation = np.random.default_rng(0), np.array([1.0, -0.9, 0.3, 0.1, -0.05]), 0.7
    noise = np.zeros(40_000)
    shocks = innovation * rng.standard_normal(len(noise))
    for t in range(4, len(noise)):
        noise[t] = shocks[t] - coefficients[1:] @ noise[t - 4 : t][::-1]
    counts = rng.random(len(noise)) > 0.2
    counts[:10] = False
    white = whiten_after_gaps(noise[:, None], counts, shorter_filters(coefficients, innovation))[:, 0]
    first = np.flatnonzero(counts[1:] & ~counts[:-1]) + 1
    for later in range(4):
        rows = (first + later)[[counts[a : a + later + 1].all() for a in first]]
        assert white[rows].std() == pytest.approx(1.0, abs=0.05)
    both = counts[1:] & counts[:-1]
    assert np.corrcoef(white[1:][both], white[:-1][both])[0, 1] == pytest.approx(0.0, abs=0.03)
