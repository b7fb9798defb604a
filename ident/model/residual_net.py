"""ResidualNet: a network for what the rigid arm and the loss parameters leave.

    τ_DNN = DNN(q, dq, ddq)

Two presets. `paper` is the paper's net: 256-512-1024-512-256 tanh, dropout 0.5, Adam, mean square error, 100 epochs,
70 % of the samples for training. `default` has about 1/100 of its parameters and a lower held-out error: a small net a
joint that sees the joint's own speed, acceleration, direction of motion at two scales, and the rigid torque that the
joint carries (itself a function of q, dq, ddq). It is solved for, not trained (see `random_features`); its shape is
chosen on quarters of the recorded runs left out in turn (neighbouring samples are copies of each other, so a random
split can't tell fitting from memorising), and it counts as far as it beats "no residual" in torque and energy there.
Beyond the speeds, accelerations and loads of its training its output is that at their edge (see `net_bounds`).

Source: paper, eq. 4 and 6 and section 4.1.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from errno import EIO
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ident.arrays import Array, Bool, Float, Int, freeze
from ident.errors import ModelError
from ident.files import atomic_write
from ident.model.joint_nets import JointNets, NetBounds, joint_features, solve_net
from ident.model.net_gate import JointGate, make_folds, shrink_net
from ident.model.net_options import PRESETS, NetOptions
from ident.motion.motion import Motion
from ident.motion.stretches import hold
from ident.records import as_json
from ident.robot.arm import ArmModel
from ident.safe_read import read_json, require_regular

if TYPE_CHECKING:
    from ident.model.dense_training import DenseNet, Progress

__all__ = ["PRESETS", "NetOptions", "ResidualNet", "fit_residual_net"]

# Torque of a run beside the rigid arm's: the motion, its rigid torque → [N m].
Known = Callable[[Motion, Float[Array, "T n"]], Float[Array, "T n"]]
# Figures a joint that a net a joint is given.
JOINT_FEATURES = 6
# Samples of a longer session that a net is trained on, as stretches from all over it: steps and memory grow with them.
TRAINED_SAMPLES = 200_000
# Samples that a net a joint is solved with: of more, every second or third is taken. Neighbours on the filtered grid,
# which has four samples a period of the filter's corner, are near-copies.
MOST_SAMPLES = 8000


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
            return np.asarray(self.network(x).astype(float) * self.output_std)
        x = (np.concatenate([q, dq, ddq], axis=1) - self.input_mean) / self.input_std
        return self.network.run(x) * self.output_std

    def save(self, folder: Path) -> None:
        """Writes residual.safetensors and residual.json into a folder.

        Raises:
            OSError: The system can't: the disk is full, say.
        """
        from safetensors import SafetensorError
        from safetensors.numpy import save_file

        with atomic_write(folder / "residual.safetensors") as part:
            try:
                save_file({name: np.ascontiguousarray(value) for name, value in self.network.arrays().items()}, part)
            except SafetensorError as error:
                raise OSError(EIO, str(error), str(part)) from None
        record: dict[str, Any] = {"options": asdict(self.options), "parameters": self.parameters}
        for name in ("input_mean", "input_std", "output_std"):
            record[name] = getattr(self, name).tolist()
        if self.bounds is not None:
            record["bounds"] = self.bounds.to_dict()
        with atomic_write(folder / "residual.json") as part:
            part.write_text(as_json(record), encoding="utf-8")

    @classmethod
    def load(cls, folder: Path) -> ResidualNet:
        """Reads a saved net.

        Raises:
            ModelError: A file is missing or damaged.
        """
        path = folder / "residual.json"
        try:
            record = read_json(path, "fit the model again", ModelError)
            options = NetOptions(**{**record["options"], "hidden": tuple(record["options"]["hidden"])})
            mean, std, scale = (freeze(record[name]) for name in ("input_mean", "input_std", "output_std"))
            weights = folder / "residual.safetensors"
            size = require_regular(weights, "fit the model again", ModelError)
            from safetensors.numpy import load_file

            arrays = load_file(weights)
            if not all(np.isfinite(values).all() for values in arrays.values()):
                raise ValueError("a weight is not finite")
            network: JointNets | DenseNet
            bounds, inputs = None, (len(scale), JOINT_FEATURES)  # type: tuple[NetBounds | None, tuple[int, ...]]
            if options.preset == "paper":
                # The options decide how much memory a net takes: its weights must be there before they are believed.
                widths = [mean.shape[-1], *map(int, options.hidden), 1]
                if min(widths) < 1 or 4 * sum(a * b for a, b in pairwise(widths)) > size:
                    raise ValueError("its options speak of more weights than there are")
                from ident.model.dense_training import DenseNet  # torch is slow to load

                network, inputs = DenseNet.from_arrays(arrays, mean.shape[-1], len(scale), options), (3 * len(scale),)
            else:
                network = JointNets.from_arrays(arrays, len(scale), JOINT_FEATURES)
                bounds = NetBounds.from_dict(record["bounds"], len(scale))
            if not mean.shape == std.shape == inputs or scale.ndim != 1:
                raise ValueError("its scales are of another number of joints or inputs")
            # Nets reckon in single precision: what overflows there is no scale.
            with np.errstate(over="ignore"):
                scales = [np.asarray(values, dtype=np.float32) for values in (mean, std, scale)]
            if not all(np.isfinite(values).all() for values in scales) or not (scales[1] > 0).all():
                raise ValueError("a scale is not finite and positive")
        except ModelError:
            raise
        except Exception as error:  # torch, safetensors and json each raise their own
            raise ModelError(path, f"the saved net can't be read ({error})", "fit the model again") from None
        return cls(options, network, mean, std, scale, bounds=bounds)


def fit_residual_net(
    states: Sequence[tuple[Array, Array, Array, Array]],
    residuals: Sequence[Float[Array, "T n"]],
    moving: Sequence[Bool[Array, "T n"]] | None = None,
    options: NetOptions | None = None,
    progress: Progress | None = None,
    checkpoint: Path | None = None,
    interval: float = 1.0,
) -> ResidualNet:
    """Fits a net to what a model leaves, as far as it helps on runs that it never saw (see `net_gate`).

    Args:
        states: (q, dq, ddq, rigid torque) of every run, each of shape (T, n).
        residuals: Residual torque of every run [N m].
        moving: Where each joint moves; the torque of a joint at rest is no function of the state and is left out of
            the error. All samples count if None, as in the paper.
        options: Preset or own options.
        progress: Called after each epoch, or joint, with (its number, how many, held-back error).
        checkpoint: Folder for checkpoints; a training of the same data and options goes on where it stopped.
        interval: Time between two samples of a run [s]; gives the gate's energies their unit.

    Returns:
        The net. Same seed, same weights.

    Source: paper, eq. 6.
    """
    options = options or PRESETS["default"]
    every = 1 if options.preset == "paper" else -(-sum(map(len, residuals)) // MOST_SAMPLES)
    states = [(q[::every], dq[::every], ddq[::every], rigid[::every]) for q, dq, ddq, rigid in states]
    residuals = [part[::every] for part in residuals]
    y = np.concatenate(residuals)
    mask = np.ones_like(y) if moving is None else np.concatenate([part[::every] for part in moving]).astype(float)
    scale = np.maximum(np.sqrt((mask * y**2).sum(axis=0) / np.maximum(mask.sum(axis=0), 1.0)), 1e-9)
    q, dq, ddq, rigid = (np.concatenate(parts) for parts in zip(*states, strict=True))
    whole = (q, dq, ddq, rigid)
    if options.preset == "paper":
        from ident.model.dense_training import train_dense

        x = np.concatenate(whole[:3], axis=1)
        mean, std = x.mean(axis=0), np.maximum(x.std(axis=0), 1e-6)
        dense = train_dense((x - mean) / std, y / scale, mask, options, progress, checkpoint)
        return ResidualNet(options, dense, freeze(mean), freeze(std), freeze(scale))
    folds, groups = make_folds([len(part) for part in residuals], every, np.random.default_rng(options.seed))
    seen, counts = np.stack(whole[1:]), mask > 0.0  # speed, acceleration and load
    bounds, strange = NetBounds.of(seen, counts), np.empty((*mask.shape, JOINT_FEATURES))
    for fold in np.unique(folds):  # inputs as a net sees them that has not seen them
        left = folds == fold
        others = NetBounds.of(seen[:, ~left], counts[~left]) if not left.all() else bounds
        strange[left] = joint_features(*others.clip(*seen[:, left]))
    x = joint_features(*bounds.clip(*seen))
    mean, std = x.mean(axis=0), np.maximum(x.std(axis=0), 1e-6)
    inputs = (x - mean) / std, (strange - mean) / std
    network, unseen = _solve(inputs, y / scale, counts, folds, options.seed, progress)
    run = np.repeat(np.arange(len(residuals)), [len(part) for part in residuals])
    gate = shrink_net(scale * unseen, y, counts, interval * every * dq, groups, run)
    network = network.scaled([one.weight for one in gate])
    return ResidualNet(options, network, freeze(mean), freeze(std), freeze(scale), gate, bounds)


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
        *found, error = solve_net(x[:, j], y[:, j], counts[:, j], folds, seed, strange[:, j])
        solved.append(found)
        if progress is not None:
            progress(j + 1, joints, error)
    weights, biases, unseen = zip(*solved, strict=True)
    first, last = map(np.stack, zip(*weights, strict=True))
    bias, offset = (np.stack(own)[:, None] for own in zip(*biases, strict=True))
    return JointNets((first, last), (bias, offset)), np.stack(unseen, axis=1)


def fit_net_of_arm(
    motions: Sequence[Motion],
    arm: ArmModel,
    known: Known,
    options: NetOptions,
    progress: Callable[[int, int, float], None] | None,
    checkpoint: Path | None,
) -> ResidualNet:
    """Fits the net, of a long session to stretches from all over it.

    Args:
        motions: Training runs.
        arm: The identified rigid arm.
        known: What is known of the torque beside it.
        options: A preset with its seed.
        progress: Called after each joint, or epoch.
        checkpoint: Folder in which training may stop and go on.
    """
    states, left = [], []
    motions = hold(motions, TRAINED_SAMPLES).motions
    for m in motions:
        rigid = arm.with_payload(m.payload).inverse_dynamics(m.q, m.dq, m.ddq)
        states.append((m.q[m.coarse], m.dq[m.coarse], m.ddq[m.coarse], rigid[m.coarse]))
        left.append(m.tau_filtered - m.filtered(rigid + known(m, rigid)))
    moving = None if options.preset == "paper" else [m.moving for m in motions]
    interval = motions[0].interval * motions[0].lowpass.factor
    return fit_residual_net(states, left, moving, options, progress, checkpoint, interval)
