"""What a change of friction may be besides: another day, or another gain of the reading.

Friction differs between two sessions though nothing was done to the arm: joints are some kelvin warmer, grease has
settled. A mean of few sessions is no better known than that, however many runs they have. From run to run it wanders:
a session of R runs that set out where the last one did has a mean that is off by R / 3 of a step's variance. And where
friction is most of a joint's torque, a gain that changed scales it as more friction would: nothing in the recordings
distinguishes the two.

Source: Bittencourt and Gunnarsson 2010 (static friction falls by about one per cent a kelvin); runs of different days
of a UR10e differ by 2 to 5 % of their friction.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ident.arrays import Array, Float
from ident.diagnosis.change.candidates import COMMON_GAIN, OF_FRICTION
from ident.diagnosis.change.laws import FrictionChange
from ident.diagnosis.change.settings import CHANGE
from ident.diagnosis.regression.design import Group
from ident.diagnosis.regression.least_squares import Projection
from ident.effects.base import SessionContext
from ident.effects.session_context import friction_level

FRICTION, (BY_LOAD,), (GAIN,) = FrictionChange.id, COMMON_GAIN & OF_FRICTION, COMMON_GAIN - OF_FRICTION


@dataclass(frozen=True)
class DayToDay:
    """What friction differs by though nothing was done, as shares of a change."""

    between_day_std: float = 0.0  # standard deviation between any two sets of sessions, whatever their runs say
    walk_std: float = 0.0  # usual standard deviation from a run to the next; 0 for what does not wander
    sessions: tuple[int, int] = (1, 1)  # number of sessions of each set

    def walk_variance(self, runs: tuple[int, int]) -> float:
        """Variance of the difference of both sets' means, whose sessions each set out where friction was [1].

        Args:
            runs: Number of runs of each set.
        """
        pairs = zip(runs, self.sessions, strict=True)
        return self.walk_std**2 * sum(count / sessions**2 for count, sessions in pairs) / 3.0


def day_to_day(
    group: Group, session: SessionContext, beta: Array, spread: Float[Array, " n"], sessions: tuple[int, int]
) -> DayToDay:
    """What friction differs by though nothing was done to the arm, as shares of the change found.

    Args:
        group: The change; of one that is not of friction nothing is expected.
        session: The runs.
        beta: Its coefficients.
        spread: By how much each joint's friction differs from run to run of one set, as a share.
        sessions: Number of sessions of each set.
    """
    if group.effect.id not in OF_FRICTION:
        return DayToDay()
    # Another level of friction f shows in a law c as ⟨f, c⟩ / ⟨c, c⟩ of it: all of it in another level, little in what
    # differs between directions or places, unless the joint moves so little that they look alike.
    columns = group.effect.columns(group.effect.asked(session), group.joint, group.variant)
    change = np.concatenate(columns) @ beta
    friction = np.concatenate([run.friction[:, group.joint] for run in group.effect.asked(session).runs])
    share = max(float(change @ change / max(abs(float(friction @ change)), 1e-300)), 1e-12)
    between = CHANGE.day_to_day * np.sqrt(1.0 / sessions[0] + 1.0 / sessions[1])
    # One joint's few runs say little of how far it wanders; what is usual at this arm's joints says more.
    return DayToDay(float(between / share), float(np.median(spread) / share), sessions)


def is_gain_by_load(model: Projection, gain: Group, other: Group) -> bool:
    """Whether friction by load is a gain in disguise: beside both directions of load it holds the load itself.

    Where the gain alone explains nearly all that it explains, nothing of it is friction, and no day's friction stands
    behind the gain.

    Args:
        model: All that is known beside both.
        gain: What may be a gain.
        other: What may be friction by load at the same joint.
    """
    if (gain.effect.id, other.effect.id, gain.joint) != (GAIN, BY_LOAD, other.joint):
        return False
    alone, whole = (model.gain(one)[0] for one in (gain, other))
    return bool(alone >= CHANGE.gain_share * whole)


def may_be_gain(group: Group, session: SessionContext, beta: Array, covariance: Float[Array, "2 2"]) -> bool:
    """Whether a change of friction is the same share of all friction, at a joint whose torque is mostly friction.

    Args:
        group: The change.
        session: The runs.
        beta: Its coefficients.
        covariance: Theirs.
    """
    if group.effect.id != FRICTION:
        return False
    rigid, friction = (
        np.concatenate([getattr(run, kind)[:, group.joint] for run in session.runs]) for kind in ("rigid", "friction")
    )
    level = np.array(friction_level(session, group.joint))
    dry, viscous = beta / level
    spread = covariance / np.outer(level, level)
    error = np.sqrt(max(spread[0, 0] + spread[1, 1] - 2.0 * spread[0, 1], 0.0))
    return bool(rigid.std() < friction.std() and abs(dry - viscous) < CHANGE.same_share * error)
