"""ResidualNet: a network for what the rigid arm and the loss parameters leave.

    τ_DNN = DNN(q, dq, ddq)

Two presets. `paper` is the paper's net: 256-512-1024-512-256 tanh, dropout 0.5, Adam, mean square
error, 100 epochs, 70 % of the samples for training. `default` has about 1/100 of its parameters and
a lower held-out error: a small net a joint that sees the joint's own speed, acceleration, direction
of motion at two scales, and the rigid torque that the joint carries (itself a function of q, dq,
ddq). It is solved for, not trained (see `random_features`); its shape is chosen on quarters of the
recorded runs left out in turn (neighbouring samples are copies of each other, so a random split
can't tell fitting from memorising), and it counts as far as it beats "no residual" in torque and
energy there. Beyond the speeds, accelerations and loads of its training its output is that at their
edge (see `net_bounds`).

Source: paper, eq. 4 and 6 and section 4.1.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from errno import EIO
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ident.arrays import Array, Bool, Float, Int, freeze
from ident.errors import ModelError
from ident.files import atomic_write
from ident.model.folds import make_folds
from ident.model.joint_nets import JointNets, joint_features
from ident.model.net_bounds import NetBounds
from ident.model.net_gate import JointGate, shrink_net
from ident.model.net_options import PRESETS, NetOptions
from ident.model.random_features import solve_net
from ident.motion.motion import Motion
from ident.motion.stretches import hold
from ident.records import JsonRecord, as_json
from ident.robot.arm import ArmModel
from ident.safe_read import read_bytes, read_json

if TYPE_CHECKING:
    from ident.model.dense_training import DenseNet, Progress

__all__ = ["PRESETS", "NetOptions", "ResidualNet", "fit_residual_net"]

# Torque of a run beside the rigid arm's: the motion, its rigid torque → [N m].
Known = Callable[[Motion, Float[Array, "T n"]], Float[Array, "T n"]]
# Figures a joint that a net a joint is given.
JOINT_FEATURES = 6
# Samples of a longer session that a net is trained on, as stretches from all over it: steps and
# memory grow with them.
TRAINED_SAMPLES = 200_000
# Samples that a net a joint is solved with: of more, every second or third is taken. Neighbours on
# the filtered grid, which has four samples a period of the filter's corner, are near-copies.
MOST_SAMPLES = 8000
# Least scale of a feature, and of a joint's torque [N m].
LEAST_FEATURE = 1e-6
LEAST_TORQUE = 1e-9


@dataclass(frozen=True, eq=False)
class ResidualNet:
    """A trained net."""

    options: NetOptions  # how it was built
    # A net a joint, or the dense net as a torch module in evaluation mode; treat as read-only.
    network: JointNets | DenseNet
    # Standardisation of the features, shape (f,) for the dense net, (n, f) for a net a joint.
    input_mean: Float[Array, "..."]
    input_std: Float[Array, "..."]
    output_std: Float[Array, " n"]  # scale of each joint's output [N m], shape (n,)
    # What the net did on runs that it never saw, joint by joint, if it was fitted here.
    gate: tuple[JointGate, ...] = ()
    bounds: NetBounds | None = None  # where a net a joint was fitted; the paper's net has none

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.output_std)

    @property
    def parameters(self) -> int:
        """Number of trained weights."""
        if isinstance(self.network, JointNets):
            return self.network.size
        return sum(weight.numel() for weight in self.network.parameters())

    def predict(
        self,
        q: Float[Array, "T n"],
        dq: Float[Array, "T n"],
        ddq: Float[Array, "T n"],
        rigid: Float[Array, "T n"],
    ) -> Float[Array, "T n"]:
        """Residual torque [N m].

        Args:
            q, dq, ddq: Joint states.
            rigid: Torque of the rigid arm at these states, which the net was trained with [N m].

        Source: paper, eq. 4.
        """
        if self.bounds is not None:
            dq, ddq, rigid = self.bounds.clip(dq, ddq, rigid)
        if isinstance(self.network, JointNets):
            x = (joint_features(dq, ddq, rigid) - self.input_mean) / self.input_std
            torque = np.asarray(self.network(x).astype(float) * self.output_std)
            return torque if self.bounds is None else self.bounds.clip_torque(torque)
        x = (np.concatenate([q, dq, ddq], axis=1) - self.input_mean) / self.input_std
        return self.network.run(x) * self.output_std

    def save(self, folder: Path) -> None:
        """Writes residual.safetensors and residual.json into a folder.

        Raises:
            OSError: The system can't: the disk is full, say.
        """
        from safetensors import SafetensorError
        from safetensors.numpy import save_file

        arrays = {}
        for name, values in self.network.arrays().items():
            arrays[name] = np.ascontiguousarray(values)
        with atomic_write(folder / "residual.safetensors") as file:
            try:
                save_file(arrays, file)
            except SafetensorError as error:
                raise OSError(EIO, str(error), str(file)) from None
        record: JsonRecord = {"options": asdict(self.options), "parameters": self.parameters}
        for name in ("input_mean", "input_std", "output_std"):
            record[name] = getattr(self, name).tolist()
        if self.bounds is not None:
            record["bounds"] = self.bounds.to_dict()
        with atomic_write(folder / "residual.json") as file:
            file.write_text(as_json(record), encoding="utf-8")

    @classmethod
    def load(cls, folder: Path) -> ResidualNet:
        """Reads a saved net.

        Raises:
            ModelError: A file is missing or damaged.
        """
        path = folder / "residual.json"
        try:
            return cls._read(folder, read_json(path, "fit the model again", ModelError))
        except ModelError:
            raise
        except Exception as error:  # torch, safetensors and json each raise their own
            what = f"the saved net can't be read ({error})"
            raise ModelError(path, what, "fit the model again") from None

    @classmethod
    def _read(cls, folder: Path, record: JsonRecord) -> ResidualNet:
        """The net of a record and of the weights beside it; any error where it is damaged."""
        hidden = tuple(record["options"]["hidden"])
        options = NetOptions(**{**record["options"], "hidden": hidden})
        mean = freeze(record["input_mean"])
        std = freeze(record["input_std"])
        scale = freeze(record["output_std"])
        weights = read_bytes(folder / "residual.safetensors", "fit the model again", ModelError)
        from safetensors.numpy import load

        arrays = load(weights)
        if not all(np.isfinite(values).all() for values in arrays.values()):
            raise ValueError("a weight is not finite")
        n = len(scale)
        network: JointNets | DenseNet
        bounds: NetBounds | None = None
        inputs: tuple[int, ...]
        if options.preset == "paper":
            _require_weights(options, mean.shape[-1], len(weights))
            from ident.model.dense_training import DenseNet  # torch is slow to load

            network = DenseNet.from_arrays(arrays, mean.shape[-1], n, options)
            inputs = (3 * n,)
        else:
            network = JointNets.from_arrays(arrays, n, JOINT_FEATURES)
            bounds = NetBounds.from_dict(record["bounds"], n)
            inputs = (n, JOINT_FEATURES)
        if not mean.shape == std.shape == inputs or scale.ndim != 1:
            raise ValueError("its scales are of another number of joints or inputs")
        _require_scales(mean, std, scale)
        return cls(options, network, mean, std, scale, bounds=bounds)


def _require_weights(options: NetOptions, inputs: int, size: int) -> None:
    """Raises ValueError where options speak of a larger net than a file of so many bytes holds.

    The options decide how much memory a net takes: its weights must be there before they are
    believed.
    """
    widths = [inputs, *map(int, options.hidden), 1]
    weights = sum(before * after for before, after in pairwise(widths))
    if min(widths) < 1 or 4 * weights > size:
        raise ValueError("its options speak of more weights than there are")


def _require_scales(
    mean: Float[Array, "..."], std: Float[Array, "..."], scale: Float[Array, " n"]
) -> None:
    """Raises ValueError where a scale overflows in single precision, in which nets reckon."""
    with np.errstate(over="ignore"):
        single = [np.asarray(values, dtype=np.float32) for values in (mean, std, scale)]
    is_finite = all(np.isfinite(values).all() for values in single)
    if not is_finite or not (single[1] > 0).all():
        raise ValueError("a scale is not finite and positive")


def fit_residual_net(
    states: Sequence[tuple[Array, Array, Array, Array]],
    residuals: Sequence[Float[Array, "T n"]],
    moving: Sequence[Bool[Array, "T n"]] | None = None,
    options: NetOptions | None = None,
    progress: Progress | None = None,
    checkpoint: Path | None = None,
    interval: float = 1.0,
) -> ResidualNet:
    """Fits a net to what a model leaves, as far as it helps on runs that it never saw.

    How far that is: see `net_gate`.

    Args:
        states: (q, dq, ddq, rigid torque) of every run, each of shape (T, n).
        residuals: Residual torque of every run [N m].
        moving: Where each joint moves; the torque of a joint at rest is no function of the state
            and is left out of the error. All samples count if None, as in the paper.
        options: Preset or own options.
        progress: Called after each epoch, or joint, with (its number, how many, held-back error).
        checkpoint: Folder for checkpoints; a training of the same data and options goes on where it
            stopped.
        interval: Time between two samples of a run [s]; gives the gate's energies their unit.

    Returns:
        The net. Same seed, same weights.

    Source: paper, eq. 6.
    """
    options = options or PRESETS["default"]
    every = 1
    if options.preset != "paper":
        every = -(-sum(map(len, residuals)) // MOST_SAMPLES)
    lengths = [len(angles[::every]) for angles, *_ in states]
    channels = zip(*states, strict=True)
    q, dq, ddq, rigid = (_thinned(of_runs, every) for of_runs in channels)
    y = np.concatenate([residual[::every] for residual in residuals])
    mask = np.ones_like(y)
    if moving is not None:
        mask = np.concatenate([rows[::every] for rows in moving]).astype(float)
    power = (mask * y**2).sum(axis=0) / np.maximum(mask.sum(axis=0), 1.0)
    scale = np.maximum(np.sqrt(power), LEAST_TORQUE)
    if options.preset == "paper":
        from ident.model.dense_training import train_dense

        x = np.concatenate([q, dq, ddq], axis=1)
        mean, std = _standardise(x)
        dense = train_dense((x - mean) / std, y / scale, mask, options, progress, checkpoint)
        return ResidualNet(options, dense, freeze(mean), freeze(std), freeze(scale))
    folds, groups = make_folds(lengths, every, np.random.default_rng(options.seed))
    seen = np.stack([dq, ddq, rigid])
    counts = mask > 0.0
    bounds = NetBounds.of(seen, counts)
    x = joint_features(*bounds.clip(*seen))
    strange = _strange_features(seen, counts, folds, bounds)
    mean, std = _standardise(x)
    inputs = ((x - mean) / std, (strange - mean) / std)
    network, unseen = _solve(inputs, y / scale, counts, folds, options.seed, progress)
    run = np.repeat(np.arange(len(lengths)), lengths)
    gate = shrink_net(scale * unseen, y, counts, interval * every * dq, groups, run)
    network = network.scaled([verdict.weight for verdict in gate])
    bounds = bounds.with_torques(scale * network(inputs[0]), counts)
    return ResidualNet(options, network, freeze(mean), freeze(std), freeze(scale), gate, bounds)


def _thinned(runs: Sequence[Float[Array, "T n"]], every: int) -> Float[Array, "t n"]:
    """One of so many samples of each run, all runs together."""
    return np.concatenate([values[::every] for values in runs])


def _standardise(x: Float[Array, "..."]) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
    """Mean and scale of features."""
    return x.mean(axis=0), np.maximum(x.std(axis=0), LEAST_FEATURE)


def _strange_features(
    seen: Float[Array, "3 T n"],
    counts: Bool[Array, "T n"],
    folds: Int[Array, " T"],
    bounds: NetBounds,
) -> Float[Array, "T n f"]:
    """Features of every sample as a net sees them that has not seen the sample's part."""
    strange = np.empty((*counts.shape, JOINT_FEATURES))
    for fold in np.unique(folds):
        inside = folds == fold
        others = bounds
        if not inside.all():
            others = NetBounds.of(seen[:, ~inside], counts[~inside])
        strange[inside] = joint_features(*others.clip(*seen[:, inside]))
    return strange


def _solve(
    inputs: tuple[Float[Array, "T n f"], Float[Array, "T n f"]],
    y: Float[Array, "T n"],
    counts: Bool[Array, "T n"],
    folds: Int[Array, " T"],
    seed: int,
    progress: Progress | None,
) -> tuple[JointNets, Float[Array, "T n"]]:
    """The nets of all joints, and what each says of the parts that it was not solved with."""
    x, strange = inputs
    joints = y.shape[1]
    solved = []
    for j in range(joints):
        net = solve_net(x[:, j], y[:, j], counts[:, j], folds, seed, strange[:, j])
        solved.append(net)
        if progress is not None:
            progress(j + 1, joints, net.error)
    first = np.stack([net.weights[0] for net in solved])
    last = np.stack([net.weights[1] for net in solved])
    bias = np.stack([net.biases[0] for net in solved])[:, None]
    offset = np.stack([net.biases[1] for net in solved])[:, None]
    unseen = np.stack([net.unseen for net in solved], axis=1)
    return JointNets((first, last), (bias, offset)), unseen


@dataclass(frozen=True, eq=False)
class Unexplained:
    """What a model leaves of its runs' torque, and the states it leaves it at."""

    motions: tuple[Motion, ...]
    # Of each run on the filtered grid: angle, speed, acceleration, torque of the rigid arm.
    states: tuple[tuple[Array, Array, Array, Array], ...]
    left: tuple[Float[Array, "t n"], ...]  # of each run [N m]

    @classmethod
    def by(cls, motions: Sequence[Motion], arm: ArmModel, known: Known) -> Unexplained:
        """What an arm and what is known beside it leave; of a long session, stretches all over it.

        Args:
            motions: Training runs.
            arm: The identified rigid arm.
            known: What is known of the torque beside it.
        """
        motions = hold(motions, TRAINED_SAMPLES).motions
        states = []
        left = []
        for motion in motions:
            q = motion.q
            dq = motion.dq
            ddq = motion.ddq
            rigid = arm.with_payload(motion.payload).inverse_dynamics(q, dq, ddq)
            coarse = motion.coarse
            states.append((q[coarse], dq[coarse], ddq[coarse], rigid[coarse]))
            left.append(motion.tau_filtered - motion.filtered(rigid + known(motion, rigid)))
        return cls(tuple(motions), tuple(states), tuple(left))

    @property
    def interval(self) -> float:
        """Time between two of a run's states [s]."""
        return self.motions[0].interval * self.motions[0].lowpass.factor


def fit_net_of_arm(
    unexplained: Unexplained,
    options: NetOptions,
    progress: Callable[[int, int, float], None] | None,
    checkpoint: Path | None,
) -> ResidualNet:
    """Fits the net.

    Args:
        unexplained: What the arm leaves of its training runs.
        options: A preset with its seed.
        progress: Called after each joint, or epoch.
        checkpoint: Folder in which training may stop and go on.
    """
    states = unexplained.states
    moving = None
    if options.preset != "paper":
        moving = [motion.moving for motion in unexplained.motions]
    left = unexplained.left
    interval = unexplained.interval
    return fit_residual_net(states, left, moving, options, progress, checkpoint, interval)
