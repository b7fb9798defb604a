"""All ways in which an arm can bring one of its frames to a pose."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from ident.arrays import Array, Float, freeze
from ident.robot.arm import ArmModel
from plan.problem.rules import Pose

# Places that the search starts from, most steps from each, and their damping.
STARTS, STEPS, DAMPING = 160, 60, 1e-4
# What counts as there: of the frame's place [m] and its turn [rad] together.
THERE = 1e-7
# Longest step of a joint [rad or m]. Two ways are one where no joint differs by more than this [rad or m].
LONGEST, SAME = 0.5, 0.05
# Most ways that are given: a seventh joint makes them endless.
MOST = 16


def reach_pose(
    arm: ArmModel, pose: Pose, frame: str, start: Float[Array, " n"], lower: Float[Array, " n"], upper: Array
) -> tuple[list[Array], int, tuple[float, float]]:
    """Every joint position that brings a frame to a pose, by damped Gauss-Newton steps from many places.

    Args:
        arm: The arm.
        pose: Where the frame is to be.
        frame: The frame's name.
        start: Where the arm stands; joints that turn all round are brought as near to it as their limits allow.
        lower, upper: Position limits.

    Returns:
        Joint positions, the nearest to the start first; how many more there are beyond the position limits; and how
        near the frame comes where no way leads there, place [m] and turn [rad].
    """
    rng = np.random.default_rng(0)  # fixed: which ways there are must not depend on the run's seed
    low, high = np.maximum(lower, start - np.pi), np.minimum(upper, start + np.pi)
    wide = low >= high
    low, high = np.where(wide, lower, low), np.where(wide, upper, high)
    solver = PoseSolver(arm, frame)
    found: list[Array] = []
    outside: list[Array] = []
    nearest = (np.inf, np.inf)
    for k in range(STARTS):
        q, missed = solver.descend(pose, start if k == 0 else rng.uniform(low, high))
        if max(missed) > THERE:
            nearest = min(nearest, missed, key=lambda pair: pair[0] + 0.2 * pair[1])
            continue
        q = solver.unwind(q, start, lower, upper)
        kept = found if np.all(q >= lower) and np.all(q <= upper) else outside
        if not any(np.abs(q - other).max() < SAME for other in kept):
            kept.append(q)
    found.sort(key=lambda q: float(np.abs(q - start).max()))
    return [freeze(q) for q in found[:MOST]], len(outside), nearest


class PoseSolver:
    """Brings one frame, known by its name, to places and poses."""

    def __init__(self, arm: ArmModel, frame: str) -> None:
        self._model, self._data = arm.model, arm.model.createData()
        self._frame = max(k for k, one in enumerate(arm.model.frames) if one.name == frame)

    def place(self, q: Float[Array, " n"]) -> Float[Array, " 3"]:
        """The frame's place at a joint position [m]."""
        pin.framesForwardKinematics(self._model, self._data, np.asarray(q, dtype=float))
        return np.array(self._data.oMf[self._frame].translation)

    def descend(self, pose: Pose, q: Float[Array, " n"]) -> tuple[Array, tuple[float, float]]:
        """Where the steps from a position lead, and what is missed there: place [m] and turn [rad]."""
        q, damping = np.array(q), DAMPING
        missed, jacobian = self._look(pose, q)
        for _ in range(STEPS):
            size = float(np.abs(missed).max())
            if size < 0.1 * THERE:
                break
            normal = jacobian.T @ jacobian
            step = -np.linalg.solve(normal + damping * np.eye(len(q)), jacobian.T @ missed)
            step *= min(1.0, LONGEST / max(float(np.abs(step).max()), 1e-12))
            tried, slope = self._look(pose, q + step)
            if tried @ tried < missed @ missed:
                q, missed, jacobian, damping = q + step, tried, slope, max(0.1 * damping, 1e-12)
            else:
                damping *= 10.0
                if damping > 1e6:
                    break
        turn = 0.0 if len(missed) == 3 else float(np.linalg.norm(missed[3:]))
        return q, (float(np.linalg.norm(missed[:3])), turn)

    def unwind(self, q: Array, start: Array, lower: Array, upper: Array) -> Float[Array, " n"]:
        """The same position with every turning joint as near to the start as its limits allow."""
        out = q.copy()
        for j in range(len(q)):
            if not self._model.joints[j + 1].shortname().startswith("JointModelR"):
                continue
            near = q[j] + 2.0 * np.pi * np.round((start[j] - q[j]) / (2.0 * np.pi))
            turns = near + 2.0 * np.pi * np.array([0.0, -1.0, 1.0])
            inside = [turn for turn in turns if lower[j] <= turn <= upper[j]]
            out[j] = min(inside, key=lambda turn: abs(turn - start[j])) if inside else near
        return out

    def _look(self, pose: Pose, q: Array) -> tuple[Array, Array]:
        """What is missed, place and turn, and its derivative."""
        jacobian = pin.computeFrameJacobian(
            self._model, self._data, q, self._frame, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        )
        pin.updateFramePlacement(self._model, self._data, self._frame)
        at = self._data.oMf[self._frame]
        away = at.translation - pose.place
        if pose.rotation is None:
            return away, jacobian[:3]
        rest = at.rotation @ pose.rotation.T
        slope = np.concatenate([jacobian[:3], pin.Jlog3(rest) @ rest.T @ jacobian[3:]])
        return np.concatenate([away, pin.log3(rest)]), slope
