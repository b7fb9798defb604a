"""How much of an effect shows: what is left of it after a fit of the ordinary model, against the
noise floor.

The arm runs with and without the effect, both without sensor noise and with the same chance. From
each torque, within the band that encoder noise leaves, the best rigid body and linear friction is
taken away; the root mean square of the difference is the visible amplitude. A size with which a
joint no longer follows its motion shows without limit.

The size that shows as much as is wanted is found by regula falsi on logarithmic scales. Most causes
show in proportion to a power of their size, a straight line there, so that two or three trials find
it; one that sets in at a threshold (play, saturation) is bracketed.

Source: Frisch and Waugh 1933, Lovell 1963 (partial regression); Dowell and Jarratt 1971 (the
Illinois method).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from typing import NamedTuple

import numpy as np
from scipy.signal import butter, sosfiltfilt

from ident.arrays import Array, Bool, Float, freeze
from ident.errors import InputError
from ident.simulation.causes import Cause, Circumstances
from ident.simulation.causes.mechanisms import View
from ident.simulation.hardware import Hardware
from ident.simulation.sensing import read_torque, sample
from ident.simulation.simulator import Simulator, Trace, choose_step, feed_forward
from ident.trajectories.reference import TICK_S, ReferenceMotion

MOST_TRIALS = 12
# A first step goes no further than by this factor: far from a trial the power law is a guess.
LONGEST_STEP = 30.0
# Exponents of the power law that two trials on one side may suggest.
LEAST_POWER = 0.3
GREATEST_POWER = 4.0
# Relative difference below which two sizes are one: they are reported with four digits.
SAME = 1e-3
# Logarithms of a size, and of how much it shows as a multiple of what is wanted.
Trial = tuple[float, float]
STRIDE_S = 0.02
# Slower than this a joint counts as standing still: it may hold any torque [rad/s].
STILL_RAD_S = 0.02
# A joint that moves for a smaller share of the time than this, of the time without the effect, is
# stuck.
FOLLOWS_SHARE = 0.9
TOLERANCE = 0.04
# A size that shows so much less or more than is wanted is still taken where none comes nearer.
ACCEPTED = 0.8, 1.25
# What is quicker than this is nothing that a diagnosis sees, and at the stride would pass for
# something slower: it is taken out of every signal [Hz]. Where a joint's band is narrower, pieces
# shorter than three times this many samples stay as they are.
WHOLE_BAND_HZ = 20.0
LEAST_FILTERED = 15
# Length of motion on which most causes are measured, where the simulation is fine [s].
ENOUGH_S = 40.0
_SLOW = butter(4, WHOLE_BAND_HZ, fs=1.0 / TICK_S, output="sos")


def find_size(
    shown: Callable[[float], float],
    wanted: float,
    start: float,
    ends: tuple[float, float],
    tolerance: float,
) -> tuple[float, float]:
    """Tries sizes until one shows what is wanted, or a bound shows too little or too much.

    Args:
        shown: How much a size shows; called with sizes of four digits, as they are reported.
        wanted: How much is wanted.
        start: Size to begin with.
        ends: The sizes that show least and most; the first is the larger where a smaller size shows
            more.
        tolerance: Relative error of what is shown at which to stop.

    Returns:
        The best size that was tried, and what it shows.
    """
    best = (np.nan, np.nan)
    off = np.inf
    size = start
    below: Trial | None = None
    above: Trial | None = None
    last: Trial | None = None
    for _ in range(MOST_TRIALS):
        size = float(f"{size:.4g}")  # the last digits depend on the machine's linear algebra
        seen = shown(size)
        with np.errstate(divide="ignore"):
            trial = float(np.log(size)), float(np.log(seen / wanted))
        if abs(trial[1]) <= off:
            best = (size, seen)
            off = abs(trial[1])
        too_little = seen / wanted < 1.0
        at_end = np.isclose(trial[0], np.log(ends[too_little]), rtol=0.0, atol=SAME)
        if off < tolerance or at_end:
            break
        # The far side counts as half as far off where the near side moved twice running.
        if too_little:
            above = (above[0], 0.5 * above[1]) if above and last is below else above
            below = trial
        else:
            below = (below[0], 0.5 * below[1]) if below and last is above else below
            above = trial
        if below and above:
            finite = np.isfinite(below[1]) and np.isfinite(above[1])
            share = below[1] / (below[1] - above[1]) if finite else 0.5
            guess = below[0] + share * (above[0] - below[0])
        else:
            # One side only is known: a step along the power law of the last two trials.
            power = 1.0
            if last and np.isfinite(last[1]) and np.isfinite(trial[1]):
                power = np.clip(
                    abs((trial[1] - last[1]) / (trial[0] - last[0])), LEAST_POWER, GREATEST_POWER
                )
            longest = np.log(LONGEST_STEP)
            step = float(
                np.clip(-trial[1], -longest, longest) / (power if ends[0] <= ends[1] else -power)
            )
            guess = float(np.clip(trial[0] + step, *sorted(np.log(ends))))
        last = trial
        size = float(np.exp(guess))
        if abs(guess - trial[0]) <= SAME:
            break
    return best


class VisibleRows(NamedTuple):
    """Samples of all runs of an arm without noise, stacked."""

    columns: Float[Array, "T n m"]  # what the ordinary model can explain
    torque: Float[Array, "T n"]  # as the drives read it [N m]
    known: Float[Array, "T n"]  # share of it that the model is not free to change [N m]
    moving: Array  # whether each joint moves, shape (T, n)
    speed: Float[Array, "T n"]  # of the joints [rad/s]
    run: Array  # number of the run, shape (T,)
    time: Float[Array, " T"]  # since its start [s]


def gather(
    hardware: Hardware, traces: Sequence[Trace], view: View, band: Float[Array, " n"] | None = None
) -> VisibleRows:
    """Samples of all runs with the columns of a view.

    Args:
        hardware, traces, view: The arm, its runs, and which model is to explain them.
        band: Frequency up to which each joint's torque and columns are taken [Hz]; `WHOLE_BAND_HZ`
            if None.
    """
    parts = []
    arm = hardware.arm
    for number, trace in enumerate(traces):
        ticks = trace.times
        times = _sample_times(trace)
        log = trace.log
        speed = _slow(log.speed)
        q = sample(ticks, log.angle + hardware.sensing.encoder_offset, times)
        dq = sample(ticks, speed, times)
        ddq = sample(ticks, np.gradient(speed, TICK_S, axis=0), times)
        # filtered like the torque that turns with it
        direction = sample(ticks, _slow(np.sign(log.speed)), times)
        states = [ddq, dq, direction] + ([] if view == "raw" else [np.ones_like(q)])
        columns = [value[:, :, None] * np.eye(arm.n) for value in states]
        if view == "refit":
            columns.insert(0, arm.regressor(q, dq, ddq))
        known = np.zeros_like(q) if view == "refit" else arm.inverse_dynamics(q, dq, ddq)
        moving = np.abs(dq) > STILL_RAD_S
        torques = (np.concatenate(columns, axis=2), _reading(hardware, trace), known)
        where = moving, dq, np.full(len(times), number), times
        parts.append((*(_in_band(torque, moving, band) for torque in torques), *where))
    return VisibleRows(*map(np.concatenate, zip(*parts, strict=True)))


def _sample_times(trace: Trace) -> Float[Array, " T"]:
    return np.arange(0.1, trace.times[-1] - 0.1, STRIDE_S)


def _reading(hardware: Hardware, trace: Trace) -> Float[Array, "T n"]:
    """Torque of one run as drives without noise read it [N m]."""
    log = trace.log
    sensing = hardware.sensing.silent()
    ticks = trace.times
    read = read_torque(
        sensing, ticks, log.torque, log.speed, ticks, trace.start, np.random.default_rng(0)
    )
    return sample(ticks, _slow(read), _sample_times(trace))


def _slow(values: Float[Array, "K n"]) -> Float[Array, "K n"]:
    """Values at the controller's ticks without what their samples at the stride could only
    misread.
    """
    return np.asarray(sosfiltfilt(_SLOW, values, axis=0, padlen=min(150, len(values) - 1)))


def moves_alike(first: Hardware, other: Hardware) -> bool:
    """Whether two arms differ in nothing but how their drives read the torque: then they move
    alike.
    """
    parts = [group.name for group in fields(Hardware) if group.name != "sensing"]
    same = all(getattr(first, name) is getattr(other, name) for name in parts)
    return same and np.array_equal(first.sensing.encoder_offset, other.sensing.encoder_offset)


def remainder(rows: VisibleRows) -> Float[Array, "T n"]:
    """Torque that no ordinary model explains [N m]; zero where a joint stands still."""
    mask = rows.moving.ravel()
    flat = rows.columns.reshape(-1, rows.columns.shape[2])
    used = flat[mask]
    torque = (rows.torque - rows.known).ravel()
    normal = used.T @ used
    scale = np.sqrt(np.diag(normal)) + 1e-9
    # A touch of ridge: rigid-body columns are dependent.
    solved = np.linalg.solve(
        normal / np.outer(scale, scale) + 1e-8 * np.eye(len(scale)), used.T @ torque[mask] / scale
    )
    rest = np.where(mask, torque - flat @ (solved / scale), 0.0)
    return rest.reshape(rows.torque.shape)


@dataclass(frozen=True, eq=False)
class Shown:
    """What a cause leaves over time after the best ordinary model."""

    torque: Float[Array, "T n"]  # [N m]; zero where a joint stands still
    moving: Array  # whether each joint moves, shape (T, n)
    run: Array  # number of each sample's run, shape (T,)
    speed: Float[Array, "T n"]  # of the joints without the cause [rad/s]
    share: float = 1.0  # of the session's runs that were simulated

    @property
    def rms(self) -> Float[Array, " n"]:
        """Of each joint where it moves [N m]."""
        return np.sqrt((self.torque**2).sum(axis=0) / np.maximum(self.moving.sum(axis=0), 1))


def compare(after: VisibleRows, before: VisibleRows, window: Array | None = None) -> Shown:
    """Difference of two remainders, with a cause and without, where both move; in a window of
    samples if given.
    """
    both = after.moving & before.moving
    if window is not None:
        both = both & window[:, None]
    return Shown(
        np.where(both, remainder(after) - remainder(before), 0.0), both, before.run, before.speed
    )


def _in_band(
    values: Float[Array, "T n ..."], moving: Bool[Array, "T n"], band: Float[Array, " n"] | None
) -> Float[Array, "T n ..."]:
    """A run's values without what is quicker than the band of each joint [Hz].

    What a joint holds at rest is left out first: it would leak into the motion.
    """
    if band is None or len(values) <= 3 * LEAST_FILTERED:
        return values
    banded = np.array(values)
    for j in np.flatnonzero(band < WHOLE_BAND_HZ):
        filter_sos = butter(2, band[j], fs=1.0 / STRIDE_S, output="sos")
        banded[~moving[:, j], j] = 0.0
        banded[:, j] = sosfiltfilt(filter_sos, banded[:, j], axis=0, padlen=LEAST_FILTERED)
    return banded


class Way(NamedTuple):
    """How runs are simulated to be compared."""

    all_runs: bool  # or evenly chosen ones of about `ENOUGH_S` together
    coarse_step: float | None  # step of a coarse simulation [s]; None for a fine one


class VisibilityMeter:
    """Measures and sets the visible amplitude of causes on one arm and session.

    A fine meter takes some of the runs at the full rate of the simulation; a coarse one takes all
    of them in longer steps, which is quicker, and truer to the session where its runs differ.

    Args:
        hardware: The arm without them.
        motions, pauses: The session.
        seed: Of the chance that runs with and without a cause share.
        coarse: Whether to measure the whole session coarsely.
        floor: Noise floor of each joint [N m]; that of the torque readings if None.
        band: Frequency up to which encoder noise lets each joint be seen [Hz]; without bound if
            None.
    """

    def __init__(
        self,
        hardware: Hardware,
        motions: Sequence[ReferenceMotion],
        pauses: Sequence[float],
        seed: int,
        coarse: bool = False,
        floor: Float[Array, " n"] | None = None,
        band: Float[Array, " n"] | None = None,
    ) -> None:
        self.band = band
        self.coarse = coarse
        self.floor = hardware.sensing.noise_floor if floor is None else floor
        self.hardware = hardware
        self.motions = motions
        self.pauses = pauses
        self.seed = seed
        # Feed-forward torque of each motion [N m], worked out once for all simulations of the
        # session.
        self.feeds = [feed_forward(hardware, motion) for motion in motions]
        self._plain_traces: dict[Way, list[Trace]] = {}
        # What causes are compared with: the arm as it is, or an arm of the cause's own at a joint.
        self._rows: dict[tuple[str, int, Way, View], VisibleRows] = {}
        self._seen: dict[tuple[str, int, float, int], tuple[Float[Array, " n"], bool]] = {}

    def measure(
        self, cause: Cause, scene: Circumstances, size: float, seed: int
    ) -> Float[Array, " n"]:
        """Visible amplitude of a cause of a size at each joint [N m]; the seed is of its other
        parameters.
        """
        return self._measured(cause, scene, size, seed)[0]

    def _measured(
        self, cause: Cause, scene: Circumstances, size: float, seed: int
    ) -> tuple[Float[Array, " n"], bool]:
        """Visible amplitude at each joint [N m], and whether the cause's joint still follows its
        motion.
        """
        key = cause.id, scene.joint, size, seed
        if key not in self._seen:
            hardware, _ = cause.apply(replace(scene, rng=np.random.default_rng(seed)), size)
            way = Way(
                cause.needs_all or self.coarse,
                choose_step(hardware, coarse=True) if self.coarse else None,
            )
            before = self._without(cause, scene, way, cause.view)
            after = self._with(hardware, way, cause.view)
            push = hardware.contact
            window = None
            # a burst would drown in the mean over the session: the samples during it alone
            if push.body:
                window = (
                    (after.run == hardware.contact_run)
                    & (after.time > push.start)
                    & (after.time < push.end)
                )
            shown = compare(after, before, window)
            moved, usual = (int(rows.moving[:, scene.joint].sum()) for rows in (after, before))
            self._seen[key] = freeze(shown.rms), moved >= FOLLOWS_SHARE * usual
        return self._seen[key]

    def show(
        self, cause: Cause, scene: Circumstances, size: float, seed: int, view: View, all_runs: bool
    ) -> Shown:
        """What a cause leaves over time, in a coarse simulation of all runs or of evenly chosen
        ones.
        """
        hardware, _ = cause.apply(replace(scene, rng=np.random.default_rng(seed)), size)
        way = Way(
            all_runs,
            choose_step(hardware if hardware.drive.elastic.any() else self.hardware, coarse=True),
        )
        before = self._without(cause, scene, way, view)
        after = self._with(hardware, way, view)
        return replace(
            compare(after, before), share=len(self.motions[:: self._skip(way)]) / len(self.motions)
        )

    def _without(self, cause: Cause, scene: Circumstances, way: Way, view: View) -> VisibleRows:
        """What a cause is compared with: the arm as it is, or, where the cause has one, an arm of
        its own.
        """
        key = ("", 0, way, view) if cause.beside is None else (cause.id, scene.joint, way, view)
        if key not in self._rows:
            other = self.hardware if cause.beside is None else cause.apply(scene, cause.beside)[0]
            self._rows[key] = gather(other, self._traces(other, way), view, self.band)
        return self._rows[key]

    def _with(self, hardware: Hardware, way: Way, view: View) -> VisibleRows:
        """The arm with a cause; where only the reading of the torque differs, nothing need be
        simulated anew.
        """
        if ("", 0, way, view) in self._rows and moves_alike(hardware, self.hardware):
            rows = self._rows["", 0, way, view]
            traces = self._traces(self.hardware, way)
            readings = [
                _in_band(_reading(hardware, trace), rows.moving[rows.run == number], self.band)
                for number, trace in enumerate(traces)
            ]
            return rows._replace(torque=np.concatenate(readings))
        return gather(hardware, self._traces(hardware, way), view, self.band)

    def _traces(self, hardware: Hardware, way: Way) -> list[Trace]:
        """Runs without sensor noise; those of the arm as it is are made once."""
        if hardware is self.hardware and way in self._plain_traces:
            return self._plain_traces[way]
        skip = self._skip(way)
        silent = hardware.replace(sensing=hardware.sensing.silent())
        simulator = Simulator(silent, np.random.default_rng(self.seed), way.coarse_step)
        traces = simulator.run(
            self.motions[::skip], self.pauses[::skip], lambda: None, self.feeds[::skip]
        )
        if hardware is self.hardware:
            self._plain_traces[way] = traces
        return traces

    def _skip(self, way: Way) -> int:
        """Which runs are simulated: every so many."""
        total = sum(motion.duration for motion in self.motions)
        return 1 if way.all_runs else max(int(total / ENOUGH_S), 1)

    def share(self, cause: Cause, scene: Circumstances, size: float, seed: int) -> float:
        """Visible amplitude over the noise floor: at the cause's joint, or where it shows most;
        infinite if stuck.
        """
        amplitude, follows = self._measured(cause, scene, size, seed)
        seen = amplitude / self.floor
        return float(seen.max() if cause.whole_arm else seen[scene.joint]) if follows else np.inf

    def find_size(self, cause: Cause, scene: Circumstances, wanted: float, seed: int) -> float:
        """The size whose visible amplitude is a multiple of the noise floor.

        Raises:
            InputError: No physical size shows that much.
        """
        low, high = cause.bounds(scene)
        low = max(low, 1e-6 * high) * (1.0 + SAME)
        high = high * (1.0 - SAME)

        def shown(size: float) -> float:
            try:
                return self.share(cause, scene, size, seed)
            except InputError:  # a size at which the arm can't move any more shows without limit
                return np.inf

        start = float(np.clip(cause.typical(scene), low, high))
        ends = (high, low) if cause.inverse else (low, high)
        size, seen = find_size(shown, wanted, start, ends, TOLERANCE)
        least, most = ACCEPTED
        if not least * wanted <= seen <= most * wanted:
            what = (
                f"{wanted:g} times the noise floor can't be reached: {cause.parameter} = "
                f"{size:.4g} shows {seen:.3g}"
            )
            raise InputError(
                f"--effect {cause.id}", what, "choose another amplitude, joint or motion"
            )
        return size
