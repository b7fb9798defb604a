"""Rest as evidence: each hold of a joint is one observation of its torque.

A joint that rests holds what gravity and all that is static ask of it, but for dry friction, which
may be anything within ± f_s. With x the mean of the columns and y that of the torque over the m
samples of a hold,

    y = xᵀβ + s a + e,  Var e = f_s² / 3 + noise² / m,

where s is the sign of the motion that ended in the hold and a what friction leans to after it
(`HeldFriction`, a column with a prior of its own: holds that are all approached from one side are
off by the same). A hold in which the torque changes by more than friction can take up (a hand's
push, a load put on), or through which the joint creeps on, is several. Of a hold that lies in
several blocks of time each block has a row with as many times the variance: together they are worth
one observation.

Source: Armstrong-Hélouvry, Dupont and Canudas de Wit 1994 (static friction takes up any torque
within its level).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from ident.arrays import Array, Bool, Float, Int
from ident.effects.base import Effect, Interval, RunContext, SessionContext, Variant
from ident.effects.intervals import coefficient_interval
from ident.effects.session_context import coulomb_level
from ident.motion.motion import Motion
from ident.regression.settings import DWELLS as LIMIT


@dataclass(frozen=True)
class Hold:
    """A stretch of one run's filtered samples in which a joint rests."""

    start: int  # first sample, and the one after the last; blurred ends are left out
    stop: int
    sign: float  # of the motion that ended in it; 0 where the run shows none
    # Whether the joint does not rest but turns round, starts or stops, too near for friction to be
    # known.
    turn: bool = False


@dataclass(frozen=True, eq=False)
class DwellRows:
    """What a joint's holds say: k rows, one a hold or a block's part of one.

    Attributes:
        rows: Means of the columns and, last, of the torque [N m]; in half the room.
        sign: Of the motion that ended in each row's hold; 0 where nobody knows.
        hold: Number of each row's hold.
        sample: Middle sample (filtered) of each row in its run.
        block: Block of time that each row lies in.
        length: Samples behind each row.
        angle: Mean position of the joint [rad or m].
        friction: Level f_s of static friction [N m].
        noise: Standard deviation of the torque's noise times the root of the samples that a mean
            is over [N m].
    """

    rows: Float[Array, "k p"]
    sign: Float[Array, " k"]
    hold: Int[Array, " k"]
    sample: Int[Array, " k"]
    block: Int[Array, " k"]
    length: Int[Array, " k"]
    angle: Float[Array, " k"]
    friction: float
    noise: float

    @property
    def std(self) -> Float[Array, " k"]:
        """Standard deviation of each row's torque [N m]."""
        rows_of_hold = np.bincount(self.hold)[self.hold] if len(self.hold) else np.zeros(0)
        of_friction = rows_of_hold * self.friction**2 / 3.0
        return np.sqrt(of_friction + self.noise**2 / np.maximum(self.length, 1))

    @property
    def weighted(self) -> Float[Array, "k p"]:
        """The rows in units of their standard deviations."""
        return self.rows / np.maximum(self.std, 1e-12)[:, None]


def find_holds(motion: Motion) -> tuple[tuple[Hold, ...], ...]:
    """Each joint's holds in a run: stretches of filtered samples in which it rests, in their
    order.
    """
    moving = motion.moving
    heading = np.sign(motion.dq[motion.coarse])
    holds = []
    for j, reach in enumerate(motion.blurred.tolist()):
        holds.append(_holds_of(moving[:, j], heading[:, j], reach))
    return tuple(holds)


def _holds_of(
    moving: Bool[Array, " t"], heading: Float[Array, " t"], reach: int
) -> tuple[Hold, ...]:
    """A joint's holds in a run.

    Args:
        moving: Where it surely moves.
        heading: Sign of its speed.
        reach: Samples over which a stop is smeared; a shorter rest is a turn.
    """
    holds = []
    for start, stop in _stretches(~moving):
        length = stop - start
        if length < reach:
            continue
        blurred = min(reach, int((1.0 - LIMIT.kept_share) * length / 2.0))
        sign = float(heading[start - 1]) if start else 0.0
        holds.append(Hold(start + blurred, stop - blurred, sign))
    return tuple(holds)


def find_turns(motion: Motion) -> tuple[tuple[Hold, ...], ...]:
    """Each joint's stretches without a hold or a settled sample, such as turns, and moves too short
    to settle.

    Ends of a run are left out, and so is what the filter smears between a hold and the settled
    motion beside it.

    Returns:
        By joint, in their order, with sign 0 and marked `turn`.
    """
    turns = []
    for j, holds in enumerate(find_holds(motion)):
        reach = int(motion.blurred[j])
        last = motion.filtered_length
        settled = motion.settled[:, j]
        held = np.zeros(last, dtype=bool)
        for start, stop in _stretches(~motion.moving[:, j]):
            held[start:stop] = any(start <= hold.start < stop for hold in holds)
        free = ~settled & ~held
        free[:reach] = free[last - reach :] = False
        turns_of_joint = []
        for start, stop in _stretches(free):
            beside = [start - 1, min(stop, last - 1)]
            if not (held[beside].any() and settled[beside].any()):
                turns_of_joint.append(Hold(start, stop, 0.0, turn=True))
        turns.append(tuple(turns_of_joint))
    return tuple(turns)


def _stretches(mask: Bool[Array, " t"]) -> list[tuple[int, int]]:
    """First sample, and the one after the last, of each stretch where a mask is true."""
    framed = np.concatenate([[False], mask, [False]])
    bounds = np.flatnonzero(np.diff(framed.astype(int)))
    return [(int(a), int(b)) for a, b in bounds.reshape(-1, 2)]


def resting(motion: Motion) -> Bool[Array, "T n"]:
    """Where each joint surely rests, at the motion's own rate (before the filter decimates)."""
    mask = np.zeros((len(motion.time), motion.n), dtype=bool)
    factor = motion.lowpass.factor
    for j, holds in enumerate(find_holds(motion)):
        for hold in holds:
            mask[hold.start * factor : hold.stop * factor, j] = True
    return mask


def rested(run: RunContext) -> RunContext:
    """A copy without any sliding where joints rest: what dry friction is there no law of motion
    shows.
    """
    still = resting(run.motion)
    return replace(
        run,
        direction=np.where(still, 0.0, run.direction),
        friction=np.where(still, 0.0, run.friction),
    )


def dwell_rows(
    motion: Motion,
    tables: Sequence[Float[Array, "t p"]],
    friction: Float[Array, " n"],
    noise: Float[Array, " n"],
    blocks: Int[Array, " t"] | None = None,
) -> tuple[DwellRows, ...]:
    """Each joint's holds of one run as weighted rows.

    Args:
        motion: The run.
        tables: Filtered columns of each joint, the torque last; made of a run that is `rested`.
        friction: Each joint's level of static friction [N m].
        noise: Standard deviation of each joint's torque noise times the root of the samples of a
            mean [N m].
        blocks: Block of time of each filtered sample; one for all if None.
    """
    if blocks is None:
        blocks = np.zeros(motion.filtered_length, dtype=int)
    changes = 1 + np.flatnonzero(np.diff(blocks))  # where another block of time begins
    rows = []
    for j, (holds, turns) in enumerate(zip(find_holds(motion), find_turns(motion), strict=True)):
        q = motion.q[motion.coarse, j]
        jump = LIMIT.jump_levels * friction[j] + LIMIT.jump_noise * noise[j]
        torque = tables[j][:, -1]
        parted = _parted((*holds, *turns), torque, q, jump, motion)
        pieces = _pieces_by_block(parted, changes)
        start, stop, sign, hold = np.array(pieces, dtype=float).reshape(-1, 4).T
        first = start.astype(int)
        last = stop.astype(int)
        middle = (first + last) // 2
        of_joint = DwellRows(
            rows=_means(tables[j], first, last).astype(np.float32),
            sign=sign,
            hold=hold.astype(int),
            sample=middle,
            block=blocks[middle],
            length=last - first,
            angle=_means(q[:, None], first, last)[:, 0],
            friction=float(friction[j]),
            noise=float(noise[j]),
        )
        rows.append(of_joint)
    return tuple(rows)


def _pieces_by_block(
    holds: Sequence[Hold], changes: Int[Array, " c"]
) -> list[tuple[int, int, float, int]]:
    """First sample, the one after the last, sign and number of each hold's part in each block.

    Args:
        holds: The holds.
        changes: Samples with which another block of time begins.
    """
    pieces = []
    for number, hold in enumerate(holds):
        inside = changes[(hold.start < changes) & (changes < hold.stop)]
        for start, stop in pairwise([hold.start, *inside, hold.stop]):
            pieces.append((start, stop, hold.sign, number))
    return pieces


def _parted(
    holds: Sequence[Hold],
    torque: Float[Array, " t"],
    q: Float[Array, " t"],
    jump: float,
    motion: Motion,
) -> list[Hold]:
    """Holds of a joint, parted where the torque jumps or the joint has crept on; of motion after
    that nobody knows.
    """
    least = round(LIMIT.shortest_s / (motion.interval * motion.lowpass.factor)) + 1
    travel = motion.settings.forgetting_travel
    parted = []
    for hold in holds:
        quiet = [(0, hold.stop - hold.start)]
        if not hold.turn:
            quiet = _quiet(torque[hold.start : hold.stop], jump, least)
        sign = hold.sign
        for first, last in quiet:
            for start, stop in _within(q, hold.start + first, hold.start + last, travel):
                parted.append(Hold(start, stop, sign))
                sign = 0.0
    return parted


def _quiet(torque: Float[Array, " t"], jump: float, least: int) -> list[tuple[int, int]]:
    """Stretches in which the torque changes by no more than a jump: halved where their halves'
    means differ most.

    What changes by more within a moment is the jump itself, and left out.
    """
    count = len(torque)
    if np.ptp(torque) <= jump:
        return [(0, count)]
    if count < 2 * least:
        return []
    sums = np.cumsum(torque)
    first = np.arange(least, count - least + 1)
    mean_before = sums[first - 1] / first
    mean_after = (sums[-1] - sums[first - 1]) / (count - first)
    score = np.abs(mean_before - mean_after) * np.sqrt(first * (count - first))
    middle = int(first[np.argmax(score)])
    earlier = _quiet(torque[:middle], jump, least)
    later = _quiet(torque[middle:], jump, least)
    return earlier + [(middle + start, middle + stop) for start, stop in later]


def _within(q: Float[Array, " t"], start: int, stop: int, travel: float) -> list[tuple[int, int]]:
    """Stretches over which a joint goes no further than a travel."""
    stretches = []
    while start < stop:
        gone = np.abs(q[start:stop] - q[start]) > travel
        end = start + int(np.argmax(gone)) if gone.any() else stop
        stretches.append((start, max(end, start + 1)))
        start = stretches[-1][1]
    return stretches


def _means(
    table: Float[Array, "t p"], start: Int[Array, " k"], stop: Int[Array, " k"]
) -> Float[Array, "k p"]:
    """Mean row of each of some stretches."""
    stretches = zip(start, stop, strict=True)
    means = [table[first:last].mean(axis=0) for first, last in stretches]
    return np.array(means).reshape(-1, table.shape[1])


def join_runs(parts: Sequence[DwellRows], alike: int | None = None) -> DwellRows:
    """One joint's rows of several runs, in their order.

    A hold that a run ends in and the next begins in is one.

    Args:
        parts: The rows of each run; at least one.
        alike: How many of the first runs are of one and the same arm: no hold goes on from these to
            the others. All if None.
    """
    hold = []
    number = 0
    last_angle = np.nan
    for k, rows in enumerate(parts):
        numbers = rows.hold + number
        if len(numbers):
            begins = (
                k != alike
                and rows.sign[0] == 0.0
                and abs(rows.angle[0] - last_angle) < LIMIT.same_angle
            )
            numbers = numbers - int(begins)
            number = int(numbers[-1]) + 1
            last_angle = float(rows.angle[-1])
        hold.append(numbers)
    whole = {}
    for name in ("rows", "sign", "sample", "block", "length", "angle"):
        of_runs = [getattr(rows, name) for rows in parts]
        whole[name] = np.concatenate(of_runs)
    return DwellRows(
        hold=np.concatenate(hold), friction=parts[0].friction, noise=parts[0].noise, **whole
    )


def static_level(session: SessionContext) -> Float[Array, " n"]:
    """Each joint's level of static friction as its Coulomb friction has it, or a typical
    one [N m].
    """
    return np.array([coulomb_level(session, joint) for joint in range(session.n)])


class HeldFriction(Effect):
    """What dry friction leans to at rest: a torque of the sign of the motion that ended there, a
    part of f_s.
    """

    id = "held_friction"
    summary = "friction that a joint keeps after it came to rest"
    defining = ("held_Nm",)

    def columns(
        self, session: SessionContext, joint: int, variant: Variant
    ) -> list[Float[Array, "T ..."]]:
        columns = []
        for run in session.runs:
            column = np.zeros((len(run.motion.time), 1))
            factor = run.motion.lowpass.factor
            for hold in find_holds(run.motion)[joint]:
                column[hold.start * factor : hold.stop * factor] = hold.sign
            columns.append(column)
        return columns

    def parameters(
        self,
        session: SessionContext,
        joint: int,
        variant: Variant,
        coefficients: Array,
        covariance: Array,
    ) -> dict[str, Interval]:
        return {"held_Nm": coefficient_interval(0, coefficients, covariance)}

    def untestable(self, session: SessionContext, joint: int) -> str | None:
        for run in session.runs:
            if any(hold.sign for hold in find_holds(run.motion)[joint]):
                return None
        return f"{session.joint_names[joint]} never comes to rest"

    def prior_scale(
        self, session: SessionContext, joint: int, variant: Variant
    ) -> Float[Array, " k"]:
        return np.array([LIMIT.leaning * coulomb_level(session, joint)])
