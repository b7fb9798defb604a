"""What the same states leave at other times is taken off, so that events and fine lines stand out of a wrong model."""

import numpy as np
import pytest

from ident.effects.base import SessionContext
from ident.effects.contact import ExternalContact
from ident.effects.pushes import force_columns
from ident.effects.ripple import _spectrum, find_lines
from ident.effects.settings import RIPPLE
from ident.regression.discrepancy import unusual_torque


@pytest.fixture(scope="module")
def smooth(session: SessionContext) -> list[np.ndarray]:
    """What a wrong model leaves: a smooth function of each joint's own state, and of its neighbour's angle [N m]."""
    found = []
    for run in session.runs:
        q, dq = run.motion.q[run.motion.coarse], run.motion.dq[run.motion.coarse]
        found.append(3.0 * np.sin(1.3 * q) + 2.0 * np.tanh(dq / 0.3) + np.cos(np.roll(q, 1, axis=1)))
    return found


def noise(session: SessionContext, seed: int) -> list[np.ndarray]:
    """White noise of 0.3 N m at every joint."""
    rng = np.random.default_rng(seed)
    return [rng.normal(0.0, 0.3, run.motion.tau_filtered.shape) for run in session.runs]


def added(*parts: list[np.ndarray]) -> list[np.ndarray]:
    return [np.sum(one, axis=0) for one in zip(*parts, strict=True)]


def test_a_smooth_function_of_the_state_goes_and_noise_stays(session: SessionContext, smooth: list[np.ndarray]) -> None:
    """Law: of a smooth error less than a fifth of its power is left in motion; noise alone stays what it is."""
    white = noise(session, 1)
    moves = np.concatenate([run.motion.settled for run in session.runs])

    def power(torque: list[np.ndarray]) -> np.ndarray:
        return np.mean(np.concatenate(torque) ** 2, axis=0, where=moves)

    assert (power(unusual_torque(session, added(smooth, white))) < power(white) + 0.2 * power(smooth)).all()
    np.testing.assert_array_equal(np.concatenate(unusual_torque(session, white)), np.concatenate(white))


def test_a_push_does_not_predict_itself(session: SessionContext, smooth: list[np.ndarray]) -> None:
    """Law: a window is predicted from other times, so that a push of smaller torque than a smooth error is found in it;
    in what the model leaves it isn't.
    """
    run = session.runs[1]
    time = run.motion.time[run.motion.coarse]
    start = float(time[0]) + 5.0
    inside = (time > start) & (time < start + 1.2)
    force = np.zeros((len(time), run.n))
    force[inside] = force_columns(run.arm, run.motion.q[run.motion.coarse][inside], 4, 1.0) @ np.array([6.0, -3.0, 4.0])
    left = added(smooth, noise(session, 2))
    left[1] = left[1] + force

    def near(torque: list[np.ndarray]) -> bool:
        pushes = ExternalContact().screened(session, torque).pushes
        return any(one.run == "run_1" and abs(one.start - start) < 0.2 and one.link in (4, 5) for one in pushes[:1])

    assert near(unusual_torque(session, left))
    assert not near(left)


def test_a_line_in_the_angle_stands_out_of_a_smooth_error(session: SessionContext, smooth: list[np.ndarray]) -> None:
    """Law: a ripple of a tenth of a smooth error's size is the strongest line once that is gone."""
    turns, white = 41.0, noise(session, 3)
    ripple = [np.zeros_like(values) for values in smooth]
    for run, values in zip(session.runs, ripple, strict=True):
        values[:, 2] = run.motion.filtered(0.3 * np.cos(turns * run.motion.q[:, 2]))
    left = added(smooth, white, ripple)
    lines, _ = find_lines(session, unusual_torque(session, left), 2)
    travel = np.ptp(np.concatenate([run.motion.q[:, 2] for run in session.runs]))
    assert abs(lines[0] - turns) < 2.0 * np.pi / travel
    assert lines[0] not in find_lines(session, left, 2)[0][:1]


def test_what_is_unknown_stays_unknown(session: SessionContext, smooth: list[np.ndarray]) -> None:
    """Law: no number appears where there was none, and a joint of which nothing is left keeps that."""
    left = added(smooth, noise(session, 4))
    left[0][:7, 3] = left[2][40:60, 3] = np.nan
    for values in left:
        values[:, 5] = 0.0
    found = unusual_torque(session, left)
    for one, other in zip(found, left, strict=True):
        np.testing.assert_array_equal(np.isnan(one), np.isnan(other))
        assert not one[:, 5].any()


def test_a_line_counts_the_samples_that_pass_it_slowly_enough() -> None:
    """Law: for each line at least five sixths of the speeds that it lets through the filter count, and none that
    it doesn't: a line that half the motion passes too fast is still found.
    """
    corner, rng = 3.2, np.random.default_rng(5)
    speed = rng.uniform(0.0, 1.5, 3000)
    turns, _, cycles = _spectrum(rng.uniform(0.0, 2.7, 3000), speed, rng.normal(size=3000), corner)
    counted = np.divide(2.0 * np.pi * cycles, turns, out=np.zeros_like(turns), where=turns > 0.0)
    for line in np.flatnonzero((turns > 10.0) & (turns < 300.0))[::50]:
        fastest = 2.0 * np.pi * corner / turns[line]
        assert counted[line] <= speed[speed < fastest].sum() * (1.0 + 1e-9)
        assert counted[line] >= speed[speed < 5.0 / 6.0 * fastest].sum() * (1.0 - 1e-9)


@pytest.mark.parametrize(("turns", "amplitude"), [(120.0, 2.0), (120.0, 8.0), (300.0, 0.5), (300.0, 2.0)])
def test_a_line_hides_neither_itself_nor_makes_others(session: SessionContext, turns: float, amplitude: float) -> None:
    """Law: what is usual around a line is what is there without it, so that a strong line passes, and passes alone."""
    left = noise(session, 7)
    for run, values in zip(session.runs, left, strict=True):
        values[:, 2] += run.motion.filtered(amplitude * np.cos(turns * run.motion.q[:, 2]))
    lines, _ = find_lines(session, left, 2)
    travel = np.ptp(np.concatenate([run.motion.q[:, 2] for run in session.runs]))
    assert len(lines) == 1
    assert abs(lines[0] - turns) < 2.0 * np.pi / travel


def test_only_lines_that_the_motion_shows_are_candidates(session: SessionContext) -> None:
    """Law: however low the bar, as for a comparison, no line below the fewest cycles a turn is taken, nor one twice."""
    left = noise(session, 8)
    for run, values in zip(session.runs, left, strict=True):
        values[:, 2] += 5.0 * np.cos(6.0 * run.motion.q[run.motion.coarse][:, 2])
    lines, _ = find_lines(session, left, 2, chance=1e9)
    assert len(set(lines)) == RIPPLE.most_lines
    assert min(lines) >= RIPPLE.fewest
