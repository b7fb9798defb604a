"""What a joint's torque remembers: the part that depends on the last second.

Grease, hysteresis of gears and cables, filters in drives and thermal swings leave a torque that no
function of angle, speed and acceleration tells. The inputs are what a joint does now, the load that
it bears, states of stop operators of three ranges (where it stands since its last reversals) and
slow averages of its direction, pace, load and angle over a tenth of a second to 0.8 s. They are
given to boosted trees, which never leave the range of torques that they have seen: trees of the
joint's own inputs, trees that see the states of all joints too, or the mean of both, whichever
foretells best what it did not see.

A joint's memory stands in for its net where it lowers the error of blocks left out by more than one
standard error of that fall, and does not surely make the work worse: a veto of the work by one
standard error cost torque on most of eight real arms. What is to come is between more of the same
motion, which blocks left out foretell, and another motion, which whole runs left out foretell. The
share that counts falls with the distance from poses that were seen, as both of them together ask
for (`nearness`). With a share for all motions, the mean of what each asks for, 16 of 237 joints on
36 splits of twelve real arms got worse by more than half a per cent and 4 surely, over eight
stretches of runs that nobody saw; so 10 and 1, and torque is less by 1.8 % (geometric mean). On
twenty other splits 9 of 134 got worse, so 7, none surely, and torque is less by 1.3 %. The shortest
reach within a standard error of the best made 4 and 6 worse, but where all that was left out lies
near, as in runs that repeat their paths, it gave up what holds on others. Trees of a joint's own
inputs alone leave 6 % more torque.
A net needs whole runs for its gate, since it makes up torques where it never was; trees do not.

States that do not follow one another, as a planner's nodes, have no memory: there the net counts.

Source: Al-Bender 2005 (stop operators); Kohavi 1994 (oblivious trees); Breiman 1996 (bagging).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ident.arrays import Array, Bool, Float, Int
from ident.compiled import compiled
from ident.errors import ModelError
from ident.files import atomic_write
from ident.model.boosted import DEPTH, BinnedInputs, Trees, grow_trees, join_trees
from ident.model.folds import FEWEST_RUNS, FOLDS
from ident.model.joint_nets import joint_features
from ident.model.linearisation import stop_operator
from ident.model.nearness import (
    LeftOut,
    Nearness,
    choose_share,
    fall,
    nearest_left_out,
    spread_poses,
)
from ident.model.net_gate import JointGate, gate_of, shrink_bounded
from ident.model.residual_net import Unexplained
from ident.records import JsonRecord, as_json
from ident.safe_read import read_bytes, read_json

# Ranges of the stop operators [rad], and times over which averages are taken [s].
RANGES = (1e-3, 1e-2, 1e-1)
TIMES = (0.1, 0.3, 0.8)
# Speed over which a joint's direction turns round in its average [rad/s].
TURNING = 0.02
# Rows that a joint's doubt is found by, and those that its trees are fitted to in the end; of more,
# every second or third is taken. Twice as many for the doubt changed nothing on runs that nobody
# saw: neighbours are near-copies.
MOST_ROWS = 2500
FITTED_ROWS = 20_000
# Fewer rows than this tell nothing of a joint.
FEWEST_ROWS = 100
# Blocks that recordings are cut into at least.
BLOCKS = 8
# Whose inputs a joint's trees are given: its own, those of all joints, or half of each.
OWN, ALL, BOTH = range(3)
NOBODYS = -1  # where a joint has no trees
FILE = "memory.safetensors"
RECORD = "memory.json"
SEVERAL = 4  # channels of every joint: angle, speed, acceleration, load


@compiled(error_model="numpy", nogil=True)
def _average(values: Array, share: float, out: Array) -> None:
    """First-order lag from the first value on."""
    mean = values[0]
    for t in range(len(values)):
        mean += share * (values[t] - mean)
        out[t] = mean


def lagged(values: Float[Array, " T"], interval: float, time: float) -> Float[Array, " T"]:
    """A signal's average over about the last `time` [s], as if its first value came before."""
    out = np.empty(len(values))
    _average(np.ascontiguousarray(values, dtype=float), interval / (time + interval), out)
    return out


def memory_inputs(
    q: Float[Array, "T n"],
    dq: Float[Array, "T n"],
    ddq: Float[Array, "T n"],
    load: Float[Array, "T n"],
    joint: int,
    interval: float,
) -> Float[Array, "T f"]:
    """Inputs of one joint: its own, then the states of all.

    Args:
        q: Joint positions [rad], rows that follow one another.
        dq: Speeds [rad/s].
        ddq: Accelerations [rad/s²].
        load: Rigid torque [N m].
        joint: Number of the joint.
        interval: Time from row to row [s].
    """
    of_joint = _inputs_of_joint(q, dq, ddq, load, joint, interval)
    return np.concatenate([of_joint, q, dq, ddq, load], axis=1)


def _inputs_of_joint(
    q: Float[Array, "T n"],
    dq: Float[Array, "T n"],
    ddq: Float[Array, "T n"],
    load: Float[Array, "T n"],
    joint: int,
    interval: float,
) -> Float[Array, "T f"]:
    """A joint's own inputs: arguments as of `memory_inputs`."""
    angle = np.ascontiguousarray(q[:, joint])
    pace = dq[:, joint]
    torque = load[:, joint]
    of_joint = [joint_features(pace, ddq[:, joint], torque)]
    of_joint += [stop_operator(angle, size)[:, None] / size for size in RANGES]
    heading = np.tanh(pace / TURNING)
    for time in TIMES:
        of_joint.append(lagged(heading, interval, time)[:, None])
        of_joint.append(lagged(np.abs(pace), interval, time)[:, None])
        of_joint.append(lagged(torque, interval, time)[:, None] - torque[:, None])
        of_joint.append(angle[:, None] - lagged(angle, interval, time)[:, None])
    return np.concatenate(of_joint, axis=1)


@dataclass(frozen=True, eq=False)
class JointMemory:
    """Trees of the joints that keep them."""

    trees: tuple[Trees | None, ...]  # of each joint; None where the net, or nothing, is as good
    nearness: Nearness  # poses that were seen, and how far from them the trees reach
    gate: tuple[JointGate, ...] = ()  # what they did on runs left out, if they were fitted here

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.trees)

    @property
    def kept(self) -> Bool[Array, " n"]:
        """Joints that have a memory."""
        return np.array([of_joint is not None for of_joint in self.trees])

    def predict(
        self,
        q: Float[Array, "T n"],
        dq: Float[Array, "T n"],
        ddq: Float[Array, "T n"],
        rigid: Float[Array, "T n"],
        interval: float,
    ) -> Float[Array, "T n"]:
        """Torque beside the analytic model and laws; zero at joints without memory [N m].

        Args:
            q, dq, ddq: States that follow one another.
            rigid: Torque of the rigid arm there [N m].
            interval: Time between them [s].
        """
        out = np.zeros(q.shape)
        for joint, trees in enumerate(self.trees):
            if trees is not None:
                out[:, joint] = trees(memory_inputs(q, dq, ddq, rigid, joint, interval))
        return out * self.nearness.fall(np.asarray(q, dtype=float))

    def save(self, folder: Path) -> None:
        """Writes memory.safetensors and memory.json into a folder."""
        from safetensors.numpy import save_file

        arrays: dict[str, Array] = {"poses": self.nearness.poses, "reach": self.nearness.reach}
        for joint, trees in enumerate(self.trees):
            if trees is not None:
                arrays[f"inputs.{joint}"] = trees.inputs
                arrays[f"thresholds.{joint}"] = trees.thresholds
                arrays[f"leaves.{joint}"] = trees.leaves
        with atomic_write(folder / FILE) as scratch:
            save_file(
                {name: np.ascontiguousarray(values) for name, values in arrays.items()}, scratch
            )
        record: JsonRecord = {"joints": self.n, "ranges_rad": RANGES, "times_s": TIMES}
        with atomic_write(folder / RECORD) as scratch:
            scratch.write_text(as_json(record), encoding="utf-8")

    @classmethod
    def load(cls, folder: Path, joints: int) -> JointMemory:
        """Reads it back.

        Raises:
            ModelError: A file is missing or damaged.
        """
        path = folder / FILE
        try:
            record = read_json(folder / RECORD, "fit the model again", ModelError)
            same = tuple(record["ranges_rad"]) == RANGES and tuple(record["times_s"]) == TIMES
            if record["joints"] != joints or not same:
                raise ValueError("it is of another arm or version")
            from safetensors.numpy import load

            arrays = load(read_bytes(path, "fit the model again", ModelError))
            nearness = Nearness(arrays["poses"], arrays["reach"])
            if nearness.reach.shape != (joints,):
                raise ValueError(f"its poses are not of {joints} joints")
            trees = tuple(_read_trees(arrays, joint, joints) for joint in range(joints))
            return cls(trees, nearness)
        except ModelError:
            raise
        except Exception as error:  # safetensors and json each raise their own
            raise ModelError(
                path, f"the saved memory can't be read ({error})", "fit the model again"
            ) from None


def _read_trees(arrays: dict[str, Array], joint: int, joints: int) -> Trees | None:
    if f"leaves.{joint}" not in arrays:
        return None
    inputs, thresholds, leaves = (
        arrays[f"{name}.{joint}"] for name in ("inputs", "thresholds", "leaves")
    )
    if (
        inputs.shape != thresholds.shape
        or inputs.ndim != 2
        or leaves.shape != (len(inputs), 1 << inputs.shape[1])
    ):
        raise ValueError(f"the trees of joint {joint + 1} do not fit together")
    if (
        inputs.shape[1] != DEPTH
        or not np.isfinite(thresholds).all()
        or not np.isfinite(leaves).all()
    ):
        raise ValueError(f"a tree of joint {joint + 1} is damaged")
    most = own_inputs() + SEVERAL * joints
    if inputs.min(initial=0) < 0 or inputs.max(initial=0) >= most:
        raise ValueError(f"a tree of joint {joint + 1} asks for an input that there is not")
    return Trees(inputs.astype(np.int64), thresholds.astype(float), leaves.astype(float))


def own_inputs() -> int:
    """How many inputs are a joint's own."""
    return 6 + len(RANGES) + 4 * len(TIMES)


@dataclass(frozen=True, eq=False)
class _Rows:
    """What a session leaves of every joint's torque, thinned."""

    inputs: tuple[BinnedInputs, ...]  # of each joint
    q: Float[Array, "T n"]  # positions [rad]
    left: Float[Array, "T n"]  # [N m]
    moving: Bool[Array, "T n"]
    travel: Float[Array, "T n"]  # from row to row [rad]
    run: Int[Array, " T"]
    blocks: Int[Array, " T"]


def fit_memory(unexplained: Unexplained, seed: int) -> JointMemory:
    """Fits each joint's trees, as far as they help on blocks and runs that they did not see.

    Args:
        unexplained: What analytic model and laws leave of the training runs.
        seed: Of the trees.
    """
    count = sum(len(values) for values in unexplained.left)
    every = -(-count // MOST_ROWS)
    rows = _thinned(unexplained, every)
    by_block = np.zeros(rows.left.shape)
    chosen = []
    for joint in range(rows.left.shape[1]):
        by_block[:, joint], kind = _foretell(rows, joint, rows.blocks % FOLDS, seed)
        chosen.append(kind)
    witnesses = (rows.left, rows.moving, rows.travel, rows.blocks, rows.run)
    helped = [verdict.kept for verdict in shrink_bounded(by_block, *witnesses)]
    square = nearest_left_out(rows.q, rows.blocks % FOLDS)
    kinds = np.where(helped, chosen, NOBODYS)
    weight, reach = _choose_shares(rows, by_block, square, kinds, seed)
    gate = gate_of(weight, by_block * fall(square[:, None], reach), *witnesses)
    fewer = -(-count // FITTED_ROWS)
    whole = rows if fewer == every else _thinned(unexplained, fewer)
    trees: list[Trees | None] = []
    for joint, verdict in enumerate(gate):
        if not verdict.kept:
            trees.append(None)
            continue
        seen = np.flatnonzero(whole.moving[:, joint])
        of_joint, _ = _fit_kind(
            whole.inputs[joint], whole.left[:, joint], seen, chosen[joint], seed
        )
        trees.append(of_joint.scaled(verdict.weight))
    nearness = Nearness(rows.q[spread_poses(len(rows.q))], reach)
    return JointMemory(_of_one_size(trees), nearness, gate)


def _choose_shares(
    rows: _Rows,
    by_block: Float[Array, "T n"],
    of_block: Float[Array, " T"],
    kinds: Int[Array, " n"],
    seed: int,
) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
    """Share and reach [rad] of each joint's memory, by blocks and whole runs left out.

    Args:
        rows: The rows.
        by_block: What was said of them by trees that did not see their block [N m].
        of_block: Square of their distance to the poses that those saw [rad²].
        kinds: Whose inputs each joint's trees are given; `NOBODYS` where it has none.
        seed: Of the trees.
    """
    of_run = nearest_left_out(rows.q, rows.run % FOLDS)
    several = len(np.unique(rows.run)) >= FEWEST_RUNS
    weight = np.zeros(len(kinds))
    reach = np.full(len(kinds), np.inf)
    for joint in np.flatnonzero(kinds != NOBODYS).tolist():
        ways = [(by_block[:, joint], of_block)]
        if several:
            by_run = _foretell_kind(rows, joint, rows.run % FOLDS, seed, int(kinds[joint]))
            ways.append((by_run, of_run))
        moving = rows.moving[:, joint]
        left_out = [LeftOut(torque[moving], square[moving]) for torque, square in ways]
        weight[joint], reach[joint] = choose_share(left_out, rows.left[moving, joint])
    return weight, reach


def _thinned(unexplained: Unexplained, every: int) -> _Rows:
    """One of so many rows of all runs."""
    motions = unexplained.motions
    states = unexplained.states
    left = unexplained.left
    step = unexplained.interval
    joints = left[0].shape[1]
    lengths = [len(values[::every]) for values in left]
    recorded = np.cumsum([not motion.continues for motion in motions]) - 1
    pace = np.concatenate([dq[::every] for _, dq, _, _ in states])
    of_all = [np.concatenate(run, axis=1)[::every] for run in states]
    moving = np.concatenate([motion.moving[::every] for motion in motions])
    shared = BinnedInputs.of(np.concatenate(of_all), np.any(moving, axis=1))
    inputs = []
    for joint in range(joints):
        parts = [_inputs_of_joint(*run, joint=joint, interval=step)[::every] for run in states]
        of_joint = BinnedInputs.of(np.concatenate(parts), moving[:, joint])
        inputs.append(of_joint.beside(shared))
    return _Rows(
        inputs=tuple(inputs),
        q=np.concatenate([q[::every] for q, _, _, _ in states]),
        left=np.concatenate([values[::every] for values in left]),
        moving=moving,
        travel=step * every * pace,
        run=np.repeat(recorded, lengths),
        blocks=cut_blocks(lengths),
    )


def cut_blocks(lengths: Sequence[int]) -> Int[Array, " T"]:
    """Number of the block of every sample: pieces of runs, as long as the others or a whole run.

    Args:
        lengths: Samples of each run.
    """
    parts = []
    first = 0
    for length in lengths:
        count = max(1, round(length * BLOCKS / max(1, sum(lengths))))
        parts.append(first + np.arange(length) * count // max(length, 1))
        first += count
    return np.concatenate(parts)


def _of_one_size(trees: Sequence[Trees | None]) -> tuple[Trees | None, ...]:
    """The same, all of as many trees: some that say nothing make up the number."""
    sizes = [len(of_joint.inputs) for of_joint in trees if of_joint is not None]
    most = max(sizes, default=0)
    return tuple(None if of_joint is None else of_joint.padded(most) for of_joint in trees)


def _foretell(
    rows: _Rows, joint: int, folds: Int[Array, " T"], seed: int
) -> tuple[Float[Array, " T"], int]:
    """What trees of the other parts say of each part, and whose inputs they are best given."""
    by_joint = _foretell_kind(rows, joint, folds, seed, OWN)
    by_all = _foretell_kind(rows, joint, folds, seed, ALL)
    said = np.stack([by_joint, by_all, 0.5 * (by_joint + by_all)])
    moving = rows.moving[:, joint]
    residuals = (rows.left[:, joint] - said)[:, moving]
    errors = np.sum(residuals**2, axis=1)
    best = int(np.argmin(errors))
    return said[best], best


def _foretell_kind(
    rows: _Rows, joint: int, folds: Int[Array, " T"], seed: int, kind: int
) -> Float[Array, " T"]:
    """What trees of one kind, fitted to the other parts, say of each part of a joint.

    Zero where rows are too few.
    """
    moving = rows.moving[:, joint]
    said = np.zeros(len(moving))
    if moving.sum() < FEWEST_ROWS:
        return said
    for fold in np.unique(folds):
        asked = folds == fold
        seen = np.flatnonzero(moving & ~asked)
        if len(seen) >= FEWEST_ROWS:
            of_all = _fit_kind(rows.inputs[joint], rows.left[:, joint], seen, kind, seed)[1]
            said[asked] = of_all[asked]
    return said


def _fit_kind(
    inputs: BinnedInputs, y: Float[Array, " T"], seen: Int[Array, " k"], kind: int, seed: int
) -> tuple[Trees, Float[Array, " T"]]:
    """Trees of a joint's own inputs, of all, or half of both, and what they say of all rows."""
    if kind == ALL:
        return grow_trees(inputs, y, seen, seed)
    by_joint, said_by_joint = grow_trees(inputs.first(own_inputs()), y, seen, seed)
    if kind == OWN:
        return by_joint, said_by_joint
    by_all, said_by_all = grow_trees(inputs, y, seen, seed)
    both = join_trees(by_joint.scaled(0.5), by_all.scaled(0.5))
    return both, 0.5 * (said_by_joint + said_by_all)
