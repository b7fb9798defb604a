"""What effects see of a session, never the measured torque; typical sizes in it, and reasons that
several share.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from ident.arrays import Array, Float
from ident.effects.intervals import coefficient_interval as coefficient_interval
from ident.effects.settings import TYPICAL as LIMIT
from ident.motion.motion import Motion
from ident.robot.arm import ArmModel
from ident.robot.limits import is_placeholder
from ident.units import ANGLE, unit_for

# A joint that covers less than this shows nothing of its friction [rad or m].
LEAST_TRAVEL = 0.03
# An effect that takes more than this share of what a joint can give leaves a joint that hardly
# moves by itself.
LARGEST_TORQUE_SHARE = 0.5


@dataclass(frozen=True, eq=False)
class RunContext:
    """One run as the effects see it; T samples of n joints, before the common filter.

    The regressor and the derivatives are computed once, when first asked for, and live as long as
    the run does: a long session is gone through with fresh copies of its runs
    (`dataclasses.replace`), a few at a time.
    """

    motion: Motion  # the run (q, dq, ddq smoothed, time on the session clock, filter)
    arm: ArmModel  # the rigid arm with its payload
    rigid: Float[Array, "T n"]  # rigid torque of the motion [N m]
    # Modelled torque that the joint transmits: rigid torque without rotor inertia and friction [N
    # m].
    link: Float[Array, "T n"]
    # modelled friction torque of the baseline (viscous + Coulomb) [N m]
    friction: Float[Array, "T n"]
    # Direction of sliding in [-1, 1]; each joint turns round over its own displacement or speed.
    direction: Float[Array, "T n"]
    temperature: Float[Array, "T n"] | None = None  # measured joint temperature [degC], or None
    position_command: Float[Array, "T n"] | None = None  # commanded position [rad], or None
    # Modelled torque of the rotors' inertia [N m], or None where it isn't modelled.
    rotor: Float[Array, "T n"] | None = None

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.motion.n

    @property
    def total(self) -> Float[Array, "T n"]:
        """Whole modelled torque of the motor, seen at the joint [N m]."""
        torque: Array = self.rigid + self.friction
        return torque if self.rotor is None else torque + self.rotor

    @cached_property
    def regressor(self) -> Float[Array, "T n 10n"]:
        """Regressor of the rigid torque in the links' inertial parameters, ten a link."""
        return self.arm.regressor(self.motion.q, self.motion.dq, self.motion.ddq)

    @cached_property
    def derivatives(
        self,
    ) -> tuple[Float[Array, "T n n"], Float[Array, "T n n"], Float[Array, "T n n"]]:
        """Derivatives of the rigid torque by position, velocity and acceleration.

        Entry (t, i, j) is that of joint i's torque by joint j's state [N m/rad, N m s/rad, kg m²].
        All samples of an entry lie side by side in memory: entries are asked for one by one.
        """
        by_sample = self.arm.derivatives(self.motion.q, self.motion.dq, self.motion.ddq)
        q, dq, ddq = (
            np.moveaxis(np.ascontiguousarray(np.moveaxis(derivative, 0, -1)), -1, 0)
            for derivative in by_sample
        )
        return q, dq, ddq

    @cached_property
    def kept(self) -> dict[Any, Any]:
        """A dict for what else was made of the run and will be asked for again; empty at first."""
        return {}

    def copied(self) -> RunContext:
        """A copy that has the derivatives if this one does.

        What more it computes goes with it.
        """
        copy = replace(self)
        if "derivatives" in vars(self):
            vars(copy)["derivatives"] = self.derivatives
        return copy

    @property
    def interval(self) -> float:
        """Sampling interval [s]."""
        return self.motion.interval


@dataclass(frozen=True, eq=False)
class SessionContext:
    """All runs, in order, and what holds for all of them."""

    runs: Sequence[RunContext]  # the runs
    common_clock: bool  # whether time goes on from run to run
    joint_names: tuple[str, ...]  # the joints
    gear_ratios: Float[Array, " n"] | None  # reduction of each joint, or None where it is not known
    rated_torque: Float[Array, " n"]  # effort limits [N m]
    # Change of the links' inertial numbers by tuning, shape (10 n,), or None where nobody tuned
    # them.
    tuned: Float[Array, " 10n"] | None = None

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.joint_names)

    def urdf_mass(self, link: int) -> float:
        """What a link weighs by the URDF, with all that is fixed to it [kg].

        The runs' arm is the tuned one: what a name takes off a link, tuning alone may have taken
        off it already.
        """
        mass = float(self.runs[0].arm.inertial_parameters[10 * link])
        return mass if self.tuned is None else mass - float(self.tuned[10 * link])


@dataclass(frozen=True)
class Variant:
    """One point of an effect's inner grid: the parameters in which its torque is not linear."""

    # Names (with units) and values, such as {"stribeck_velocity_rad_s": 0.05, "exponent": 2}; the
    # same names in all variants of an effect. They are reported, with intervals from their
    # likelihood over the grid.
    inner: Mapping[str, float] = field(default_factory=dict)
    other: int | None = None  # another joint that takes part (coupling), or None
    # Further parameters that the columns need and nobody asks for: centres and scales of the whole
    # session, points about which a law is linearised. Columns of a part of a session then match
    # those of the whole.
    shape: Mapping[str, float] = field(default_factory=dict)


def rated_torque(session: SessionContext, joint: int) -> float:
    """Rated torque of a joint [N m].

    Where the URDF has no limit it is half as much again as the largest modelled load of the joint
    and those behind it: motors do not grow towards the tip, and one about a vertical axis carries
    next to nothing of its size.
    """
    rated = float(session.rated_torque[joint])
    if np.isfinite(rated) and rated > 0.0 and not is_placeholder(session.rated_torque[joint]):
        return rated
    loads = []
    for run in session.runs:
        beyond = np.abs(run.total[:, joint:])
        loads.append(float(beyond.max(initial=0.0)))
    return max(1.5 * max(loads), 1e-3)


def joined(session: SessionContext, signal: str, joint: int) -> Float[Array, " T"]:
    """A joint's signal over all runs, one after the other.

    Args:
        session: The runs.
        signal: Name of one of the motion's (`q`, `dq`, `ddq`, `tau`) or of the run's own (`rigid`,
            `link`, `total`, …).
        joint: Index of the joint.
    """
    signals = []
    for run in session.runs:
        holder = run.motion if hasattr(run.motion, signal) else run
        signals.append(getattr(holder, signal)[:, joint])
    return np.concatenate(signals)


def usual_speed(session: SessionContext, joint: int) -> float:
    """Half of a joint's top speed, at which laws over speed are evaluated for sentences [rad/s]."""
    return max(0.5 * top_speed(session, joint), 1e-6)


def least_rest_speed(session: SessionContext, joint: int) -> float:
    """Least speed at which a joint is distinguished from one at rest, in any run [rad/s]."""
    return min(float(run.motion.rest_speed[joint]) for run in session.runs)


def friction_level(session: SessionContext, joint: int) -> tuple[float, float]:
    """Coulomb [N m] and viscous [N m s/rad] friction of a joint as the baseline has them.

    Typical shares of the rated torque where it has none; neither is zero.
    """
    gram = np.zeros((2, 2))
    right = np.zeros(2)
    for run in session.runs:
        direction = run.direction[:, joint]
        columns = np.stack([direction, run.motion.dq[:, joint]], axis=1)
        gram += columns.T @ columns
        right += columns.T @ run.friction[:, joint]
    coulomb, viscous = np.linalg.lstsq(gram, right, rcond=None)[0]
    typical = LIMIT.typical_coulomb_share * rated_torque(session, joint)
    # A tenth of the typical level is the least that a share may refer to.
    coulomb = max(float(coulomb), 0.1 * typical) if gram.any() and right.any() else typical
    return coulomb, max(float(viscous), 0.1 * coulomb / LIMIT.typical_viscous_speed)


def coulomb_level(session: SessionContext, joint: int) -> float:
    """Coulomb friction of a joint as `friction_level` has it, never zero [N m]."""
    return friction_level(session, joint)[0]


def slides(session: SessionContext, joint: int) -> bool:
    """Whether a joint slides instead of turning."""
    return bool(session.runs[0].arm.sliding_joints[joint])


def hardly_moves(session: SessionContext, joint: int) -> str | None:
    """Why friction can't show at a joint that hardly moves, in words; None where it moves."""
    low, high = travel(session, joint)
    name = session.joint_names[joint]
    if high - low < LEAST_TRAVEL:
        return f"{name} covers only {high - low:.3f} rad"
    ratios = []
    for run in session.runs:
        fastest = np.abs(run.motion.dq[:, joint]).max()
        ratios.append(float(fastest / run.motion.rest_speed[joint]))
    if max(ratios) < LIMIT.least_speed_ratio:
        return f"{name} hardly moves faster than its velocity noise"
    return None


def lacking(needs: Mapping[str, float], session: SessionContext, joint: int) -> str | None:
    """The first of an effect's needs that the recordings do not meet, in words; None where they
    meet all.

    Args:
        needs: By name the least travel [rad] or top speed [rad/s], or, of any value, that the joint
            `moves` or that the arm takes several `poses`. Of a joint that slides the same is asked
            in its own scale.
        session: The runs.
        joint: The joint.
    """
    name = session.joint_names[joint]
    is_sliding = slides(session, joint)
    scale = LIMIT.slide_per_turn if is_sliding else 1.0
    unit = unit_for(ANGLE, is_sliding)
    for need, least in needs.items():
        reason: str | None = None
        if need == "moves":
            reason = hardly_moves(session, joint)
        elif need == "poses":
            reason = _stays_near_a_pose(session)
        elif need == "travel":
            low, high = travel(session, joint)
            if high - low < scale * least:
                reason = f"{name} covers {high - low:.3g} {unit}; {scale * least:g} are needed"
        elif need == "top_speed":
            fastest = top_speed(session, joint)
            if fastest < scale * least:
                reason = f"{name} moves no faster than {fastest:.3g} {unit}/s"
        if reason:
            return reason
    return None


def _stays_near_a_pose(session: SessionContext) -> str | None:
    """The reason why several poses can't show, if no joint goes far."""
    ends = [travel(session, joint) for joint in range(session.n)]
    widest = max(high - low for low, high in ends)
    if widest < LIMIT.least_poses:
        return f"the arm stays near one pose: no joint covers more than {widest:.2f} rad"
    return None


def travel(session: SessionContext, joint: int) -> tuple[float, float]:
    """Lowest and highest position of a joint over all runs [rad or m]."""
    q = joined(session, "q", joint)
    return float(q.min()), float(q.max())


def top_speed(session: SessionContext, joint: int) -> float:
    """Speed that a joint exceeds in one of a hundred samples only [rad/s]."""
    return float(np.quantile(np.abs(joined(session, "dq", joint)), 0.99))


def typical_load(session: SessionContext, joint: int) -> float:
    """Root mean square of the torque that a joint transmits, never zero [N m]."""
    return max(float(np.sqrt(np.mean(joined(session, "link", joint) ** 2))), 1e-6)


def root_mean_square(columns: Sequence[Float[Array, "T ..."]]) -> float:
    """Root mean square over all entries of all runs; 0 without any."""
    count = sum(values.size for values in columns)
    squares = [float(np.sum(values**2)) for values in columns]
    return float(np.sqrt(sum(squares) / max(count, 1)))


def sampled_states(
    session: SessionContext,
) -> tuple[Float[Array, "t n"], Float[Array, "t n"], Float[Array, "t n"]]:
    """Some states evenly over the session: q, dq and ddq, in the order of time [rad, rad/s,
    rad/s²].
    """
    total = sum(len(run.motion.time) for run in session.runs)
    step = max(1, total // LIMIT.sampled_states)
    # a long session's runs are made anew when asked for, and let go one by one
    names = "q", "dq", "ddq"
    states: dict[str, list[Array]] = {name: [] for name in names}
    for name in names:
        for run in session.runs:
            states[name].append(getattr(run.motion, name)[::step])
    q, dq, ddq = (np.concatenate(states[name]) for name in names)
    return q, dq, ddq


def high_passed(values: Float[Array, " T"], interval: float, corner: float) -> Float[Array, " T"]:
    """What of a signal lies above a corner: the signal less its moving average of one period.

    Args:
        values: The signal.
        interval: Sampling interval [s].
        corner: The corner [Hz].
    """
    width = min(len(values), max(1, round(1.0 / (corner * interval))))
    sums = np.cumsum(np.concatenate([[0.0], values]))
    begin = np.arange(len(values)) - width // 2
    left = np.clip(begin, 0, None)
    right = np.clip(begin + width, None, len(values))
    average = (sums[right] - sums[left]) / (right - left)
    return np.asarray(values - average)


def wave(angle: Float[Array, " T"], cycles: float) -> Float[Array, "T 2"]:
    """Cosine and sine of an angle's multiple, the columns of a wave of any phase.

    Args:
        angle: The angle [rad].
        cycles: Waves a turn.
    """
    return np.stack([np.cos(cycles * angle), np.sin(cycles * angle)], axis=1)


def is_near(point: float, estimate: float, least: float) -> bool:
    """Whether a parameter that was found is about the one at which its law was made linear.

    Args:
        point: Where the law was made linear; not zero.
        estimate: What was found.
        least: Points up to this size are near to all smaller estimates, zero included.
    """
    ratio = estimate / point
    near_stop = abs(point) <= least and ratio < LIMIT.near
    return near_stop or 1.0 / LIMIT.near < ratio < LIMIT.near


def arm_mass(arm: ArmModel) -> float:
    """Mass of all moving links [kg]: what an arm weighs, it is rated by; tuning may take more off
    one than it has.
    """
    return float(np.maximum(arm.inertial_parameters[::10], 0.0).sum())


def arm_reach(arm: ArmModel) -> float:
    """Length of the chain from the first joint to the last link's centre of mass, stretched out
    [m].
    """
    placements = list(arm.model.jointPlacements)[2:]
    lengths = [np.linalg.norm(np.asarray(placement.translation)) for placement in placements]
    mass, *moment = arm.inertial_parameters[-10:-6]
    tip = float(np.linalg.norm(moment)) / float(mass) if mass > 0.0 else 0.0
    limits = arm.known_limits
    travels = limits.upper - limits.lower
    sliding = sum(float(travels[j]) for j in np.flatnonzero(arm.sliding_joints))
    if not np.isfinite(sliding):
        sliding = 0.0
    return float(sum(lengths)) + tip + sliding


def joint_range(
    session: SessionContext, joint: int, seen: tuple[float, float]
) -> tuple[float, float]:
    """Where a joint can go [rad or m].

    Args:
        session: The runs.
        joint: Index of the joint.
        seen: Lowest and highest position in the recordings.

    Returns:
        Its limits in the URDF; where it has none, or very wide ones, half a turn beyond what was
        seen.
    """
    limits = session.runs[0].arm.known_limits
    low = float(limits.lower[joint])
    high = float(limits.upper[joint])
    if np.isfinite(low) and np.isfinite(high) and high > low and high - low < 8.0 * np.pi:
        return low, high
    return seen[0] - np.pi, seen[1] + np.pi
