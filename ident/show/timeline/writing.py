"""Writes the timeline as a Rerun recording, or opens it in the viewer."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from scipy.spatial.transform import Rotation

from ident.arrays import Array, Float
from ident.errors import InputError, RobotError
from ident.files import atomic_write
from ident.model.hybrid import HybridModel
from ident.motion.motion import Motion
from ident.recordings.recording import TelemetryIssue
from ident.robot.arm import ArmModel
from ident.show.timeline.series import Curve, Mark, marked, run_curves

TIMELINE = "time"
FOUND = "/found"
# Runs lie end to end with this pause [s]: the clocks of sessions overlap, and a page can't be in
# two places.
PAUSE = 1.0
# The arm is drawn this often; the curves keep every sample [1/s].
ARM_RATE = 25.0
LEVELS = {"fatal": "CRITICAL", "warning": "WARN", "note": "INFO"}


def require_screen() -> None:
    """Looks for a display server where windows need one, before recordings are read.

    Raises:
        InputError: Linux, and neither X11's nor Wayland's display is named in the environment.
    """
    if sys.platform.startswith("linux") and not (
        os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    ):
        raise InputError(
            "viewer",
            "there is no screen here",
            "save the timeline with --rrd FILE, open it elsewhere",
        )


def make_blueprint(
    joints: Sequence[str], with_model: bool, reach: float, with_words: bool = False
) -> rrb.Blueprint:
    """The layout; the camera stands as far off as the arm reaches [m], which is 0 where there are
    no boxes to show.
    """
    groups = [("torque", "torque [N m]")]
    if with_model:
        groups += [
            ("residual", "residual: measured − modelled [N m]"),
            ("energy", "energy since the run's start [J]"),
        ]
    groups += [("power", "power [W]"), ("motion", "position and velocity")]
    shares = [3] + [2] * (len(groups) - 1)
    tabs = []
    for joint in joints:
        rows = [_series(joint, key, name) for key, name in groups]
        tabs.append(rrb.Vertical(*rows, row_shares=shares, name=joint))
    what = "residual" if with_model else "torque"
    overview = rrb.Grid(
        *[_series(joint, what, joint) for joint in joints],
        grid_columns=2,
        name=f"all joints: {what}",
    )
    series = rrb.Tabs(overview, *tabs, active_tab=0)
    left: list[rrb.View] = [rrb.TextLogView(origin="/log", name="runs, telemetry, marks")]
    if with_words:
        left.insert(0, rrb.TextDocumentView(origin=FOUND, name="what was found"))
    if reach > 0:  # the arm from the side and a little above, whole in any posture
        eye = rrb.EyeControls3D(
            position=[1.5 * reach, -1.5 * reach, reach],
            look_target=[0.0, 0.0, 0.3 * reach],
            eye_up=[0.0, 0.0, 1.0],
        )
        left.insert(0, rrb.Spatial3DView(origin="/arm", name="arm", eye_controls=eye))
    left_side = rrb.Vertical(*left, row_shares=[3, 2, 2][: len(left)])
    return rrb.Blueprint(
        rrb.Horizontal(left_side, series, column_shares=[2, 5]),
        rrb.TimePanel(timeline=TIMELINE, state="collapsed", play_state="paused"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.BlueprintPanel(state="collapsed"),
        auto_views=False,
    )


def _series(joint: str, key: str, name: str) -> rrb.TimeSeriesView:
    return rrb.TimeSeriesView(
        origin=str(entity(joint, key)),
        name=name,
        plot_legend=rrb.PlotLegend(visible=True, corner=rrb.Corner2D.RightTop),
    )


def entity(joint: str, *parts: str) -> str:
    """Path of a joint's series."""
    return "/joints/" + "/".join(rr.escape_entity_path_part(name) for name in (joint, *parts))


def link_boxes(arm: ArmModel) -> dict[str, dict[str, Any]]:
    """Bounding boxes of the collision geometry, by link and in its frame.

    None where its meshes are not there.

    Boxes are shown as they are; cylinders, spheres and meshes by the box around them.
    """
    try:
        objects = arm.geometry.geometryObjects
    except RobotError:
        return {}
    boxes_of_link: dict[str, list[tuple[np.ndarray, np.ndarray]]] = {}
    for body in objects:
        frame = arm.model.frames[body.parentFrame]
        body.geometry.computeLocalAABB()
        box = body.geometry.aabb_local
        # Placements are given from the joint, poses are known of the link.
        pose = np.linalg.inv(frame.placement.homogeneous) @ body.placement.homogeneous
        centre = (box.min_ + box.max_) / 2
        half = (box.max_ - box.min_) / 2
        pose[:3, 3] += pose[:3, :3] @ centre
        boxes_of_link.setdefault(frame.name, []).append((pose, half))
    return {link: _as_columns(boxes) for link, boxes in boxes_of_link.items()}


def _as_columns(boxes: Sequence[tuple[np.ndarray, np.ndarray]]) -> dict[str, Any]:
    """Poses and half sizes of some boxes, as Rerun takes them."""
    poses = np.array([pose for pose, _ in boxes])
    return {
        "centers": poses[:, :3, 3],
        "half_sizes": np.array([half for _, half in boxes]),
        "quaternions": Rotation.from_matrix(poses[:, :3, :3]).as_quat(),
    }


def arm_reach(arm: ArmModel) -> float:
    """Length of the chain of link frames [m]: the arm stays within this distance of its base."""
    poses = list(arm.forward_kinematics(arm.neutral).values())
    places = np.array([pose[:3, 3] for pose in poses])
    return float(np.linalg.norm(np.diff(places, axis=0), axis=1).sum())


Rows = dict[tuple[str, tuple[str, str]], list[tuple[Array, Curve]]]


def write_timeline(
    path: str | Path,
    arm: ArmModel,
    motions: Sequence[Motion],
    model: HybridModel | None = None,
    issues: Sequence[TelemetryIssue] = (),
    marks: Sequence[Mark] = (),
    further: Sequence[Sequence[Curve]] = (),
    words: str = "",
) -> Path:
    """Writes the timeline to a `.rrd` file, whole or not at all.

    Args:
        path: The file.
        arm: The robot, for its boxes.
        motions: Runs, laid end to end on the time axis with a pause of a second.
        model: Model whose rungs are compared; measured curves only if None.
        issues: What the telemetry check found.
        marks: Moments to point at.
        further: Curves of each run beside its own, such as what a diagnosis leaves.
        words: What was found, such as a diagnosis's summary.

    Raises:
        InputError: The folder can't be written to.
    """
    target = Path(path)
    with atomic_write(target) as temporary:
        name = f"{len(motions)}-runs-{motions[0].name}-{motions[-1].name}"
        recording = rr.RecordingStream("armgap", recording_id=name)
        joints = motions[0].joints
        reach = arm_reach(arm) if link_boxes(arm) else 0.0
        layout = make_blueprint(joints, model is not None or bool(further), reach, bool(words))
        recording.save(temporary, default_blueprint=layout)
        starts = run_starts(motions)
        rows: Rows = defaultdict(list)
        for k, (motion, start) in enumerate(zip(motions, starts, strict=True)):
            time = motion.time[motion.coarse] - motion.time[0]
            curves = [*run_curves(motion, model), *(further[k] if further else ())]
            curves += _marked_curves(curves, time, [mark for mark in marks if mark.run == k])
            for curve in curves:
                rows[curve.joint, curve.path].append((time + start, curve))
        for (joint, path_of), pieces in rows.items():
            _send_curve(recording, entity(joint, *path_of), pieces)
        _send_arm(recording, arm, motions, starts)
        _send_log(recording, motions, starts, issues, marks)
        if words:
            recording.log(FOUND, rr.TextDocument(words), static=True)
        recording.flush()
        recording.disconnect()
    return target


def show_timeline(
    arm: ArmModel,
    motions: Sequence[Motion],
    model: HybridModel | None = None,
    issues: Sequence[TelemetryIssue] = (),
) -> None:
    """Opens the timeline in Rerun's viewer, and returns when its window is closed.

    The viewer listens on this machine only. Arguments as `write_timeline`.

    Raises:
        InputError: The viewer can't be opened, for lack of a screen, say.
    """
    with tempfile.TemporaryDirectory() as folder:
        file = write_timeline(Path(folder) / "timeline.rrd", arm, motions, model, issues)
        command = [sys.executable, "-m", "rerun_cli", "--bind", "127.0.0.1", str(file)]
        if subprocess.run(command, check=False).returncode != 0:
            raise InputError(
                "viewer",
                "Rerun's window can't be opened",
                "save the timeline with --rrd FILE instead",
            )


def run_starts(motions: Sequence[Motion]) -> list[float]:
    """Start of each run on the timeline [s]."""
    durations = [motion.time[-1] - motion.time[0] for motion in motions]
    ends = np.cumsum([duration + PAUSE for duration in durations])
    return [0.0, *ends[:-1].tolist()]


def _marked_curves(
    curves: Sequence[Curve], time: Float[Array, " t"], marks: Sequence[Mark]
) -> list[Curve]:
    """The marked parts of each joint's last residual, or of its torque where there is no model."""
    marked_curves = []
    for mark in marks:
        of_joint = [curve for curve in curves if curve.joint == mark.joint]
        groups = {curve.path[0] for curve in of_joint}
        group = "residual" if "residual" in groups else "torque"
        of_group = [curve for curve in of_joint if curve.path[0] == group]
        if of_group:
            marked_curves.append(marked(of_group[-1], time, mark.start_s, mark.end_s))
    merged: dict[tuple[str, tuple[str, str]], Curve] = {}
    for curve in marked_curves:
        before = merged.get((curve.joint, curve.path), curve)
        values = np.where(np.isnan(before.values), curve.values, before.values)
        merged[curve.joint, curve.path] = replace(curve, values=values)
    return list(merged.values())


def _send_curve(
    recording: rr.RecordingStream, path: str, pieces: Sequence[tuple[Array, Curve]]
) -> None:
    """One entity's curve over all runs.

    Between runs stands one value that is not a number, which breaks the line.
    """
    times: list[Array] = []
    values: list[Array] = []
    for time, curve in pieces:
        times += [time, time[-1:] + PAUSE / 2]
        values += [curve.values, np.array([np.nan])]
    first = pieces[0][1]
    colour = [int(first.colour[k : k + 2], 16) for k in (1, 3, 5)]
    style = rr.SeriesLines(
        colors=colour, names=first.label, widths=2.5 if first.path[1] == "mark" else 1.2
    )
    recording.log(path, style, static=True)
    index = rr.TimeColumn(TIMELINE, duration=np.concatenate(times))
    recording.send_columns(path, [index], rr.Scalars.columns(scalars=np.concatenate(values)))


def _send_arm(
    recording: rr.RecordingStream, arm: ArmModel, motions: Sequence[Motion], starts: Sequence[float]
) -> None:
    """Boxes fixed to their links, and the links' poses over all runs."""
    boxes = link_boxes(arm)
    if not boxes:
        return
    recording.log("/arm", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    times = []
    positions = []
    for motion, start in zip(motions, starts, strict=True):
        step = slice(None, None, max(1, round(motion.lowpass.rate / ARM_RATE)))
        times.append(motion.time[step] - motion.time[0] + start)
        positions.append(motion.select(arm.joint_names).q[step])
    poses = arm.link_poses(np.concatenate(positions), tuple(boxes))
    index = rr.TimeColumn(TIMELINE, duration=np.concatenate(times))
    for k, (link, box) in enumerate(boxes.items()):
        path = f"/arm/{rr.escape_entity_path_part(link)}"
        shade = 90 + 110 * k // len(boxes)
        recording.log(
            path, rr.Boxes3D(**box, colors=[shade, shade + 20, 235], fill_mode="solid"), static=True
        )
        turn, place = poses[link]
        columns = rr.Transform3D.columns(
            translation=place, quaternion=Rotation.from_matrix(turn).as_quat()
        )
        recording.send_columns(path, [index], columns)


def _send_log(
    recording: rr.RecordingStream,
    motions: Sequence[Motion],
    starts: Sequence[float],
    issues: Sequence[TelemetryIssue],
    marks: Sequence[Mark],
) -> None:
    """Runs at their starts, telemetry issues at the beginning, marks at their moments."""
    from_issues = []
    for issue in issues:
        text = f"{issue.issue}: {issue.evidence}; {issue.remedy}"
        from_issues.append((0.0, text, LEVELS[issue.severity]))
    from_runs = []
    for motion, start in zip(motions, starts, strict=True):
        payload = f", {1000 * motion.payload.mass_kg:.0f} g at the flange" if motion.payload else ""
        duration = motion.time[-1] - motion.time[0]
        from_runs.append((start, f"run {motion.name}: {duration:.2f} s{payload}", "INFO"))
    from_marks = []
    for mark in marks:
        duration = mark.end_s - mark.start_s
        text = f"{mark.joint}, {duration:.2f} s: {mark.text}"
        from_marks.append((starts[mark.run] + mark.start_s, text, "WARN"))
    entries = {"telemetry": from_issues, "runs": from_runs, "marks": from_marks}
    for name, lines in entries.items():
        if lines:
            times, texts, levels = zip(*lines, strict=True)
            index = rr.TimeColumn(TIMELINE, duration=np.array(times))
            columns = rr.TextLog.columns(text=texts, level=levels)
            recording.send_columns(f"/log/{name}", [index], columns)
