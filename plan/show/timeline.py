"""A plan as a Rerun recording: the arm's boxes, the obstacles, torques and clearance over time."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import rerun as rr

from ident.files import atomic_write
from plan.geometry.solids import Box
from plan.problem.problem import PlanningProblem
from plan.problem.result import PlanResult

FRAMES = 120
LINK = (11, 110, 153)
GHOST = (154, 165, 177)
OBSTACLE = (179, 38, 30)


def save_timeline(problem: PlanningProblem, result: PlanResult, path: str | Path) -> None:
    """Writes a `.rrd` file.

    The planned motion with its curves, and the initial one beside it as a ghost.

    Links' boxes are static shapes under moving frames; a frame is logged only where it is needed.
    """
    assert result.splines is not None
    stream = rr.RecordingStream("armgap plan")
    arm = problem.scene.arm
    boxes = problem.scene.boxes
    joints = sorted({box.joint for box in boxes if box.body >= 0})
    data = arm.model.createData()
    with atomic_write(path) as temporary:
        stream.save(str(temporary))
        stream.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        for box in problem.scene.obstacles:
            _log_box(stream, f"world/obstacles/{box.name}", box, OBSTACLE)
        before = problem.decode(problem.initial)
        for splines, root, colour in (
            (result.splines, "world/arm", LINK),
            (before, "world/initial", GHOST),
        ):
            for i, box in enumerate(box for box in boxes if box.body >= 0):
                _log_box(stream, f"{root}/joint_{box.joint}/{i}_{box.name}", box, colour)
            times = np.linspace(0.0, float(splines.total[0]), FRAMES)
            q, dq, ddq = splines.at(times)
            for time, pose in zip(times, q, strict=True):
                stream.set_time("motion", duration=float(time))
                pin.forwardKinematics(arm.model, data, pose)
                for joint in joints:
                    place = data.oMi[joint]
                    moved = rr.Transform3D(translation=place.translation, mat3x3=place.rotation)
                    stream.log(f"{root}/joint_{joint}", moved)
            if splines is before:
                continue
            tau = problem.model.torque(q[None], dq[None], ddq[None])[0]
            gaps = problem.scene.separation(q)
            for i, time in enumerate(times):
                stream.set_time("motion", duration=float(time))
                for j, name in enumerate(arm.joint_names):
                    stream.log(f"torque_Nm/{name}", rr.Scalars(float(tau[i, j])))
                    stream.log(f"power_W/{name}", rr.Scalars(float(tau[i, j] * dq[i, j])))
                stream.log("clearance_m", rr.Scalars(float(gaps[i])))
        stream.flush()
        stream.disconnect()


def _log_box(stream: rr.RecordingStream, path: str, box: Box, colour: tuple[int, int, int]) -> None:
    quaternion = pin.Quaternion(np.array(box.rotation)).coeffs()
    shape = rr.Boxes3D(
        half_sizes=[box.half],
        centers=[box.centre],
        quaternions=[rr.Quaternion(xyzw=quaternion)],
        colors=[colour],
    )
    stream.log(path, shape, static=True)
