"""A push from outside: a force at the last link during a window of time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.ndimage import uniform_filter1d

from ident.arm import ArmModel
from ident.arrays import Array, Float
from ident.effects.base import Effect, Interval, RunContext, SessionContext, Variant
from ident.effects.levels import amplitude_interval, exactly
from ident.effects.rigid_body import point_mass

# Windows of the plain grid: each costs three columns in every joint's regression.
MOST_WINDOWS = 16
SHORTEST_WINDOW = 0.5  # [s]
EDGE = 0.1  # Time in which the force sets in and fades [s].
LARGEST_FORCE = 200.0  # [N]
# Screening: stretches whose mean square is this many times the joint's median one are candidates.
SCREEN_RATIO = 4.0


@dataclass(frozen=True)
class ExternalContact(Effect):
    """A force f, constant in the base frame, at the last link's centre of mass during a window: τ = −Jᵀ f.

    Without windows of its own it lays an even grid of at most 16 windows over the session, which finds long pushes
    only: one of a second in a window of eight has an eighth of its power. Give it the windows where something is left
    to explain (`screen_windows`), and count all windows that were screened when judging significance.

    Attributes:
        windows: Start and end of each window [s], on the clock of the run that it names.
    """

    windows: tuple[tuple[str, float, float], ...] = ()

    id = "external_contact"
    scope = "arm"
    rows = "all"
    summary = "something pushes the arm for a while; repeat the motion in free space"

    def variants(self, session: SessionContext, joint: int) -> Sequence[Variant]:
        windows = self.windows or even_windows(session)
        return tuple(
            Variant(shape={"start_s": start, "end_s": end, _run_key(name): 1.0}) for name, start, end in windows
        )

    def columns(self, session: SessionContext, joint: int, variant: Variant) -> list[Float[Array, "T ..."]]:
        return [_push(run, variant) for run in session.runs]

    def parameters(
        self, session: SessionContext, joint: int, variant: Variant, coefficients: Array, covariance: Array
    ) -> dict[str, Interval]:
        start, end = variant.shape["start_s"], variant.shape["end_s"]
        doubt = (end - start) / 4
        return {
            "start_s": Interval(start, start - doubt, start + doubt),
            "end_s": Interval(end, end - doubt, end + doubt),
            "force_N": amplitude_interval(coefficients, covariance),
            "link": exactly(float(session.n)),
        }

    def prior_scale(self, session: SessionContext, joint: int, variant: Variant) -> Float[Array, " k"]:
        return np.full(3, LARGEST_FORCE)


def even_windows(session: SessionContext) -> tuple[tuple[str, float, float], ...]:
    """Windows of one length that cover all runs."""
    lengths = [float(run.motion.time[-1] - run.motion.time[0]) for run in session.runs]
    spare = max(1, MOST_WINDOWS - len(lengths))
    length = max(SHORTEST_WINDOW, sum(lengths) / spare)
    found = []
    for run, duration in zip(session.runs, lengths, strict=True):
        edges = np.linspace(run.motion.time[0], run.motion.time[-1], max(1, int(duration / length)) + 1)
        found += [(run.motion.name, float(a), float(b)) for a, b in pairwise(edges)]
    # More runs than windows: the longest runs are looked at.
    longest = sorted(found, key=lambda window: window[1] - window[2])[:MOST_WINDOWS]
    return tuple(window for window in found if window in longest)


def screen_windows(
    session: SessionContext, leftover: Sequence[Float[Array, "t n"]], most: int = 8
) -> tuple[tuple[str, float, float], ...]:
    """Windows in which much more torque is left unexplained than usual, the strongest first.

    Args:
        session: The session.
        leftover: For each run what the model leaves of the torque, filtered and decimated [N m].
        most: Largest number of windows.
    """
    usual = np.sqrt(np.median(np.concatenate(list(leftover)) ** 2, axis=0) / 0.455) + 1e-12
    found: list[tuple[float, str, float, float]] = []
    for run, values in zip(session.runs, leftover, strict=True):
        time = run.motion.time[run.motion.coarse]
        step = max(1, round(SHORTEST_WINDOW / 2 / (run.interval * run.motion.lowpass.factor)))
        power = np.mean((values / usual) ** 2, axis=1)
        count = len(power) // step
        strong = power[: count * step].reshape(count, step).mean(axis=1) > SCREEN_RATIO
        edges = np.flatnonzero(np.diff(np.concatenate([[0], strong.astype(int), [0]])))
        fine = uniform_filter1d(power, max(1, round(EDGE * step / (SHORTEST_WINDOW / 2))))
        for first, last in zip(edges[::2], edges[1::2], strict=True):
            cells = slice(first * step, last * step)
            # Cells cut a push anywhere: it lasts for as long as the power is at least a quarter of its mean.
            around = np.arange(max(first - 1, 0) * step, min((last + 1) * step, len(power)))
            inside = around[fine[around] > 0.25 * power[cells].mean()]
            start, end = float(time[inside[0]]), float(time[inside[-1]])
            found.append((float(power[cells].sum()), run.motion.name, start, max(end, start + 2 * EDGE)))
    return tuple(window[1:] for window in sorted(found, reverse=True)[:most])


def _run_key(name: str) -> str:
    return f"run {name}"


def _push(run: RunContext, variant: Variant) -> Float[Array, "T n 3"]:
    """−Jᵀ for the three directions of the base frame, inside the window."""
    time = run.motion.time
    columns = np.zeros((len(time), run.n, 3))
    start, end = variant.shape["start_s"], variant.shape["end_s"]
    inside = np.flatnonzero((time > start) & (time < end))
    if _run_key(run.motion.name) not in variant.shape or len(inside) == 0:
        return columns
    edge = min(EDGE, (end - start) / 4)
    ramp = np.clip(np.minimum(time[inside] - start, end - time[inside]) / edge, 0.0, 1.0)
    envelope = 0.5 - 0.5 * np.cos(np.pi * ramp)
    columns[inside] = envelope[:, None, None] * force_columns(run.arm, run.motion.q[inside])
    return columns


def force_columns(arm: ArmModel, q: Float[Array, "T n"]) -> Float[Array, "T n 3"]:
    """Torque that holds a unit force along each axis of the base frame, at the last link's centre of mass [m].

    That of a unit mass there in a field along the axis, all links being without mass.
    """
    last = arm.inertial_parameters[-10:]
    massless = np.zeros(10 * arm.n)
    massless[-10:] = point_mass(last[1:4] / max(float(last[0]), 1e-9))
    probe = arm.with_inertial_parameters(massless)
    return np.stack([probe.with_gravity(axis).gravity(q) for axis in np.eye(3)], axis=-1)
