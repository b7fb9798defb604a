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
standard error cost torque on most of eight real arms. Blocks and not whole runs: a recording has
few, and half of it foretells the other half far worse than all of it foretells a third motion. A
net needs whole runs for its gate, since it makes up torques where it never was; trees do not.

States that do not follow one another, as a planner's nodes, have no memory: there the net counts.

Source: Al-Bender 2005 (stop operators); Kohavi 1994 (oblivious trees); Breiman 1996 (bagging).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ident.arrays import Array, Bool, Float, Int
from ident.compiled import compiled
from ident.errors import ModelError
from ident.files import atomic_write
from ident.model.boosted import DEPTH, Trees, fit_trees, join_trees
from ident.model.folds import FOLDS
from ident.model.joint_nets import joint_features
from ident.model.linearisation import stop_operator
from ident.model.net_gate import JointGate, shrink_bounded
from ident.model.residual_net import TRAINED_SAMPLES, Known
from ident.motion.motion import Motion
from ident.motion.stretches import hold
from ident.records import as_json
from ident.robot.arm import ArmModel
from ident.safe_read import read_json, require_regular

# Ranges of the stop operators [rad].
RANGES = (1e-3, 1e-2, 1e-1)
# Times over which averages are taken [s].
TIMES = (0.1, 0.3, 0.8)
# Speed over which a joint's direction turns round in its average [rad/s].
TURNING = 0.02
# Rows that the trees of a joint are fitted to; of more, every second or third is taken.
MOST_ROWS = 5000
# Fewer rows than this tell nothing of a joint.
FEWEST_ROWS = 100
# Blocks that recordings are cut into at least.
BLOCKS = 8
# Whose inputs a joint's trees are given: its own, those of all joints, or half of each.
OWN, ALL, BOTH = range(3)
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
    """A signal's average over about the last `time` [s]; before, it had its first value."""
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
    """Inputs of one joint: its own, then the states of all."""
    angle = np.ascontiguousarray(q[:, joint])
    pace = dq[:, joint]
    joint_load = load[:, joint]
    heading = np.tanh(pace / TURNING)
    history = [stop_operator(angle, size) / size for size in RANGES]
    for time in TIMES:
        history += [
            lagged(heading, interval, time),
            lagged(np.abs(pace), interval, time),
            lagged(joint_load, interval, time) - joint_load,
            angle - lagged(angle, interval, time),
        ]
    now = joint_features(pace, ddq[:, joint], joint_load)
    return np.concatenate([now, np.column_stack(history), q, dq, ddq, load], axis=1)


@dataclass(frozen=True, eq=False)
class JointMemory:
    """Trees of the joints that keep them."""

    trees: tuple[Trees | None, ...]  # of each joint; None where the net, or nothing, is as good
    gate: tuple[JointGate, ...] = ()  # what they did on runs left out, if they were fitted here

    @property
    def n(self) -> int:
        return len(self.trees)

    @property
    def kept(self) -> Bool[Array, " n"]:
        """Joints that have a memory."""
        return np.array([trees is not None for trees in self.trees])

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
        return out

    def save(self, folder: Path) -> None:
        """Writes memory.safetensors and memory.json into a folder."""
        from safetensors.numpy import save_file

        arrays: dict[str, Array] = {}
        for joint, trees in enumerate(self.trees):
            if trees is not None:
                arrays[f"inputs.{joint}"] = np.ascontiguousarray(trees.inputs)
                arrays[f"thresholds.{joint}"] = np.ascontiguousarray(trees.thresholds)
                arrays[f"leaves.{joint}"] = np.ascontiguousarray(trees.leaves)
        with atomic_write(folder / FILE) as file:
            save_file(arrays, file)
        record: dict[str, Any] = {"joints": self.n, "ranges_rad": RANGES, "times_s": TIMES}
        with atomic_write(folder / RECORD) as file:
            file.write_text(as_json(record), encoding="utf-8")

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
            require_regular(path, "fit the model again", ModelError)
            from safetensors.numpy import load_file

            arrays = load_file(path)
            return cls(tuple(_read_trees(arrays, joint, joints) for joint in range(joints)))
        except ModelError:
            raise
        except Exception as error:  # safetensors and json each raise their own
            what = f"the saved memory can't be read ({error})"
            raise ModelError(path, what, "fit the model again") from None


def _read_trees(arrays: dict[str, Array], joint: int, joints: int) -> Trees | None:
    """Trees of a joint, if it has any; ValueError where they are damaged."""
    if f"leaves.{joint}" not in arrays:
        return None
    inputs = arrays[f"inputs.{joint}"]
    thresholds = arrays[f"thresholds.{joint}"]
    leaves = arrays[f"leaves.{joint}"]
    fit = inputs.shape == thresholds.shape and inputs.ndim == 2
    if not fit or leaves.shape != (len(inputs), 1 << inputs.shape[1]):
        raise ValueError(f"the trees of joint {joint + 1} do not fit together")
    finite = np.isfinite(thresholds).all() and np.isfinite(leaves).all()
    if inputs.shape[1] != DEPTH or not finite:
        raise ValueError(f"a tree of joint {joint + 1} is damaged")
    if inputs.min(initial=0) < 0 or inputs.max(initial=0) >= own_inputs() + SEVERAL * joints:
        raise ValueError(f"a tree of joint {joint + 1} asks for an input that there is not")
    return Trees(inputs.astype(np.int64), thresholds.astype(float), leaves.astype(float))


def own_inputs() -> int:
    """How many inputs are a joint's own."""
    return 6 + len(RANGES) + 4 * len(TIMES)


def fit_memory(
    motions: Sequence[Motion],
    arm: ArmModel,
    left: Sequence[Float[Array, "t n"]],
    seed: int,
) -> JointMemory:
    """Fits each joint's trees, as far as they help on blocks that they did not see.

    Args:
        motions: Training runs.
        arm: The identified rigid arm.
        left: Of each run, what analytic model and laws leave of its torque [N m].
        seed: Of the trees.
    """
    every = -(-sum(map(len, left)) // MOST_ROWS)
    y = np.concatenate([residual[::every] for residual in left])
    moving = np.concatenate([motion.moving[::every] for motion in motions])
    pace = np.concatenate([motion.dq[motion.coarse][::every] for motion in motions])
    step = motions[0].interval * motions[0].lowpass.factor
    lengths = [len(residual[::every]) for residual in left]
    blocks = cut_blocks(lengths)
    run = np.repeat(np.arange(len(lengths)), lengths)
    states = _filtered_states(motions, arm)
    tables = [_joint_inputs(states, joint, step, every) for joint in range(arm.n)]
    predicted = np.zeros(y.shape)
    kinds = []
    for joint, x in enumerate(tables):
        predicted[:, joint], kind = _foretell(
            x, y[:, joint], moving[:, joint], blocks % FOLDS, seed
        )
        kinds.append(kind)
    gate = shrink_bounded(predicted, y, moving, step * every * pace, blocks, run)
    trees: list[Trees | None] = []
    for joint, verdict in enumerate(gate):
        if not verdict.kept:
            trees.append(None)
            continue
        rows = moving[:, joint]
        whole = _fit_kind(tables[joint][rows], y[rows, joint], kinds[joint], seed)
        trees.append(whole.scaled(verdict.weight))
    return JointMemory(_of_one_size(trees), gate)


def _filtered_states(
    motions: Sequence[Motion], arm: ArmModel
) -> list[tuple[Array, Array, Array, Array]]:
    """Angle, speed, acceleration and rigid torque of each run's filtered samples."""
    states = []
    for motion in motions:
        rigid = arm.with_payload(motion.payload).inverse_dynamics(motion.q, motion.dq, motion.ddq)
        coarse = motion.coarse
        states.append((motion.q[coarse], motion.dq[coarse], motion.ddq[coarse], rigid[coarse]))
    return states


def cut_blocks(lengths: Sequence[int]) -> Int[Array, " T"]:
    """Number of the block of every sample: equal pieces of runs, or whole runs.

    Args:
        lengths: Samples of each run.
    """
    blocks = []
    first = 0
    for length in lengths:
        count = max(1, round(length * BLOCKS / max(1, sum(lengths))))
        blocks.append(first + np.arange(length) * count // max(length, 1))
        first += count
    return np.concatenate(blocks)


def _joint_inputs(
    states: Sequence[tuple[Array, Array, Array, Array]], joint: int, step: float, every: int
) -> Float[Array, "T f"]:
    """Inputs of one joint along all runs, thinned."""
    tables = [memory_inputs(*run, joint=joint, interval=step)[::every] for run in states]
    return np.concatenate(tables)


def _of_one_size(trees: Sequence[Trees | None]) -> tuple[Trees | None, ...]:
    """The same, all of as many trees: some that say nothing make up the number."""
    most = max((len(some.inputs) for some in trees if some is not None), default=0)
    return tuple(None if some is None else some.padded(most) for some in trees)


def fit_memory_of_arm(
    motions: Sequence[Motion],
    arm: ArmModel,
    known: Known,
    seed: int,
) -> JointMemory:
    """Fits the memory, of a long session to stretches from all over it.

    Args:
        motions: Training runs.
        arm: The identified rigid arm.
        known: What is known of the torque beside it.
        seed: Of the trees.
    """
    held = hold(motions, TRAINED_SAMPLES).motions
    left = []
    for motion in held:
        rigid = arm.with_payload(motion.payload).inverse_dynamics(motion.q, motion.dq, motion.ddq)
        left.append(motion.tau_filtered - motion.filtered(rigid + known(motion, rigid)))
    return fit_memory(held, arm, left, seed)


def _foretell(
    x: Float[Array, "T f"],
    y: Float[Array, " T"],
    moving: Bool[Array, " T"],
    folds: Int[Array, " T"],
    seed: int,
) -> tuple[Float[Array, " T"], int]:
    """What trees of the other parts say of each part, and whose inputs they are best given."""
    said = np.zeros((3, len(y)))
    if moving.sum() < FEWEST_ROWS:
        return said[OWN], OWN
    for fold in np.unique(folds):
        inside = folds == fold
        rows = moving & ~inside
        if rows.sum() < FEWEST_ROWS:
            continue
        for kind, count in ((OWN, own_inputs()), (ALL, x.shape[1])):
            trees = fit_trees(x[rows, :count], y[rows], seed)
            said[kind, inside] = trees(x[inside, :count])
    said[BOTH] = 0.5 * (said[OWN] + said[ALL])
    errors = np.sum(((y - said)[:, moving]) ** 2, axis=1)
    best = int(np.argmin(errors))
    return said[best], best


def _fit_kind(x: Float[Array, "T f"], y: Float[Array, " T"], kind: int, seed: int) -> Trees:
    """Trees of a joint's own inputs, of all, or half of both."""
    if kind == OWN:
        return fit_trees(x[:, : own_inputs()], y, seed)
    if kind == ALL:
        return fit_trees(x, y, seed)
    of_joint = fit_trees(x[:, : own_inputs()], y, seed)
    of_all = fit_trees(x, y, seed)
    return join_trees(of_joint.scaled(0.5), of_all.scaled(0.5))
