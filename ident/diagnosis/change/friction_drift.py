"""Alternatives to a change of friction: variation from day to day and from run to run, or a changed gain.

Friction differs between two sessions though nothing was done to the arm: joints are some kelvin warmer, grease has
settled. So the mean of few sessions is uncertain by a between-day variance, however many runs they have. From run to
run friction follows a random walk: the mean of R runs that start from a common level is off by R / 3 of a step's
variance. And where friction is most of a joint's torque, a changed gain scales it as a change of friction would: the
recordings do not distinguish the two.

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
from ident.effects.base import SessionContext
from ident.effects.session_context import friction_level
from ident.regression.design import Group
from ident.regression.least_squares import Projection

FRICTION, (BY_LOAD,), (GAIN,) = FrictionChange.id, COMMON_GAIN & OF_FRICTION, COMMON_GAIN - OF_FRICTION


@dataclass(frozen=True)
class DayToDay:
    """Variation of friction without a change of the arm, as shares of an estimated change."""

    between_day_std: float = 0.0  # standard deviation of the difference of two sets, by the days of their sessions
    walk_std: float = 0.0  # standard deviation of the random walk's step from run to run
    sessions: tuple[int, int] = (1, 1)  # number of sessions of each set

    def walk_variance(self, runs: tuple[int, int]) -> float:
        """Variance of the difference of both sets' means by the random walk, all sessions starting at one level.

        Args:
            runs: Number of runs of each set.
        """
        pairs = zip(runs, self.sessions, strict=True)
        return self.walk_std**2 * sum(count / sessions**2 for count, sessions in pairs) / 3.0


def day_to_day(
    group: Group, session: SessionContext, beta: Array, spread: Float[Array, " n"], sessions: tuple[int, int]
) -> DayToDay:
    """Variation of friction without a change of the arm, as shares of an estimated change.

    Args:
        group: The change; the variation is zero if it is not one of friction.
        session, beta: The runs, and the change's coefficients.
        spread: Between-run standard deviation of each joint's friction, as a share.
        sessions: Number of sessions of each set.
    """
    if group.effect.id not in OF_FRICTION:
        return DayToDay()
    # A relative change of the friction f appears in the law's torque c as ⟨f, c⟩ / ⟨c, c⟩ of it: fully in a level,
    # little in an asymmetry or a dependence on position, unless the joint moves so little that these are collinear.
    columns = group.effect.columns(session, group.joint, group.variant)
    change = np.concatenate(columns) @ beta
    friction = np.concatenate([run.friction[:, group.joint] for run in session.runs])
    share = max(float(change @ change / max(abs(float(friction @ change)), 1e-300)), 1e-12)
    between = CHANGE.day_to_day * np.sqrt(1.0 / sessions[0] + 1.0 / sessions[1])
    # Few runs determine one joint's step badly: the median over the arm's joints is used.
    return DayToDay(float(between / share), float(np.median(spread) / share), sessions)


def is_gain_by_load(model: Projection, gain: Group, other: Group) -> bool:
    """Whether load-dependent friction is a gain error, for over both directions of load it holds the load itself.

    It is if the gain error alone explains nearly all that it explains.

    Args:
        model, gain: The model beside both, and the candidate that may be a gain error.
        other: The candidate that may be load-dependent friction at the same joint.
    """
    if (gain.effect.id, other.effect.id, gain.joint) != (GAIN, BY_LOAD, other.joint):
        return False
    alone, whole = (model.gain(one)[0] for one in (gain, other))
    return bool(alone >= CHANGE.gain_share * whole)


def may_be_gain(group: Group, session: SessionContext, beta: Array, covariance: Float[Array, "2 2"]) -> bool:
    """Whether dry and viscous friction change by the same share, at a joint whose torque is mostly friction.

    Args:
        group, session: The change, and the runs.
        beta, covariance: The change's coefficients, and their covariance.
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
