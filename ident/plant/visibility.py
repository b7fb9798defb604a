"""How much of an effect shows: what is left of it after a fit of the ordinary model, against the noise floor.

The arm runs with and without the effect, both without sensor noise and with the same chance. From each torque the
best rigid body and linear friction is taken away; the root mean square of the difference is the visible amplitude.
The size for a wanted amplitude is found by bisection.

Source: Frisch and Waugh 1933, Lovell 1963 (partial regression).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ident.arrays import Array, Float
from ident.errors import InputError
from ident.plant.causes.base import Cause, Scene, View
from ident.plant.contact import Contact
from ident.plant.hardware import Hardware
from ident.plant.sensing import read_torque, sample
from ident.plant.shapes import TICK_S, Motion
from ident.plant.simulator import Simulator, Trace

STRIDE_S = 0.02
# Slower than this a joint counts as standing still: it may hold any torque [rad/s].
STILL_RAD_S = 0.02
TOLERANCE = 0.04
# Length of motion on which most causes are measured [s].
ENOUGH_S = 40.0
TRIES = 12


@dataclass(frozen=True, eq=False)
class Rows:
    """Samples of all runs of an arm without noise, stacked.

    Attributes:
        columns: What the ordinary model can explain, shape (T, n, m).
        torque: Torque as the drives read it [N m], shape (T, n).
        moving: Whether each joint moves, shape (T, n).
        run, time: Number of the run, and time since its start [s], shape (T,).
    """

    columns: Float[Array, "T n m"]
    torque: Float[Array, "T n"]
    moving: Array
    run: Array
    time: Float[Array, " T"]


def quiet_traces(hardware: Hardware, motions: Sequence[Motion], pauses: Sequence[float], seed: int) -> list[Trace]:
    """Runs without sensor noise."""
    silent = hardware.replace(sensing=hardware.sensing.silent())
    return Simulator(silent, np.random.default_rng(seed)).run(motions, pauses, lambda: None)


def gather(hardware: Hardware, traces: Sequence[Trace], view: View) -> Rows:
    """Samples of all runs with the columns of a view."""
    parts = [_rows_of(hardware, trace, number, view) for number, trace in enumerate(traces)]
    stacked = {name: np.concatenate([getattr(part, name) for part in parts]) for name in Rows.__dataclass_fields__}
    return Rows(**stacked)


def _rows_of(hardware: Hardware, trace: Trace, number: int, view: View) -> Rows:
    ticks = trace.times
    times = np.arange(0.1, ticks[-1] - 0.1, STRIDE_S)
    log, arm, sensing = trace.log, hardware.arm, hardware.sensing.silent()
    q = sample(ticks, log.angle + sensing.encoder_offset, times)
    dq = sample(ticks, log.speed, times)
    ddq = sample(ticks, np.gradient(log.speed, TICK_S, axis=0), times)
    torque = read_torque(sensing, ticks, log.torque, log.speed, times, trace.start, np.random.default_rng(0))
    own = [ddq, dq, np.sign(dq)] + ([] if view == "raw" else [np.ones_like(q)])
    columns = [value[:, :, None] * np.eye(arm.n) for value in own]
    if view == "refit":
        columns.insert(0, arm.regressor(q, dq, ddq))
    else:
        torque = torque - arm.inverse_dynamics(q, dq, ddq)
    count = np.full(len(times), number)
    return Rows(np.concatenate(columns, axis=2), torque, np.abs(dq) > STILL_RAD_S, count, times)


def remainder(rows: Rows) -> Float[Array, "T n"]:
    """Torque that no ordinary model explains [N m]; zero where a joint stands still."""
    mask = rows.moving.ravel()
    flat = rows.columns.reshape(-1, rows.columns.shape[2])
    used, torque = flat[mask], rows.torque.ravel()
    normal = used.T @ used
    scale = np.sqrt(np.diag(normal)) + 1e-9
    # A touch of ridge: rigid-body columns are dependent.
    solved = np.linalg.solve(normal / np.outer(scale, scale) + 1e-8 * np.eye(len(scale)), used.T @ torque[mask] / scale)
    rest = np.where(mask, torque - flat @ (solved / scale), 0.0)
    return rest.reshape(rows.torque.shape)


def amplitude(after: Rows, before: Rows, window: Array | None = None) -> Float[Array, " n"]:
    """RMS of the difference of two remainders where both move [N m], in a window of the samples if one is given."""
    both = after.moving & before.moving
    if window is not None:
        both = both & window[:, None]
    difference = np.where(both, remainder(after) - remainder(before), 0.0)
    return np.sqrt((difference**2).sum(axis=0) / np.maximum(both.sum(axis=0), 1))


class VisibilityMeter:
    """Measures and sets the visible amplitude of causes on one arm and session.

    Args:
        hardware: The arm without them.
        motions, pauses: The session.
        seed: Of the chance that runs with and without a cause share.
    """

    def __init__(self, hardware: Hardware, motions: Sequence[Motion], pauses: Sequence[float], seed: int) -> None:
        self.hardware, self.motions, self.pauses, self.seed = hardware, motions, pauses, seed
        self._plain: dict[tuple[bool, View], Rows] = {}

    def measure(self, cause: Cause, scene: Scene, size: float, seed: int) -> Float[Array, " n"]:
        """Visible amplitude of a cause of a given size at each joint [N m].

        Args:
            cause: What is wrong.
            scene: Where; its generator is not used.
            size: How much.
            seed: Of the cause's other parameters.
        """
        hardware, _ = cause.apply(replace(scene, rng=np.random.default_rng(seed)), size)
        after = gather(hardware, self._traces(hardware, cause.needs_all), cause.view)
        kind = cause.needs_all, cause.view
        if kind not in self._plain:
            self._plain[kind] = gather(self.hardware, self._traces(self.hardware, cause.needs_all), cause.view)
        return amplitude(after, self._plain[kind], _window(hardware.contact, hardware.contact_run, after))

    def _traces(self, hardware: Hardware, all_runs: bool) -> list[Trace]:
        """Runs of the session; where all are not needed, evenly chosen ones of about `ENOUGH_S` together."""
        total = sum(motion.duration for motion in self.motions)
        skip = 1 if all_runs else max(int(total / ENOUGH_S), 1)
        return quiet_traces(hardware, self.motions[::skip], self.pauses[::skip], self.seed)

    def share(self, cause: Cause, scene: Scene, size: float, seed: int) -> float:
        """Visible amplitude over the noise floor: at the cause's joint, or where it shows most."""
        seen = self.measure(cause, scene, size, seed) / self.hardware.sensing.noise_floor
        return float(seen.max() if cause.whole_arm else seen[scene.joint])

    def find_size(self, cause: Cause, scene: Scene, wanted: float, seed: int) -> float:
        """The size whose visible amplitude is a multiple of the noise floor, by bisection on a logarithmic scale.

        Raises:
            InputError: No physical size shows that much.
        """
        low, high = cause.bounds(scene)
        low = max(low, 1e-6 * high)
        small, large = (high, low) if cause.inverse else (low, high)
        size = float(np.clip(cause.typical(scene), low, high))
        for _ in range(TRIES):
            seen = self._share_or_inf(cause, scene, size, seed)
            if abs(seen / wanted - 1.0) < TOLERANCE:
                return float(f"{size:.4g}")  # the last digits depend on the machine's linear algebra
            small, large = (size, large) if seen < wanted else (small, size)
            size = self._next(size, seen, wanted, small, large, cause.inverse)
            if abs(np.log(large / small)) < 0.01:
                break
        seen = self._share_or_inf(cause, scene, size, seed)
        if seen < 0.8 * wanted or seen > 1.25 * wanted:
            raise InputError(
                f"--effect {cause.id}",
                f"{wanted:g} times the noise floor can't be reached: {cause.parameter} = {size:.4g} shows {seen:.3g}",
                "choose another amplitude, joint or motion",
            )
        return float(f"{size:.4g}")

    def _share_or_inf(self, cause: Cause, scene: Scene, size: float, seed: int) -> float:
        """As `share`; a size at which the arm can't move any more shows without limit."""
        try:
            return self.share(cause, scene, size, seed)
        except InputError:
            return np.inf

    @staticmethod
    def _next(size: float, seen: float, wanted: float, small: float, large: float, inverse: bool) -> float:
        """Next trial: as if the amplitude were proportional to the size, but between the bounds; else their middle."""
        guess = np.nan
        if 0.0 < seen < np.inf:
            step = np.clip(wanted / seen, 0.1, 10.0)
            guess = size / step if inverse else size * step
        inside = min(small, large) < guess < max(small, large)
        return float(guess if inside else np.sqrt(small * large))


def _window(contact: Contact, run: int, rows: Rows) -> Array | None:
    """Samples during a push, if there is one: a burst would drown in the mean over the session."""
    if contact.body == 0:
        return None
    return (rows.run == run) & (rows.time > contact.start) & (rows.time < contact.end)
