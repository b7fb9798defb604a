"""Where joints turn round: friction changes its sign within a millisecond there.

Nodes of a grid walk past that. Just before and just after, a joint needs what it needs without
friction, and friction on top on one side or the other. So the torque is looked at in the very place
where the speed is nought, with as much speed put in as friction takes to be fully there, one way
and the other. And where pairs of shapes come near each other.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ident.arrays import Array, Bool, Float, Int
from ident.compiled import compiled
from plan.dynamics.power import ChainTorque, differentiate_torque
from plan.planners.transcription import Grid, States

# Speed at which friction is all but fully there, in widths of its transition.
FULLY = 3.0
# The same where friction has no transition [rad/s].
NO_WIDTH = 1e-3
# A joint that turns round with less acceleration stays there for a while: its place moves too fast
# to be followed [rad/s²].
SLOW = 0.5
# Steps of Newton's method to the places where joints turn round: a cubic's speed is quadratic.
NEWTON = 5


@compiled(nogil=True, error_model="numpy")
def _settled(shares, joints, inside, grid, coefficients, duration):  # type: ignore[no-untyped-def]
    """Shares of the duration at which each place's own joint stands still.

    Places that are no turn stay.
    """
    knots, taylor = grid
    out = np.empty(shares.shape[0])
    slow = duration * duration * SLOW
    last = knots.shape[0] - 2
    for i in range(shares.shape[0]):
        out[i] = shares[i]
        if not inside[i]:
            continue
        j = joints[i]
        for _ in range(NEWTON):
            k = 0
            while k < last and knots[k + 1] <= out[i]:
                k += 1
            since = out[i] - knots[k]
            speed = 0.0
            rise = 0.0
            for m in range(4):
                b = taylor[1, k, m]
                c = taylor[2, k, m]
                d = taylor[3, k, m]
                speed += coefficients[k + m, j] * (b + since * (c + since * d / 2.0))
                rise += coefficients[k + m, j] * (c + since * d)
            if abs(rise) <= slow:
                break
            out[i] = min(max(out[i] - speed / rise, 0.0), 1.0)
    return out


@dataclass(frozen=True, eq=False)
class Reversals:
    """Places where a joint turns round, gets going, or comes to rest, each with one side of it."""

    shares: Float[Array, " m"]  # places as shares of the duration
    joints: Int[Array, " m"]  # the joint
    sides: Float[Array, " m"]  # sign of its speed on the side that is meant
    inside: Bool[Array, " m"]  # whether it is a turn, not the motion's start or end

    @property
    def rows(self) -> Int[Array, " m"]:
        """Numbers of the places."""
        return np.arange(len(self.shares))

    def only(self, chosen: Bool[Array, " m"]) -> Reversals:
        """Some of them."""
        return Reversals(
            self.shares[chosen],
            self.joints[chosen],
            self.sides[chosen],
            self.inside[chosen],
        )

    def settled(self, grid: Grid, coefficients: Float[Array, "C n"], duration: float) -> Reversals:
        """These turns, moved to where the motion's speed is nought, by Newton's method.

        Args:
            grid: The motion's.
            coefficients: The motion's (C, n) [rad].
            duration: The motion's [s].
        """
        shares = _settled(
            self.shares,
            self.joints,
            self.inside,
            (grid.knots, grid.taylor),
            np.ascontiguousarray(coefficients),
            duration,
        )
        return replace(self, shares=shares)

    def on_their_side(self, model: ChainTorque, dq: Float[Array, "m n"]) -> Float[Array, "m n"]:
        """Speeds at the places, each place's own joint as fast as its friction takes [rad/s]."""
        width = model.losses.transition_speed
        full = np.where(width > 0.0, FULLY * width, NO_WIDTH)
        out = dq.copy()
        out[self.rows, self.joints] = self.sides * full[self.joints]
        return out

    def torque(self, model: ChainTorque, states: States) -> Float[Array, " m"]:
        """Torque of each place's own joint [N m]."""
        q, dq, ddq = states
        moving = self.on_their_side(model, dq)
        tau = model.torque(q[None], moving[None], ddq[None])[0]
        return np.asarray(tau[self.rows, self.joints])

    def gradient(
        self, model: ChainTorque, states: States, jerk: Float[Array, "m n"]
    ) -> tuple[Float[Array, " m"], list[Float[Array, "m n"]]]:
        """Torque of each place's own joint, and its derivatives by the states there.

        The place goes with the turn: where the joint's speed rises by δ, the turn comes earlier by
        δ / ddq, and the torque is what it was then.
        """
        q, dq, ddq = states
        tau, slopes = differentiate_torque(model, q, self.on_their_side(model, dq), ddq)
        rows = self.rows
        joints = self.joints
        by_states = [slope[rows, joints].copy() for slope in slopes]
        by_states[1][rows, joints] = 0.0
        rising = np.zeros(len(rows))
        for slope, rate in zip(by_states, (dq, ddq, jerk), strict=True):
            rising += (slope * rate).sum(axis=1)
        acceleration = ddq[rows, joints]
        follows = self.inside & (np.abs(acceleration) > SLOW)
        divisor = np.where(follows, acceleration, 1.0)
        by_states[1][rows, joints] = np.where(follows, -rising / divisor, 0.0)
        return tau[rows, joints], by_states


def find_turns(
    shares: Float[Array, " T"], dq: Float[Array, "T n"], ddq: Float[Array, "T n"]
) -> Reversals:
    """The turns of a motion that is known at some places, from rest to rest.

    Args:
        shares: Places in order, from 0 to 1.
        dq, ddq: Speeds and accelerations there.
    """
    before, joints = np.nonzero(dq[:-1] * dq[1:] < 0.0)
    first = dq[before, joints]
    second = dq[before + 1, joints]
    places = shares[before] + (shares[before + 1] - shares[before]) * first / (first - second)
    count = len(places)
    n = dq.shape[1]
    each = np.arange(n)
    push = np.concatenate([ddq[0], -ddq[-1]])
    # One that gets going softly meets its friction later.
    ends = np.where(np.abs(push) > SLOW, np.sign(push), 0.0)
    return Reversals(
        np.concatenate([places, places, np.zeros(n), np.ones(n)]),
        np.concatenate([joints, joints, each, each]),
        np.concatenate([np.ones(count), -np.ones(count), ends]),
        np.arange(2 * count + 2 * n) < 2 * count,
    )


def find_dips(
    shares: Float[Array, " T"], gaps: Float[Array, "T P"], bound: float
) -> tuple[Float[Array, " m"], Int[Array, " m"], Float[Array, " m"]]:
    """Where along the motion each pair's gap dips below a bound, with the neighbours.

    Returns:
        Places, pairs, and the gaps there.
    """
    below = gaps < bound
    beside = np.pad(gaps, ((1, 1), (0, 0)), constant_values=np.inf)
    lowest = below & (gaps <= beside[:-2]) & (gaps <= beside[2:])
    bottoms = np.pad(lowest, ((1, 1), (0, 0)))
    near_bottom = bottoms[:-2] | bottoms[1:-1] | bottoms[2:]
    places, pairs = np.nonzero(below & near_bottom)
    return shares[places], pairs, gaps[places, pairs]
