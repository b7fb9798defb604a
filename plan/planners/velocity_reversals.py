"""Where joints turn round: friction changes its sign within a millisecond there, which nodes of a grid walk past.

Just before and just after, a joint needs what it needs without friction, and friction on top on one side or the other.
So the torque is looked at in the very place where the speed is nought, with as much speed put in as friction takes to
be fully there, one way and the other. And where pairs of shapes come near each other.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ident.arrays import Array, Float, Int
from ident.compiled import compiled
from plan.dynamics.power import ChainTorque, differentiate_torque
from plan.planners.transcription import Grid

# Speed at which friction is all but fully there, in widths of its transition; and where it has none [rad/s].
FULLY, NO_WIDTH = 3.0, 1e-3
# A joint that turns round with less acceleration stays there for a while: its place moves too fast to be followed.
SLOW = 0.5
# Steps of Newton's method to the places where joints turn round: a cubic's speed is quadratic.
NEWTON = 5


@compiled(nogil=True)
def _settled(shares, joints, inside, grid, coefficients, duration):  # type: ignore[no-untyped-def]
    """Shares of the duration at which each place's own joint stands still; places that are no turn stay."""
    (knots, taylor), out = grid, shares.copy()
    for i in range(shares.shape[0]):
        if not inside[i]:
            continue
        j = joints[i]
        for _ in range(NEWTON):
            k = min(max(np.searchsorted(knots, out[i], side="right") - 1, 0), len(knots) - 2)
            since, speed, rise = out[i] - knots[k], 0.0, 0.0
            for m in range(4):
                b, c, d = taylor[1, k, m], taylor[2, k, m], taylor[3, k, m]
                speed += coefficients[k + m, j] * (b + since * (c + since * d / 2.0))
                rise += coefficients[k + m, j] * (c + since * d)
            if abs(rise) <= duration * duration * SLOW:
                break
            out[i] = min(max(out[i] - speed / rise, 0.0), 1.0)
    return out


@dataclass(frozen=True, eq=False)
class Turns:
    """Places where a joint turns round, gets going, or comes to rest, each with one side of it."""

    shares: Float[Array, " m"]  # places as shares of the duration
    joints: Int[Array, " m"]  # the joint
    sides: Float[Array, " m"]  # sign of its speed on the side that is meant
    inside: Array  # whether it is a turn, not the motion's start or end

    @property
    def rows(self) -> Int[Array, " m"]:
        """Numbers of the places."""
        return np.arange(len(self.shares))

    def only(self, kept: Array) -> Turns:
        """Some of them."""
        return Turns(self.shares[kept], self.joints[kept], self.sides[kept], self.inside[kept])

    def settled(self, grid: Grid, coefficients: Float[Array, "C n"], duration: float) -> Turns:
        """The same turns where the speed is nought, by Newton's method on a trajectory's own speed."""
        sections, numbers = (grid.knots, grid.taylor), np.ascontiguousarray(coefficients)
        return replace(self, shares=_settled(self.shares, self.joints, self.inside, sections, numbers, duration))

    def on_their_side(self, model: ChainTorque, dq: Float[Array, "m n"]) -> Float[Array, "m n"]:
        """Speeds at the places, each place's own joint moving as fast as its friction takes to be there [rad/s]."""
        width = model.losses.transition_speed
        full = np.where(width > 0.0, FULLY * width, NO_WIDTH)
        out = dq.copy()
        out[self.rows, self.joints] = self.sides * full[self.joints]
        return out

    def torque(self, model: ChainTorque, states: tuple[Array, Array, Array]) -> Float[Array, " m"]:
        """Torque of each place's own joint [N m]."""
        q, dq, ddq = states
        tau = model.torque(q[None], self.on_their_side(model, dq)[None], ddq[None])[0]
        return np.asarray(tau[self.rows, self.joints])

    def gradient(
        self, model: ChainTorque, states: tuple[Array, Array, Array], jerk: Float[Array, "m n"]
    ) -> tuple[Float[Array, " m"], list[Float[Array, "m n"]]]:
        """Torque of each place's own joint, and its derivatives by the states there; the place goes with the turn.

        Where the joint's speed rises by δ, the turn comes earlier by δ / ddq, and the torque is what it was then.
        """
        q, dq, ddq = states
        tau, slopes = differentiate_torque(model, q, self.on_their_side(model, dq), ddq)
        rows, joints = self.rows, self.joints
        parts = [part[rows, joints].copy() for part in slopes]
        parts[1][rows, joints] = 0.0
        rising = sum((part * state).sum(axis=1) for part, state in zip(parts, (dq, ddq, jerk), strict=True))
        own = ddq[rows, joints]
        follows = self.inside & (np.abs(own) > SLOW)
        parts[1][rows, joints] = np.where(follows, -rising / np.where(follows, own, 1.0), 0.0)
        return tau[rows, joints], parts


def find_turns(shares: Float[Array, " T"], dq: Float[Array, "T n"], ddq: Float[Array, "T n"]) -> Turns:
    """The turns of a motion that is known at some places, from rest to rest.

    Args:
        shares: Places in order, from 0 to 1.
        dq, ddq: Speeds and accelerations there.
    """
    before, joints = np.nonzero(dq[:-1] * dq[1:] < 0.0)
    a, b = dq[before, joints], dq[before + 1, joints]
    places = shares[before] + (shares[before + 1] - shares[before]) * a / (a - b)
    n = dq.shape[1]
    push = np.concatenate([ddq[0], -ddq[-1]])
    ends = np.where(np.abs(push) > SLOW, np.sign(push), 0.0)  # one that gets going softly meets its friction later
    return Turns(
        np.concatenate([places, places, np.zeros(n), np.ones(n)]),
        np.concatenate([joints, joints, np.arange(n), np.arange(n)]),
        np.concatenate([np.ones(len(places)), -np.ones(len(places)), ends]),
        np.arange(2 * len(places) + 2 * n) < 2 * len(places),
    )


def find_dips(
    shares: Float[Array, " T"], gaps: Float[Array, "T P"], bound: float
) -> tuple[Float[Array, " m"], Int[Array, " m"], Float[Array, " m"]]:
    """Where along the motion each pair's gap dips below a bound, with the neighbours; and the pairs, and the gaps."""
    below, beside = gaps < bound, np.pad(gaps, ((1, 1), (0, 0)), constant_values=np.inf)
    bottoms = np.pad(below & (gaps <= beside[:-2]) & (gaps <= beside[2:]), ((1, 1), (0, 0)))
    places, pairs = np.nonzero(below & (bottoms[:-2] | bottoms[1:-1] | bottoms[2:]))
    return shares[places], pairs, gaps[places, pairs]
