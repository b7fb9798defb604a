"""How much of an effect shows: what is left of it after a fit of the ordinary model, against the
noise floor.

The arm runs with and without the effect, both without sensor noise and with the same chance. From
each torque, within the band that encoder noise leaves, the best rigid body and linear friction is
taken away (`ident.simulation.visible_rows`); the root mean square of the difference is the visible
amplitude. A size with which a joint no longer follows its motion shows without limit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace
from typing import NamedTuple

import numpy as np

from ident.arrays import Array, Bool, Float, freeze
from ident.errors import InputError
from ident.simulation.causes import Cause, Circumstances
from ident.simulation.causes.mechanisms import View
from ident.simulation.hardware import Hardware
from ident.simulation.simulator import Simulator, Trace, choose_step, feed_forward
from ident.simulation.size_search import SAME, find_size
from ident.simulation.visible_rows import (
    Shown,
    VisibleRows,
    compare,
    gather,
    read_silently,
    within_band,
)
from ident.trajectories.reference import ReferenceMotion

# A joint that moves for a smaller share of the time than this, of the time without the effect, is
# stuck.
FOLLOWS_SHARE = 0.9
TOLERANCE = 0.04
# A size that shows so much less or more than is wanted is still taken where none comes nearer.
ACCEPTED = (0.8, 1.25)
# Length of motion on which most causes are measured, where the simulation is fine [s].
ENOUGH_S = 40.0
# Least size that is tried, as a share of the largest.
LEAST_SHARE = 1e-6


def moves_alike(first: Hardware, other: Hardware) -> bool:
    """Whether two arms differ in nothing but how their drives read the torque.

    Then they move alike.
    """
    groups = [group.name for group in fields(Hardware) if group.name != "sensing"]
    if not all(getattr(first, name) is getattr(other, name) for name in groups):
        return False
    return np.array_equal(first.sensing.encoder_offset, other.sensing.encoder_offset)


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
        """Visible amplitude of a cause at each joint [N m].

        Args:
            cause: The cause.
            scene: The arm, joint and motion.
            size: Its size.
            seed: Of its other parameters.
        """
        return self._measured(cause, scene, size, seed)[0]

    def _measured(
        self, cause: Cause, scene: Circumstances, size: float, seed: int
    ) -> tuple[Float[Array, " n"], bool]:
        """Visible amplitude at each joint [N m], and whether the cause's joint still follows."""
        key = cause.id, scene.joint, size, seed
        if key not in self._seen:
            self._seen[key] = self._simulate(cause, scene, size, seed)
        return self._seen[key]

    def _simulate(
        self, cause: Cause, scene: Circumstances, size: float, seed: int
    ) -> tuple[Float[Array, " n"], bool]:
        """The same, worked out anew."""
        hardware, _ = cause.apply(replace(scene, rng=np.random.default_rng(seed)), size)
        step = choose_step(hardware, coarse=True) if self.coarse else None
        way = Way(cause.needs_all or self.coarse, step)
        before = self._without(cause, scene, way, cause.view)
        after = self._with(hardware, way, cause.view)
        shown = compare(after, before, _push_window(hardware, after))
        moved = int(after.moving[:, scene.joint].sum())
        usual = int(before.moving[:, scene.joint].sum())
        return freeze(shown.rms), moved >= FOLLOWS_SHARE * usual

    def show(
        self, cause: Cause, scene: Circumstances, size: float, seed: int, view: View, all_runs: bool
    ) -> Shown:
        """What a cause leaves over time, in a coarse simulation.

        Args:
            cause, scene, size, seed: As `measure` takes them.
            view: Which model is to explain the torque.
            all_runs: Whether all runs are simulated, or evenly chosen ones.
        """
        hardware, _ = cause.apply(replace(scene, rng=np.random.default_rng(seed)), size)
        stepped = hardware if hardware.drive.elastic.any() else self.hardware
        way = Way(all_runs, choose_step(stepped, coarse=True))
        before = self._without(cause, scene, way, view)
        after = self._with(hardware, way, view)
        share = len(self.motions[:: self._skip(way)]) / len(self.motions)
        return replace(compare(after, before), share=share)

    def _without(self, cause: Cause, scene: Circumstances, way: Way, view: View) -> VisibleRows:
        """What a cause is compared with: the arm as it is, or an arm of the cause's own."""
        other = self.hardware
        key = ("", 0, way, view)
        if cause.beside is not None:
            key = (cause.id, scene.joint, way, view)
        if key not in self._rows:
            if cause.beside is not None:
                other, _ = cause.apply(scene, cause.beside)
            self._rows[key] = gather(other, self._traces(other, way), view, self.band)
        return self._rows[key]

    def _with(self, hardware: Hardware, way: Way, view: View) -> VisibleRows:
        """The arm with a cause.

        Where only the reading of the torque differs, nothing need be simulated anew.
        """
        key = ("", 0, way, view)
        if key not in self._rows or not moves_alike(hardware, self.hardware):
            return gather(hardware, self._traces(hardware, way), view, self.band)
        rows = self._rows[key]
        readings = []
        for number, trace in enumerate(self._traces(self.hardware, way)):
            torque = read_silently(hardware, trace)
            readings.append(within_band(torque, rows.moving[rows.run == number], self.band))
        return rows._replace(torque=np.concatenate(readings))

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
        """Visible amplitude over the noise floor; infinite if the joint is stuck.

        At the cause's joint, or where it shows most.
        """
        amplitude, follows = self._measured(cause, scene, size, seed)
        if not follows:
            return np.inf
        seen = amplitude / self.floor
        return float(seen.max() if cause.whole_arm else seen[scene.joint])

    def find_size(self, cause: Cause, scene: Circumstances, wanted: float, seed: int) -> float:
        """The size whose visible amplitude is a multiple of the noise floor.

        Raises:
            InputError: No physical size shows that much.
        """
        low, high = cause.bounds(scene)
        low = max(low, LEAST_SHARE * high) * (1.0 + SAME)
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
            remedy = "choose another amplitude, joint or motion"
            raise InputError(f"--effect {cause.id}", what, remedy)
        return size


def _push_window(hardware: Hardware, rows: VisibleRows) -> Bool[Array, " T"] | None:
    """Samples during a push, which would drown in the mean over the session; None without one."""
    push = hardware.contact
    if not push.body:
        return None
    during = (rows.time > push.start) & (rows.time < push.end)
    return (rows.run == hardware.contact_run) & during
