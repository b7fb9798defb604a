"""A trajectory as coefficients of cubic B-splines: clamped splines, in numbers that act locally.

A clamped cubic spline over K sections has K + 3 coefficients. The first two hold the start at rest
and the last two the goal; with the third and the third last held too, acceleration starts and ends
at zero, and jerk is bounded. The knots are shares of the whole duration T, so speed goes with 1/T
and acceleration with 1/T².
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.interpolate import BSpline

from ident.arrays import Array, Bool, Float, Int, freeze
from ident.compiled import compiled
from plan.spline import Splines

DEGREE = 3
# Coefficients that act in one section, counted from its first.
ACTING = np.arange(DEGREE + 1)
# Places a section at which a motion that is none of a grid's own is fitted to it.
FITTED = 8

States = tuple[Float[Array, "m n"], Float[Array, "m n"], Float[Array, "m n"]]
"""Position [rad], speed [rad/s] and acceleration [rad/s²] at some places."""


def sections_of(shares: Float[Array, " m"], knots: Float[Array, " K"]) -> Int[Array, " m"]:
    """The section in which each share of the duration lies.

    Args:
        shares: Places (m,), 0 to 1.
        knots: Ends of the sections in shares (K + 1,), rising.

    Returns:
        Numbers (m,), 0 to K - 1; a knot belongs to the section that it begins.
    """
    out = np.searchsorted(knots, shares, side="right") - 1
    return np.asarray(np.minimum(np.maximum(out, 0), len(knots) - 2))


@compiled(fastmath=True, nogil=True, error_model="numpy")
def _bases_at(shares, first, knots, taylor):  # type: ignore[no-untyped-def]
    """The B-splines of each place's own section and three derivatives, of shape (4, m, 4).

    By their Taylor series.
    """
    out = np.empty((4, shares.shape[0], 4))
    for i in range(shares.shape[0]):
        k = first[i]
        since = shares[i] - knots[k]
        for m in range(4):
            a = taylor[0, k, m]
            b = taylor[1, k, m]
            c = taylor[2, k, m]
            d = taylor[3, k, m]
            out[0, i, m] = a + since * (b + since * (c / 2.0 + since * d / 6.0))
            out[1, i, m] = b + since * (c + since * d / 2.0)
            out[2, i, m] = c + since * d
            out[3, i, m] = d
    return out


@dataclass(frozen=True, eq=False)
class Grid:
    """Knots of a trajectory, as shares of its duration, and nodes where it is looked at."""

    knots: Float[Array, " K"]  # shares of the duration, from 0 to 1
    soft: bool = False  # whether acceleration is zero at both ends
    # Local times at which every section is looked at, 0 to 1.
    nodes: Float[Array, " m"] = field(default_factory=lambda: freeze(np.linspace(0.0, 1.0, 5)))
    # Equal parts of the duration at whose ends knots are set; None where they may lie anywhere.
    steps: int | None = None

    @property
    def sections(self) -> int:
        """Number of sections."""
        return len(self.knots) - 1

    @property
    def held(self) -> int:
        """Coefficients that are held at each end."""
        return 3 if self.soft else 2

    @property
    def free(self) -> int:
        """Coefficients of each joint that are free."""
        return self.sections + DEGREE - 2 * self.held

    @cached_property
    def places(self) -> Float[Array, " C"]:
        """Where each coefficient acts most, as a share of the duration."""
        windows = np.lib.stride_tricks.sliding_window_view(self._padded[1:-1], DEGREE)
        return freeze(windows.mean(axis=1))

    @cached_property
    def shares(self) -> Float[Array, " T"]:
        """Places of all nodes as shares of the duration, section by section."""
        widths = np.diff(self.knots)
        return freeze((self.knots[:-1, None] + widths[:, None] * self.nodes).reshape(-1))

    @cached_property
    def first(self) -> Int[Array, " T"]:
        """The first of the four coefficients that act at each node, among all of them."""
        return np.repeat(np.arange(self.sections), len(self.nodes))

    @cached_property
    def bases(self) -> Float[Array, "4 T 4"]:
        """What the four coefficients give at each node.

        Position, and its first three derivatives by the share.
        """
        return freeze(_bases_at(self.shares, self.first, self.knots, self.taylor))

    @cached_property
    def taylor(self) -> Float[Array, "4 K 4"]:
        """Value and derivatives of each section's four B-splines at its beginning."""
        splines = BSpline(self._padded, np.eye(self.sections + DEGREE), DEGREE)
        begins = self.knots[:-1]
        middles = (self.knots[:-1] + self.knots[1:]) / 2
        values = [splines(begins)]
        values.extend(splines.derivative(order)(begins) for order in range(1, DEGREE))
        values.append(splines.derivative(DEGREE)(middles))  # steady in a section
        rows = np.arange(self.sections)[:, None]
        return freeze([value[rows, rows + ACTING] for value in values])

    @cached_property
    def _padded(self) -> Float[Array, " q"]:
        return np.concatenate([np.zeros(DEGREE), self.knots, np.ones(DEGREE)])

    def coefficients(
        self, free: Float[Array, "F n"], start: Float[Array, " n"], goal: Float[Array, " n"]
    ) -> Float[Array, "C n"]:
        """All coefficients of the B-spline, those that are held at its ends included.

        Args:
            free: The coefficients that a planner moves [rad or m].
            start, goal: Ends of the motion: the values of the held ones [rad or m].

        Returns:
            The C = F + 2 `held` coefficients.
        """
        before = np.repeat(start[None], self.held, 0)
        behind = np.repeat(goal[None], self.held, 0)
        return np.concatenate([before, free, behind])

    def at(self, shares: Float[Array, " m"]) -> tuple[Float[Array, "4 m 4"], Int[Array, " m"]]:
        """What the four coefficients that act give at shares of the duration, and which these are.

        Args:
            shares: Places, 0 to 1.

        Returns:
            Position and three derivatives by the share, as in `bases`; number of the first, as in
            `first`.
        """
        places = freeze(shares)
        first = sections_of(places, self.knots)
        return _bases_at(places, first, self.knots, self.taylor), first

    def positions(
        self, coefficients: Float[Array, "C n"], shares: Float[Array, " m"]
    ) -> Float[Array, "m n"]:
        """Positions at any shares of the duration."""
        bases, first = self.at(shares)
        return np.asarray(np.einsum("tk,tkn->tn", bases[0], _acting(coefficients, first)))

    def states(
        self,
        coefficients: Float[Array, "C n"],
        duration: float,
        shares: Float[Array, " m"] | None = None,
    ) -> States:
        """Position, speed and acceleration at all nodes, or at given shares of the duration."""
        bases, first = (self.bases, self.first) if shares is None else self.at(shares)
        local = _acting(coefficients, first)
        q, by_share, twice_by_share = np.einsum("ptk,tkn->ptn", bases[:3], local)
        return q, by_share / duration, twice_by_share / duration**2

    def jerk(self, coefficients: Float[Array, "C n"], duration: float) -> Float[Array, "K n"]:
        """Jerk of every section, constant in it [rad/s³]."""
        local = _acting(coefficients, np.arange(self.sections))
        by_share = np.einsum("sk,skn->sn", self.taylor[3], local)
        return np.asarray(by_share) / duration**3

    def splines(self, coefficients: Float[Array, "C n"], duration: float) -> Splines:
        """The trajectory by its knots: a batch of one."""
        local = _acting(coefficients, np.arange(self.sections))
        begins = np.einsum("sk,skn->sn", self.taylor[0], local)
        points = np.concatenate([begins, coefficients[-1:]])
        points[0] = coefficients[0]
        durations = np.diff(self.knots) * duration
        return Splines(points[None], durations[None])

    def fit(self, splines: Splines) -> Float[Array, "F n"]:
        """Free coefficients of the first of a batch of splines.

        Exact where its knots are among these.

        The coefficients are the spline's polar values at three neighbouring knots each; for a
        spline that is none of this grid they are chosen by least squares over the nodes.
        """
        total = float(splines.total[0])
        even = np.linspace(0.0, 1.0, FITTED * self.sections + 1)[1:-1]
        places = np.unique(np.concatenate([even, self.knots[1:-1]]))
        wanted = splines.at(places * total)[0]
        design = BSpline.design_matrix(places, self._padded, DEGREE).toarray()
        at_start = design[:, : self.held].sum(axis=1)[:, None]
        at_goal = design[:, -self.held :].sum(axis=1)[:, None]
        rest = wanted - at_start * splines.points[0, 0]
        rest -= at_goal * splines.points[0, -1]
        free = design[:, self.held : -self.held]
        return np.asarray(np.linalg.lstsq(free, rest, rcond=None)[0])

    def parted(self, parts: Int[Array, " K"]) -> Grid:
        """A grid with each section cut into so many equal ones, one number a section; on steps
        nearly equal ones, and fewer where there are no more steps.

        Every trajectory of this grid is one of that, too.
        """
        widths = np.repeat(np.diff(self.knots) / parts, parts)
        knots = np.concatenate([[0.0], np.cumsum(widths)])
        knots = on_steps(knots, self.steps)
        whole = np.concatenate([[0], np.cumsum(parts)])
        knots[whole] = self.knots
        return replace(self, knots=freeze(knots))

    @property
    def single_steps(self) -> Bool[Array, " K"]:
        """Which sections are one step long, so that they can't be cut."""
        if self.steps is None:
            return np.zeros(self.sections, dtype=bool)
        return np.diff(self.knots) * self.steps < 1.5


def on_steps(knots: Float[Array, " K"], steps: int | None) -> Float[Array, " K"]:
    """Knots, as shares of a duration, moved to the nearest ends of so many equal parts of it.

    Args:
        knots: Shares, from 0 to 1.
        steps: How many parts; None leaves the knots where they are.
    """
    return knots if steps is None else np.asarray(np.round(knots * steps) / steps)


def _acting(coefficients: Float[Array, "C n"], first: Int[Array, " m"]) -> Float[Array, "m 4 n"]:
    """The coefficients that act at each of some places, by the first of them."""
    return np.asarray(coefficients[first[:, None] + ACTING])
