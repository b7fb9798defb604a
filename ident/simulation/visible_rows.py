"""What is left of simulated torque after a fit of the ordinary model.

Of runs without sensor noise, within the band that encoder noise leaves: the best rigid body and
linear friction is taken away.

Source: Frisch and Waugh 1933, Lovell 1963 (partial regression).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.signal import butter, sosfiltfilt

from ident.arrays import Array, Bool, Float, Int
from ident.simulation.causes.mechanisms import View
from ident.simulation.hardware import Hardware
from ident.simulation.sensing import read_torque, sample
from ident.simulation.simulator import Trace
from ident.trajectories.reference import TICK_S

STRIDE_S = 0.02
# Time at either end of a run that is left out [s].
EDGE_S = 0.1
# Slower than this a joint counts as standing still: it may hold any torque [rad/s].
STILL_RAD_S = 0.02
# What is quicker than this is nothing that a diagnosis sees, and at the stride would pass for
# something slower: it is taken out of every signal [Hz]. Where a joint's band is narrower, pieces
# shorter than three times this many samples stay as they are.
WHOLE_BAND_HZ = 20.0
LEAST_FILTERED = 15
# Samples by which a run is continued at its ends for the filter.
LONGEST_PAD = 150
# A touch of ridge: rigid-body columns are dependent.
RIDGE = 1e-8
_SLOW = butter(4, WHOLE_BAND_HZ, fs=1.0 / TICK_S, output="sos")


class VisibleRows(NamedTuple):
    """Samples of all runs of an arm without noise, stacked."""

    columns: Float[Array, "T n m"]  # what the ordinary model can explain
    torque: Float[Array, "T n"]  # as the drives read it [N m]
    known: Float[Array, "T n"]  # share of it that the model is not free to change [N m]
    moving: Bool[Array, "T n"]  # whether each joint moves
    speed: Float[Array, "T n"]  # of the joints [rad/s]
    run: Int[Array, " T"]  # number of the run
    time: Float[Array, " T"]  # since its start [s]


@dataclass(frozen=True, eq=False)
class Shown:
    """What a cause leaves over time after the best ordinary model."""

    torque: Float[Array, "T n"]  # [N m]; zero where a joint stands still
    moving: Bool[Array, "T n"]  # whether each joint moves
    run: Int[Array, " T"]  # number of each sample's run
    speed: Float[Array, "T n"]  # of the joints without the cause [rad/s]
    share: float = 1.0  # of the session's runs that were simulated

    @property
    def rms(self) -> Float[Array, " n"]:
        """Root mean square of each joint's torque where it moves [N m]."""
        squares = (self.torque**2).sum(axis=0)
        return np.sqrt(squares / np.maximum(self.moving.sum(axis=0), 1))


def gather(
    hardware: Hardware, traces: Sequence[Trace], view: View, band: Float[Array, " n"] | None = None
) -> VisibleRows:
    """Samples of all runs with the columns of a view.

    Args:
        hardware: The arm.
        traces: Its runs.
        view: Which model is to explain them.
        band: Frequency up to which each joint's torque and columns are taken [Hz]; `WHOLE_BAND_HZ`
            if None.
    """
    runs = [_rows_of_run(hardware, trace, k, view, band) for k, trace in enumerate(traces)]
    return VisibleRows(*map(np.concatenate, zip(*runs, strict=True)))


def _rows_of_run(
    hardware: Hardware, trace: Trace, number: int, view: View, band: Float[Array, " n"] | None
) -> VisibleRows:
    """The same of one run."""
    arm = hardware.arm
    ticks = trace.times
    times = _sample_times(trace)
    log = trace.log
    slow = _slow(log.speed)
    q = sample(ticks, log.angle + hardware.sensing.encoder_offset, times)
    dq = sample(ticks, slow, times)
    ddq = sample(ticks, np.gradient(slow, TICK_S, axis=0), times)
    # filtered like the torque that turns with it
    direction = sample(ticks, _slow(np.sign(log.speed)), times)
    states = [ddq, dq, direction]
    if view != "raw":
        states.append(np.ones_like(q))
    columns = [state[:, :, None] * np.eye(arm.n) for state in states]
    if view == "refit":
        columns.insert(0, arm.regressor(q, dq, ddq))
        known = np.zeros_like(q)
    else:
        known = arm.inverse_dynamics(q, dq, ddq)
    moving = np.abs(dq) > STILL_RAD_S
    return VisibleRows(
        columns=within_band(np.concatenate(columns, axis=2), moving, band),
        torque=within_band(read_silently(hardware, trace), moving, band),
        known=within_band(known, moving, band),
        moving=moving,
        speed=dq,
        run=np.full(len(times), number),
        time=times,
    )


def _sample_times(trace: Trace) -> Float[Array, " T"]:
    return np.arange(EDGE_S, trace.times[-1] - EDGE_S, STRIDE_S)


def read_silently(hardware: Hardware, trace: Trace) -> Float[Array, "T n"]:
    """Torque of one run as drives without noise read it [N m]."""
    log = trace.log
    ticks = trace.times
    sensing = hardware.sensing.silent()
    rng = np.random.default_rng(0)
    torque = read_torque(sensing, ticks, log.torque, log.speed, ticks, trace.start, rng)
    return sample(ticks, _slow(torque), _sample_times(trace))


def _slow(values: Float[Array, "K n"]) -> Float[Array, "K n"]:
    """Values at the controller's ticks without what their samples at the stride could misread."""
    pad = min(LONGEST_PAD, len(values) - 1)
    return np.asarray(sosfiltfilt(_SLOW, values, axis=0, padlen=pad))


def within_band(
    values: Float[Array, "T n ..."], moving: Bool[Array, "T n"], band: Float[Array, " n"] | None
) -> Float[Array, "T n ..."]:
    """A run's values without what is quicker than the band of each joint [Hz].

    What a joint holds at rest is left out first: it would leak into the motion.
    """
    if band is None or len(values) <= 3 * LEAST_FILTERED:
        return values
    banded = np.array(values)
    for j in np.flatnonzero(band < WHOLE_BAND_HZ):
        sections = butter(2, band[j], fs=1.0 / STRIDE_S, output="sos")
        banded[~moving[:, j], j] = 0.0
        banded[:, j] = sosfiltfilt(sections, banded[:, j], axis=0, padlen=LEAST_FILTERED)
    return banded


def remainder(rows: VisibleRows) -> Float[Array, "T n"]:
    """Torque that no ordinary model explains [N m]; zero where a joint stands still."""
    mask = rows.moving.ravel()
    columns = rows.columns.reshape(-1, rows.columns.shape[2])
    used = columns[mask]
    torque = (rows.torque - rows.known).ravel()
    normal = used.T @ used
    scale = np.sqrt(np.diag(normal)) + 1e-9
    scaled = normal / np.outer(scale, scale) + RIDGE * np.eye(len(scale))
    solution = np.linalg.solve(scaled, used.T @ torque[mask] / scale) / scale
    rest = np.where(mask, torque - columns @ solution, 0.0)
    return rest.reshape(rows.torque.shape)


def compare(
    after: VisibleRows, before: VisibleRows, window: Bool[Array, " T"] | None = None
) -> Shown:
    """Difference of two remainders, with a cause and without, where both move.

    Args:
        after: With the cause.
        before: Without it.
        window: Samples that count; all if None.

    Returns:
        What shows of the cause [N m], shape (T, n); zero where a joint stands still in either.
    """
    both = after.moving & before.moving
    if window is not None:
        both = both & window[:, None]
    torque = np.where(both, remainder(after) - remainder(before), 0.0)
    return Shown(torque, both, before.run, before.speed)
