"""All ways in which an arm can bring one of its frames to a pose."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from ident.arrays import Array, Float, freeze
from ident.robot.arm import ArmModel
from plan.problem.rules import Pose

# Places that the search starts from, most steps from each, and their damping.
STARTS = 160
STEPS = 60
DAMPING = 1e-4
# Damping stays between these; where it would have to be more, no step leads nearer.
LEAST_DAMPING = 1e-12
MOST_DAMPING = 1e6
# What counts as there: of the frame's place [m] and its turn [rad] together.
THERE = 1e-7
# Longest step of a joint [rad or m].
LONGEST = 0.5
# Two ways are the same where no joint differs by more than this [rad or m].
SAME = 0.05
# Metres that count as much as a radian, where neither place nor turn is reached.
ARM_OF_TURN = 0.2
# Most ways that are given: a seventh joint makes them endless.
MOST = 16


def reach_pose(
    arm: ArmModel,
    pose: Pose,
    frame: str,
    start: Float[Array, " n"],
    lower: Float[Array, " n"],
    upper: Array,
) -> tuple[list[Array], int, tuple[float, float]]:
    """Every joint position that brings a frame to a pose.

    It is looked for by damped Gauss-Newton steps from many places.

    Args:
        arm: The arm.
        pose: Where the frame is to be.
        frame: The frame's name.
        start: Where the arm stands; joints that turn all round are brought as near to it as their
            limits allow.
        lower, upper: Position limits.

    Returns:
        Joint positions, the nearest to the start first; how many more there are beyond the position
        limits; and how near the frame comes where no way leads there, place [m] and turn [rad].
    """
    rng = np.random.default_rng(0)  # fixed: which ways there are must not depend on the run's seed
    low = np.maximum(lower, start - np.pi)
    high = np.minimum(upper, start + np.pi)
    wide = low >= high
    low = np.where(wide, lower, low)
    high = np.where(wide, upper, high)
    solver = PoseSolver(arm, frame)
    inside: list[Array] = []
    outside: list[Array] = []
    nearest = (np.inf, np.inf)
    for number in range(STARTS):
        guess = start if number == 0 else rng.uniform(low, high)
        q, missed = solver.descend(pose, guess)
        if max(missed) > THERE:
            nearest = min(nearest, missed, key=_distance)
            continue
        q = solver.unwind(q, start, lower, upper)
        allowed = np.all(q >= lower) and np.all(q <= upper)
        ways = inside if allowed else outside
        if not any(np.abs(q - other).max() < SAME for other in ways):
            ways.append(q)
    inside.sort(key=lambda q: float(np.abs(q - start).max()))
    return [freeze(q) for q in inside[:MOST]], len(outside), nearest


def _distance(missed: tuple[float, float]) -> float:
    """How far a frame is from its pose, of what it misses by place [m] and turn [rad]."""
    place, turn = missed
    return place + ARM_OF_TURN * turn


class PoseSolver:
    """Brings one frame, known by its name, to places and poses."""

    def __init__(self, arm: ArmModel, frame: str) -> None:
        self._model = arm.model
        self._data = arm.model.createData()
        names = [known.name for known in arm.model.frames]
        self._frame = max(number for number, name in enumerate(names) if name == frame)

    def place(self, q: Float[Array, " n"]) -> Float[Array, " 3"]:
        """The frame's place at a joint position [m]."""
        pin.framesForwardKinematics(self._model, self._data, np.asarray(q, dtype=float))
        return np.array(self._data.oMf[self._frame].translation)

    def descend(self, pose: Pose, q: Float[Array, " n"]) -> tuple[Array, tuple[float, float]]:
        """Newton's way, damped, from a position towards a pose of the frame.

        Args:
            pose: The place sought, and the axes if they matter.
            q: Joint positions to begin from (n,) [rad].

        Returns:
            The joint positions where it ends, limits not looked at; and what is missed there: place
            [m], turn [rad].
        """
        q = np.array(q)
        damping = DAMPING
        missed, jacobian = self._look(pose, q)
        for _ in range(STEPS):
            if float(np.abs(missed).max()) < 0.1 * THERE:
                break
            step = _damped_step(missed, jacobian, damping)
            missed_there, jacobian_there = self._look(pose, q + step)
            if missed_there @ missed_there < missed @ missed:
                q = q + step
                missed = missed_there
                jacobian = jacobian_there
                damping = max(0.1 * damping, LEAST_DAMPING)
                continue
            damping *= 10.0
            if damping > MOST_DAMPING:
                break
        place = float(np.linalg.norm(missed[:3]))
        turn = 0.0
        if len(missed) > 3:
            turn = float(np.linalg.norm(missed[3:]))
        return q, (place, turn)

    def unwind(self, q: Array, start: Array, lower: Array, upper: Array) -> Float[Array, " n"]:
        """The same position, every turning joint as near to the start as its limits allow.

        Args:
            q: Joint positions [rad].
            start: Positions to be near to.
            lower: Lower limits.
            upper: Upper limits.

        Returns:
            `q` by whole turns; where no turn keeps a joint's limits, the turn nearest to the start.
        """
        unwound = q.copy()
        full_turn = 2.0 * np.pi
        for j in range(len(q)):
            if not self._model.joints[j + 1].shortname().startswith("JointModelR"):
                continue
            near = q[j] + full_turn * np.round((start[j] - q[j]) / full_turn)
            angles = near + full_turn * np.array([0.0, -1.0, 1.0])
            allowed = [angle for angle in angles if lower[j] <= angle <= upper[j]]
            unwound[j] = near
            if allowed:
                unwound[j] = min(allowed, key=lambda angle: abs(angle - start[j]))
        return unwound

    def _look(self, pose: Pose, q: Array) -> tuple[Array, Array]:
        """What is missed, place and turn, and its derivative."""
        axes = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        jacobian = pin.computeFrameJacobian(self._model, self._data, q, self._frame, axes)
        pin.updateFramePlacement(self._model, self._data, self._frame)
        placement = self._data.oMf[self._frame]
        away = placement.translation - pose.place
        if pose.rotation is None:
            return away, jacobian[:3]
        rest = placement.rotation @ pose.rotation.T
        turn_slope = pin.Jlog3(rest) @ rest.T @ jacobian[3:]
        slope = np.concatenate([jacobian[:3], turn_slope])
        return np.concatenate([away, pin.log3(rest)]), slope


def _damped_step(missed: Array, jacobian: Array, damping: float) -> Float[Array, " n"]:
    """A Gauss-Newton step, no longer than is believed [rad or m]."""
    normal = jacobian.T @ jacobian
    damped = normal + damping * np.eye(jacobian.shape[1])
    step = -np.linalg.solve(damped, jacobian.T @ missed)
    longest = max(float(np.abs(step).max()), 1e-12)
    step *= min(1.0, LONGEST / longest)
    return step
