"""Which columns of a foreign table are which channels, by what their numbers say."""

from __future__ import annotations

from collections.abc import Container
from dataclasses import dataclass
from itertools import permutations

import numpy as np

from ident.arrays import Array, Float, Int
from ident.checks.effort import SignedFit, States, collect_states, fit_signed
from ident.checks.effort_checks import check_effort
from ident.checks.settings import USUAL_EFFORT
from ident.errors import RecordingError
from ident.infer.guess import ForeignTable, Reason, Signals
from ident.infer.settings import UNNAMED as LIMIT
from ident.recordings.recording import Recording, Session
from ident.robot.arm import ArmModel

HINT = "name its columns in [columns] of session.toml yourself"
ONE_TABLE = (
    "put them side by side in one table or .npz (time, position, velocity, effort); without "
    f"velocity, {HINT}"
)
RISES = "the first column that rises evenly"
# Below it a spread, or a time, is divided by nothing; a share of the largest slope is at rest.
TINY = 1e-300
LEAST_TIME = 1e-12
AT_REST = 1e-9


def find_rising(table: ForeignTable, others: Container[str] = ()) -> str | None:
    """The first column that rises evenly; one that counts samples if there is no other.

    Args:
        table: Columns of numbers.
        others: Names of columns that are none of time.
    """
    counter = None
    for name, values in table.columns.items():
        if name in others:
            continue
        steps = np.diff(np.asarray(values, dtype=float))
        usual = float(np.median(steps)) if len(steps) else 0.0
        if usual <= 0.0:
            continue
        even = (steps > 0.0) & (np.abs(steps - usual) < LIMIT.even * usual)
        if np.mean(even) > LIMIT.nearly_all:
            if np.any(steps != 1.0):
                return name
            counter = counter or name
    return counter


@dataclass(frozen=True, eq=False)
class _Blocks:
    """Columns without names, as many at a time as there are joints."""

    names: list[str]  # of all columns
    values: Float[Array, "T c"]
    places: list[Int[Array, " n"]]  # where each block's columns stand
    time: Float[Array, " T"]

    def __len__(self) -> int:
        return len(self.places)

    def table(self, block: int) -> Float[Array, "T n"]:
        """The numbers of a block."""
        return self.values[:, self.places[block]]

    def columns(self, block: int) -> tuple[str, ...]:
        """The names of a block's columns."""
        return tuple(self.names[place] for place in self.places[block])

    def span(self, block: int) -> str:
        """The first and the last name."""
        names = self.columns(block)
        return f"{names[0]} to {names[-1]}"


@dataclass(frozen=True)
class _Motion:
    """Blocks of position and velocity."""

    match: float  # correlation of velocity with the position's derivative
    noise: float  # of the velocity
    position: int
    velocity: int


@dataclass(frozen=True)
class _Torque:
    """A block that follows the torque that the model needs."""

    explained: float  # share of it that the model tells
    noise: float
    block: int
    channel: str
    why: str


def guess_by_data(table: ForeignTable, arm: ArmModel) -> Signals:
    """Finds time, position, velocity and torque among columns without names.

    Raises:
        RecordingError: No columns move as this robot's joints do.
    """
    clock = find_rising(table)
    blocks = _cut_blocks(table, clock, arm)
    motion = _find_motion(blocks)
    if motion is None:
        what = f"no {arm.n} columns are the derivative of {arm.n} others"
        raise RecordingError(table.source, what, HINT)
    torque = _find_torque(blocks, motion, arm)
    if torque is None:
        what = "no columns follow the torque that this robot needs"
        raise RecordingError(table.source, what, HINT)
    reasons = []
    if clock is not None:
        reasons.append(Reason("time", f"column {clock}", RISES))
    derivative = f"columns {blocks.span(motion.velocity)} are their derivative"
    seen = f"{derivative} (correlation {motion.match:.3f})"
    reasons.append(Reason("position", f"columns {blocks.span(motion.position)}", seen))
    reasons.append(Reason(torque.channel, f"columns {blocks.span(torque.block)}", torque.why))
    chosen = {
        "position": motion.position,
        "velocity": motion.velocity,
        torque.channel: torque.block,
    }
    columns = {channel: blocks.columns(block) for channel, block in chosen.items()}
    tables = {channel: blocks.table(block) for channel, block in chosen.items()}
    return Signals(arm.joint_names, columns, tables, clock, blocks.time, tuple(reasons))


def _cut_blocks(table: ForeignTable, clock: str | None, arm: ArmModel) -> _Blocks:
    """The columns behind the time, as many at a time as the arm has joints.

    Raises:
        RecordingError: They are too few.
    """
    names = list(table.columns)
    values = np.column_stack(list(table.columns.values()))
    start = 0
    time = np.arange(len(values), dtype=float)
    if clock is not None:
        start = names.index(clock) + 1
        time = values[:, start - 1]
    count = (len(names) - start) // arm.n
    if count < LIMIT.fewest_channels:
        least = LIMIT.fewest_channels * arm.n
        needed = f"position, velocity and torque of {arm.n} joints are {least}"
        what = f"columns of numbers: {len(names)}; {needed}"
        raise RecordingError(table.source, what, ONE_TABLE)
    places = []
    for block in range(count):
        first = start + block * arm.n
        places.append(np.arange(first, first + arm.n))
    return _Blocks(names, values, places, time)


def _find_motion(blocks: _Blocks) -> _Motion | None:
    """Blocks of position, itself no derivative, and velocity.

    Of several the noisier, for commands have no noise.
    """
    pairs = []
    for position, velocity in permutations(range(len(blocks)), 2):
        dq = blocks.table(velocity)
        match = _match_derivative(blocks.table(position), dq, blocks.time)
        if match is not None and match > LIMIT.same_motion:
            pairs.append(_Motion(match, _noise(dq), position, velocity))
    derivatives = {pair.velocity for pair in pairs}
    original = [pair for pair in pairs if pair.position not in derivatives]
    return max(original, key=lambda pair: pair.noise, default=None)


def _match_derivative(
    q: Float[Array, "T n"], dq: Float[Array, "T n"], time: Float[Array, " T"]
) -> float | None:
    """Correlation of one table's slopes with another, the median over columns that move."""
    step = LIMIT.stride
    half = step // 2
    elapsed = np.maximum(time[step:] - time[:-step], LEAST_TIME)
    slopes = (q[step:] - q[:-step]) / elapsed[:, None]
    middle = dq[half : len(dq) - step + half]
    steepest = max(float(np.abs(slopes).max()), TINY)
    moving = slopes.std(axis=0) > AT_REST * steepest
    if not moving.any():
        return None
    slopes = slopes[:, moving] - slopes[:, moving].mean(axis=0)
    middle = middle[:, moving] - middle[:, moving].mean(axis=0)
    scale = np.maximum(slopes.std(axis=0) * middle.std(axis=0), TINY)
    return float(np.median((slopes * middle).mean(axis=0) / scale))


def _find_torque(blocks: _Blocks, motion: _Motion, arm: ArmModel) -> _Torque | None:
    """The block that follows the model's torque but is no model itself."""
    candidates = []
    for block in range(len(blocks)):
        if block not in (motion.position, motion.velocity):
            torque = _judge_torque(blocks, block, motion, arm)
            if torque is not None:
                candidates.append(torque)
    if not candidates:
        return None
    # What is commanded follows the model as well as what is measured: only the measured one is
    # noisy.
    most = max(torque.explained for torque in candidates)
    alike = [torque for torque in candidates if torque.explained > most - LIMIT.as_good]
    best = max(alike, key=lambda torque: torque.noise)
    others = []
    for torque in alike:
        if torque is not best:
            places = blocks.places[torque.block]
            others.append(f"{places[0] + 1} to {places[-1] + 1}")
    if not others:
        return best
    why = f"{best.why}; {', '.join(others)} as well, but smoother: a command"
    return _Torque(best.explained, best.noise, best.block, best.channel, why)


def _judge_torque(blocks: _Blocks, block: int, motion: _Motion, arm: ArmModel) -> _Torque | None:
    """How well a block follows the model's torque; None if it doesn't, or is a model itself."""
    position = blocks.table(motion.position)
    velocity = blocks.table(motion.velocity)
    torque = blocks.table(block)
    run = Recording("guess", arm.joint_names, blocks.time, position, torque, velocity=velocity)
    session = Session("guess", (run,))
    states = collect_states(session, arm)
    if states is None or not states.alive.any():
        return None
    explained, scale = follow(states)
    issues = check_effort(session, arm, states)
    is_model = any(issue.issue == "effort_is_model" for issue in issues)
    if is_model or explained <= USUAL_EFFORT.follows:
        return None
    is_torque = USUAL_EFFORT.scale_low < scale < USUAL_EFFORT.scale_high
    told = f"the robot's gravity, inertia and friction explain {100.0 * explained:.0f} % of them"
    why = f"{told}, gravity at {scale:.2g} times its size"
    channel = "effort" if is_torque else "current"
    return _Torque(explained, _noise(torque), block, channel, why)


def _noise(table: Float[Array, "T n"]) -> float:
    """Second differences against the spread, the median over columns."""
    rough = np.abs(np.diff(table, 2, axis=0)).mean(axis=0)
    return float(np.median(rough / np.maximum(table.std(axis=0), TINY)))


def follow(states: States) -> tuple[float, float]:
    """How much of the torque the model explains, whatever its sign, and at what scale.

    Medians over heavy joints.
    """
    alive = np.flatnonzero(states.alive)
    heavy = np.flatnonzero(states.heavy & states.alive)
    joints = heavy if len(heavy) else alive
    fits = [_better_sign(states, int(j)) for j in joints]
    explained = np.median([fit.explained for fit in fits])
    return float(explained), float(np.median([fit.gravity for fit in fits]))


def _better_sign(states: States, j: int) -> SignedFit:
    """The fit of a joint's torque, or of its negative, whichever the model tells more of."""
    return max(fit_signed(states, j, sign) for sign in (1.0, -1.0))
