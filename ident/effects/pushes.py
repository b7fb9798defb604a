"""Pushes in what a model leaves of the torque: when they may have been, and on which link."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.ndimage import uniform_filter1d

from ident.arrays import Array, Float, Int
from ident.effects.base import RunContext, SessionContext
from ident.effects.session_context import arm_reach, rated_torque
from ident.effects.settings import CONTACT as LIMIT
from ident.robot.arm import ArmModel
from ident.robot.chain import compute_joint_poses


@dataclass(frozen=True)
class Push:
    """Where and when a push may have been."""

    run: str  # name of the run
    start: float  # on the session's clock [s]
    end: float
    link: int = 0  # number of the link, from 1; 0 is the last one
    outward: float = 0.0  # where on the link: 0 at its centre of mass, 1 at the next joint

    def overlaps(self, other: Push) -> bool:
        """Whether two pushes of the same run share a moment."""
        if self.run != other.run:
            return False
        return self.start < other.end and other.start < self.end


@dataclass(frozen=True, eq=False)
class Leftover:
    """What a model leaves of all runs, and what it usually leaves."""

    session: SessionContext
    # by run, filtered and decimated; NaN where nobody knows [N m]
    torque: Sequence[Float[Array, "t n"]]

    @cached_property
    def usual(self) -> Float[Array, " n"]:
        """Robust standard deviation of what is usually left at each joint [N m]; never zero."""
        every = max(1, sum(len(values) for values in self.torque) // LIMIT.usual_samples)
        squares = np.nan_to_num(np.concatenate([values[::every] for values in self.torque])) ** 2
        middle = np.array(
            [
                np.median(column[column > 0.0]) if (column > 0.0).any() else 0.0
                for column in squares.T
            ]
        )
        # 0.455 is the median of χ² with one degree of freedom
        return np.sqrt(middle / 0.455) + 1e-12

    def around(
        self, push: Push, seconds: float
    ) -> tuple[RunContext, Int[Array, " k"], Float[Array, "k n"]]:
        """The time around a push.

        Args:
            push: The push.
            seconds: How long before and after it belongs to it [s].

        Returns:
            Its run, the indices of the k filtered samples, and what is left there in usual
            deviations.
        """
        index = [run.motion.name for run in self.session.runs].index(push.run)
        motion = self.session.runs[index].motion
        time = motion.time[motion.coarse]
        after_begin = time > push.start - seconds
        before_end = time < push.end + seconds
        near = np.flatnonzero(after_begin & before_end)
        scaled = self.torque[index][near] / self.usual
        return self.session.runs[index], near, scaled


class Located(NamedTuple):
    """A push at the link and point that explain its window best."""

    push: Push
    share: float  # of what changes in the window that a constant force there explains
    fall: float  # and by how much the sum of squares falls, in squares of what is usually left


def screen_windows(leftover: Leftover) -> tuple[Push, ...]:
    """Windows in which much more torque is left unexplained than usual, the strongest first."""
    windows: list[tuple[float, Push]] = []
    for run, torque in zip(leftover.session.runs, leftover.torque, strict=True):
        time = run.motion.time[run.motion.coarse]
        values = torque / leftover.usual
        interval = run.interval * run.motion.lowpass.factor
        step = max(1, round(LIMIT.shortest_window / 2 / interval))
        squares = np.nan_to_num(values**2)
        power = np.mean(squares, axis=1)
        count = len(power) // step
        cell = squares[: count * step].reshape(count, step, run.n).mean(axis=1)
        strong = (cell.mean(axis=1) > LIMIT.screen_ratio) | (
            cell.max(axis=1) > LIMIT.screen_one_ratio
        )
        framed = np.concatenate([[0], strong.astype(int), [0]])
        edges = np.flatnonzero(np.diff(framed))
        fine = uniform_filter1d(
            power, max(1, round(LIMIT.edge * step / (LIMIT.shortest_window / 2)))
        )
        for first, last in zip(edges[::2], edges[1::2], strict=True):
            cells = slice(first * step, last * step)
            # Cells cut a push anywhere: it lasts for as long as the power is at least a quarter of
            # its mean.
            from_row = max(first - 1, 0) * step
            to_row = min((last + 1) * step, len(power))
            around = np.arange(from_row, to_row)
            inside = around[fine[around] > 0.25 * power[cells].mean()]
            first_time = float(time[inside[0]])
            last_time = float(time[inside[-1]])
            start, end = _changes(time, values, first_time, last_time)
            windows.append(
                (
                    float(power[cells].sum()),
                    Push(run.motion.name, start, max(end, start + 2 * LIMIT.edge)),
                )
            )
    return tuple(
        push for _, push in sorted(windows, key=lambda pair: -pair[0])[: LIMIT.most_windows]
    )


def _changes(
    time: Float[Array, " t"], values: Float[Array, "t n"], start: float, end: float
) -> tuple[float, float]:
    """The part of a window, and of the time around it, in which the mean differs most from the
    rest.
    """
    after_begin = time >= start - LIMIT.around
    before_end = time <= end + LIMIT.around
    near = np.flatnonzero(after_begin & before_end)
    known = ~np.isnan(values[near])
    values = np.nan_to_num(values[near])
    nothing = np.zeros((1, values.shape[1]))
    counts = np.concatenate([nothing, np.cumsum(known, axis=0)])
    sums = np.concatenate([nothing, np.cumsum(values, axis=0)])
    interval = max(float(np.median(np.diff(time[near]))), 1e-9)
    least = max(2, int(2 * LIMIT.edge / interval))
    first, last = pairs_of_ends(len(near), 1, least)
    inside = counts[last] - counts[first]
    total = counts[-1]
    outside = total - inside
    split = (inside > 0) & (outside > 0)
    middle = (sums[last] - sums[first]) / np.maximum(inside, 1)
    sum_outside = sums[-1] - sums[last] + sums[first]
    apart = middle - sum_outside / np.maximum(outside, 1)
    weight = inside * outside / np.maximum(total, 1)
    gain = np.where(split, weight * apart**2, 0.0).sum(axis=1)
    if not gain.any():
        return start, end
    best = int(np.argmax(gain))
    inside_part = slice(first[best], last[best])
    rest = (
        slice(inside_part.stop, len(near))
        if inside_part.start == 0
        else slice(0, inside_part.start)
    )
    halves = (inside_part.start == 0) != (inside_part.stop == len(near))
    square_at_rest = np.mean(values[rest] ** 2)
    square_inside = np.mean(values[inside_part] ** 2)
    if halves and square_at_rest > square_inside:
        inside_part = rest  # of two halves the push is the one that is away from zero
    first_row = near[inside_part.start]
    last_row = near[inside_part.stop - 1]
    return float(time[first_row]), float(time[last_row])


def find_span(leftover: Leftover, rough: Push) -> Push:
    """The part of the time around a rough window in which a constant force at one of the points
    explains most.

    Each joint has a level of its own around it. The fall of the squares by the force is, for any
    part, a quadratic form of sums over it, which are differences of cumulative ones.
    """
    run, near, left = leftover.around(rough, LIMIT.reach)
    time = run.motion.time[run.motion.coarse][near]
    q = run.motion.q[run.motion.coarse][near]
    known = ~np.isnan(left)
    left = np.nan_to_num(left)
    count = np.maximum(known.sum(axis=0), 1)
    level = left.sum(axis=0)
    interval = max(float(np.median(np.diff(time))), 1e-9)
    step = max(1, round(LIMIT.edge / interval))
    first, last = pairs_of_ends(len(near), step, 2 * step)
    best = rough
    most = 0.0
    largest = largest_force(leftover.session)
    for link, outward in points_of_links(run.n):
        force = (
            known[:, :, None]
            * force_columns(run.arm, q, link, outward, leftover.session.tuned)
            / leftover.usual[None, :, None]
        )
        sums = force, np.einsum("tja,tjb->tab", force, force), np.einsum("tja,tj->ta", force, left)
        across, square, target = (
            np.concatenate([np.zeros((1, *values.shape[1:])), np.cumsum(values, axis=0)])
            for values in sums
        )
        across, square, target = (
            cumulated[last] - cumulated[first] for cumulated in (across, square, target)
        )
        square = square - np.einsum("pja,pjb,j->pab", across, across, 1.0 / count)
        target = target - np.einsum("pja,j->pa", across, level / count)
        trace = np.trace(square, axis1=1, axis2=2)
        ridge = 1e-6 * trace[:, None, None] * np.eye(3)
        ridge = ridge + 1e-12 * np.eye(3)
        solved = np.linalg.solve(square + ridge, target[:, :, None])[:, :, 0]
        fall = np.where(
            np.linalg.norm(solved, axis=1) < largest, np.sum(solved * target, axis=1), 0.0
        )
        if fall.size and fall.max() > most:
            most = float(fall.max())
            k = int(np.argmax(fall))
            start = float(time[first[k]])
            end = float(time[last[k] - 1])
            best = replace(rough, start=start, end=end)
    return best


def pairs_of_ends(count: int, step: int, least: int) -> tuple[Int[Array, " p"], Int[Array, " p"]]:
    """Beginning and end of the parts of some samples, a step apart: of many samples no more than of
    a few hundred.
    """
    stride = max(step, -(-count // LIMIT.most_cuts))
    cuts = np.unique(np.append(np.arange(0, count, stride), count))
    first, last = cuts[np.stack(np.triu_indices(len(cuts), 1))]
    long = last - first >= least
    return first[long], last[long]


def locate(leftover: Leftover, push: Push) -> Located:
    """The link and point whose Jacobian explains a window best.

    What is left around the window as well as in it is no part of the push, nor is what is usually
    left of any window.
    """
    run, near, left = leftover.around(push, LIMIT.around)
    time = run.motion.time[run.motion.coarse]
    # While the force sets in and fades it is neither there nor away; of few samples none lies in
    # between.
    if float(np.median(np.diff(time))) < LIMIT.edge / 2:
        steady = (
            np.minimum(np.abs(time[near] - push.start), np.abs(time[near] - push.end))
            > LIMIT.edge / 2
        )
        near = near[steady]
        left = left[steady]
    during = (time[near] >= push.start) & (time[near] <= push.end)
    counts = ~np.isnan(left)
    if np.count_nonzero(during & counts.any(axis=1)) < 3:
        return Located(push, 0.0, 0.0)
    level = np.where(counts[:, :, None], np.eye(run.n), 0.0)
    level = level.reshape(-1, run.n)
    target = np.nan_to_num(left).ravel()
    target = target - level @ np.linalg.lstsq(level, target, rcond=1e-9)[0]
    q = run.motion.q[run.motion.coarse][near]
    square = float(np.sum(target**2))
    # in usual deviations: each sample's own square is one
    beyond = square - max(float(counts.sum()) - run.n, 0.0)
    best = Located(push, 0.0, 0.0)
    largest = largest_force(leftover.session)
    for link, outward in points_of_links(run.n):
        force = force_columns(run.arm, q, link, outward, leftover.session.tuned)
        force = force / leftover.usual[None, :, None]
        while_pushed = counts & during[:, None]
        columns = np.where(while_pushed[:, :, None], force, 0.0)
        columns = columns.reshape(-1, 3)
        columns -= level @ np.linalg.lstsq(level, columns, rcond=1e-9)[0]
        solved = np.linalg.lstsq(columns, target, rcond=1e-3)[0]
        fall = square - float(np.sum((target - columns @ solved) ** 2))
        if fall > best.fall and np.linalg.norm(solved) < largest:
            best = Located(
                replace(push, link=link, outward=outward), fall / max(beyond, fall, 1e-300), fall
            )
    return best


def force_columns(
    arm: ArmModel,
    q: Float[Array, "T n"],
    link: int,
    outward: float = 0.0,
    tuned: Float[Array, " 10n"] | None = None,
) -> Float[Array, "T n 3"]:
    """Torque with which each joint holds a unit force along each axis of the base frame: −Jᵀ
    [N m/N].

    Args:
        arm: The arm.
        q: Its positions [rad].
        link: The link that is pushed, counted from 1.
        outward: Where: 0 at its centre of mass, 1 at the next joint.
        tuned: Change of the links by tuning, which is no part of where their centres are: what a
            link weighs is hardly known where torque does not hang on it, and its centre then is
            anywhere. Nothing if None.
    """
    links = arm.inertial_parameters if tuned is None else arm.inertial_parameters - tuned
    parameters = links[10 * (link - 1) : 10 * link]
    point = parameters[1:4] / max(float(parameters[0]), 1e-9)
    if outward:
        end_of_link = arm.model.jointPlacements[link + 1].translation
        point = (1.0 - outward) * point + outward * end_of_link
    poses = compute_joint_poses(arm.chain, q, range(1, link + 1))
    columns = np.zeros((*q.shape, 3))
    turn, origin = poses[link]
    there = origin + turn @ point
    for j in range(link):
        turn, origin = poses[j + 1]
        axis = turn @ arm.chain.axes[j]
        if arm.chain.sliding[j]:
            columns[:, j] = -axis
        else:
            columns[:, j] = np.cross(there - origin, axis)
    return columns


def points_of_links(n: int) -> list[tuple[int, float]]:
    """Links and points on them that are tried."""
    return [
        (link, outward)
        for link in range(1, n + 1)
        for outward in ((0.0, 1.0) if link < n else (0.0,))
    ]


def largest_force(session: SessionContext) -> float:
    """Force that no arm of such motors bears [N]."""
    strongest = max(rated_torque(session, joint) for joint in range(session.n))
    return LIMIT.largest_force_share * strongest / max(arm_reach(session.runs[0].arm), 1e-3)
