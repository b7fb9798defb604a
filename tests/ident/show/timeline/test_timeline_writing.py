"""The timeline, read back: what was written is what the models and recordings say."""

from __future__ import annotations

import subprocess
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rerun.chunk import RrdReader
from scipy.spatial.transform import Rotation

from ident.arrays import Array
from ident.errors import InputError
from ident.model.evaluation import trace_run
from ident.model.hybrid import HybridModel
from ident.model.loss import LossParameters
from ident.motion.motion import Motion
from ident.recordings.recording import TelemetryIssue
from ident.robot.arm import ArmModel
from ident.show.timeline import Curve, Mark, show_timeline, write_timeline
from ident.show.timeline.writing import PAUSE, arm_reach, link_boxes, run_starts
from tests.ident.made_up import made_motions

MARK = Mark(1, 1.0, 2.0, "joint_2", "slow reversal")
ISSUE = TelemetryIssue("jitter", ("joint_1",), "warning", "2 % of the interval", "none")


class Saved:
    """A saved timeline: static components and columns over time, entity by entity."""

    def __init__(self, path: Path) -> None:
        self.static: dict[str, dict[str, list[Any]]] = {}
        self.columns: dict[str, dict[str, list[Any]]] = {}
        for chunk in RrdReader(path).stream().to_chunks():
            into = self.static if chunk.is_static else self.columns
            table = into.setdefault(chunk.entity_path, {})
            for name, values in chunk.to_record_batch().to_pydict().items():
                table.setdefault(name, []).extend(values)

    def curve(self, path: str) -> tuple[Array, Array]:
        """Times [s] and values, breaks between the runs left out."""
        table = self.columns[path]
        time = np.array([t.total_seconds() for t in table["time"]])
        values = np.array([cell[0] for cell in table["Scalars:scalars"]])
        order = np.argsort(time, kind="stable")
        there = np.isfinite(values[order])
        return time[order][there], values[order][there]


@pytest.fixture(scope="module")
def arm() -> ArmModel:
    return ArmModel.load("tm5-900", joints=["joint_1", "joint_2", "joint_3"])


@pytest.fixture(scope="module")
def motions(arm: ArmModel) -> list[Motion]:
    return made_motions(arm, lambda q, dq, ddq: arm.inverse_dynamics(q, dq, ddq) + 5.0 * np.sign(dq), (1, 2), 3.0)


@pytest.fixture(scope="module")
def model(arm: ArmModel) -> HybridModel:
    zero = np.zeros(3)
    return HybridModel(arm, arm, arm, LossParameters(zero, zero, np.full(3, 4.0), zero, np.full(3, 0.01)))


@pytest.fixture(scope="module")
def saved(arm: ArmModel, motions: list[Motion], model: HybridModel, tmp_path_factory: pytest.TempPathFactory) -> Saved:
    path = tmp_path_factory.mktemp("timeline") / "t.rrd"
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # Rerun warns where it drops what it can't read
        assert write_timeline(path, arm, motions, model, [ISSUE], [MARK]) == path
    return Saved(path)


@pytest.mark.parametrize("rung", ["analytic", "loss"])
def test_torque_and_residual_are_those_of_the_model(
    saved: Saved, motions: list[Motion], model: HybridModel, rung: str
) -> None:
    """Curves hold the filtered torque of each rung and what it leaves, run after run, to the last bit."""
    traces = [trace_run(model, motion) for motion in motions]
    for j, joint in enumerate(model.joint_names):
        torque = np.concatenate([trace.filtered[rung][:, j] for trace in traces])
        measured = np.concatenate([trace.motion.tau_filtered[:, j] for trace in traces])
        np.testing.assert_array_equal(saved.curve(f"/joints/{joint}/torque/{rung}")[1], torque)
        np.testing.assert_array_equal(saved.curve(f"/joints/{joint}/torque/measured")[1], measured)
        np.testing.assert_array_equal(saved.curve(f"/joints/{joint}/residual/{rung}")[1], measured - torque)


def test_energy_ends_at_the_energy_error(saved: Saved, motions: list[Motion], model: HybridModel) -> None:
    """Modelled less measured work at the end of the last run is the evaluation's energy error."""
    trace = trace_run(model, motions[-1])
    step = trace.motion.lowpass.factor
    last = (len(trace.motion.time) - 1) // step * step
    power = (trace.rungs["loss"] - trace.motion.tau) * trace.motion.dq
    exact = np.trapezoid(power[: last + 1], dx=trace.motion.interval, axis=0)
    for j, joint in enumerate(model.joint_names):
        modelled, measured = (saved.curve(f"/joints/{joint}/energy/{name}")[1][-1] for name in ("loss", "measured"))
        assert modelled - measured == pytest.approx(exact[j], abs=1e-9)


def test_runs_lie_end_to_end(saved: Saved, motions: list[Motion]) -> None:
    """Each run starts a pause after the one before it; between them the line is broken."""
    starts = run_starts(motions)
    assert starts[1] == pytest.approx(motions[0].time[-1] - motions[0].time[0] + PAUSE)
    time, position = saved.curve("/joints/joint_1/motion/position")
    coarse = motions[0].time[motions[0].coarse]
    expected = np.concatenate([coarse - coarse[0] + start for start in starts])
    np.testing.assert_allclose(time, expected, atol=2e-9)
    np.testing.assert_array_equal(position, np.concatenate([m.q[m.coarse, 0] for m in motions]))
    values = [cell[0] for cell in saved.columns["/joints/joint_1/motion/position"]["Scalars:scalars"]]
    assert np.isnan(values).sum() == len(motions)


def test_boxes_move_with_the_arm(saved: Saved, arm: ArmModel, motions: list[Motion]) -> None:
    """Every link's pose over time is forward kinematics', and its boxes are those of the URDF."""
    boxes = link_boxes(arm)
    assert len(boxes) == 7
    for link, box in boxes.items():
        table = saved.columns[f"/arm/{link}"]
        first = arm.forward_kinematics(motions[0].q[0])[link]
        np.testing.assert_allclose(table["Transform3D:translation"][0][0], first[:3, 3], atol=1e-6)
        turned = Rotation.from_quat(table["Transform3D:quaternion"][0][0]).as_matrix()
        np.testing.assert_allclose(turned, first[:3, :3], atol=1e-6)
        np.testing.assert_allclose(saved.static[f"/arm/{link}"]["Boxes3D:half_sizes"][0], box["half_sizes"], atol=1e-7)


def test_boxes_lie_where_the_collision_geometry_does(arm: ArmModel) -> None:
    """Link pose times box pose is where Pinocchio puts the collision object, in any posture."""
    q = np.array([0.4, -0.7, 1.1])
    poses = arm.forward_kinematics(q)
    for (link, box), body in zip(link_boxes(arm).items(), arm.geometry.geometryObjects, strict=True):
        frame = arm.model.frames[body.parentFrame]
        of_joint = poses[link] @ np.linalg.inv(frame.placement.homogeneous)
        corner = of_joint @ body.placement.homogeneous @ np.array([*body.geometry.halfSide, 1.0])
        shown = Rotation.from_quat(box["quaternions"][0]).apply(box["half_sizes"][0]) + box["centers"][0]
        np.testing.assert_allclose((poses[link] @ [*shown, 1.0])[:3], corner[:3], atol=1e-9)


def test_reach_bounds_every_posture(arm: ArmModel, motions: list[Motion]) -> None:
    """No link's origin is ever further from the base than the reach."""
    poses = [arm.forward_kinematics(q) for q in motions[0].q[::20]]
    furthest = max(np.linalg.norm(pose[:3, 3]) for frames in poses for pose in frames.values())
    assert 0.5 < furthest <= arm_reach(arm) < 3.0


def test_marks_show_on_the_residual(saved: Saved, motions: list[Motion]) -> None:
    """A mark repeats the last rung's residual within its stretch of its run, and only there."""
    start = run_starts(motions)[MARK.run]
    time, values = saved.curve("/joints/joint_2/residual/mark")
    whole, residual = saved.curve("/joints/joint_2/residual/loss")
    inside = (whole >= start + MARK.start_s - 1e-9) & (whole <= start + MARK.end_s + 1e-9)
    np.testing.assert_allclose(time, whole[inside])
    np.testing.assert_array_equal(values, residual[inside])
    assert "/joints/joint_1/residual/mark" not in saved.columns


def test_log_tells_runs_issues_and_marks(saved: Saved, motions: list[Motion]) -> None:
    """The text log holds each run at its start, each issue with its severity, each mark at its moment."""
    runs = saved.columns["/log/runs"]
    assert [t.total_seconds() for t in runs["time"]] == pytest.approx(run_starts(motions))
    assert "run_1" in runs["TextLog:text"][0][0]
    issue = saved.columns["/log/telemetry"]
    assert "jitter: 2 % of the interval" in issue["TextLog:text"][0][0]
    assert issue["TextLog:level"][0][0] == "WARN"
    mark = saved.columns["/log/marks"]
    assert mark["time"][0].total_seconds() == pytest.approx(run_starts(motions)[1] + 1.0)
    assert "slow reversal" in mark["TextLog:text"][0][0]


def test_layout_is_saved_with_the_recording(arm: ArmModel, motions: list[Motion], tmp_path: Path) -> None:
    """The file holds one recording and one blueprint, so that the viewer opens it laid out."""
    path = write_timeline(tmp_path / "t.rrd", arm, motions)
    reader = RrdReader(path)
    assert (len(reader.recordings()), len(reader.blueprints())) == (1, 1)
    assert [path.name for path in tmp_path.iterdir()] == ["t.rrd"]


def test_without_a_model_only_measured_curves(arm: ArmModel, motions: list[Motion], tmp_path: Path) -> None:
    """No model: torque, power, energy and motion of every joint, no rung; a mark falls on the torque."""
    saved = Saved(write_timeline(tmp_path / "t.rrd", arm, motions, marks=[MARK]))
    groups = {path.split("/")[3] for path in saved.columns if path.startswith("/joints/")}
    names = {path.split("/")[4] for path in saved.columns if path.startswith("/joints/")}
    assert groups == {"torque", "power", "energy", "motion"}
    assert names == {"measured", "position", "velocity", "mark"}
    assert "/joints/joint_2/torque/mark" in saved.columns


def test_further_curves_stand_beside_the_measured(arm: ArmModel, motions: list[Motion], tmp_path: Path) -> None:
    """What a diagnosis leaves is a residual of its run; the last such curve is the one that a mark falls on."""
    lengths = [len(motion.time[motion.coarse]) for motion in motions]
    further = [
        [
            Curve("joint_2", ("residual", name), name, "#d55e00", np.full(length, height))
            for name, height in (("named", 1.0), ("tuned", 2.0))
        ]
        for length in lengths
    ]
    saved = Saved(write_timeline(tmp_path / "t.rrd", arm, motions, marks=[MARK], further=further))
    assert set(saved.curve("/joints/joint_2/residual/named")[1]) == {1.0}
    assert set(saved.curve("/joints/joint_2/residual/mark")[1]) == {2.0}
    assert len(saved.curve("/joints/joint_2/residual/tuned")[1]) == sum(lengths)


def test_model_of_fewer_joints(arm: ArmModel, motions: list[Motion], tmp_path: Path) -> None:
    """A model that speaks of two of three joints adds its rungs to those two."""
    small = arm.locked(["joint_3"])
    zero = np.zeros(2)
    model = HybridModel(arm, small, small, LossParameters(zero, zero, zero, zero, zero))
    saved = Saved(write_timeline(tmp_path / "t.rrd", arm, motions, model))
    assert "/joints/joint_2/torque/analytic" in saved.columns
    assert "/joints/joint_3/torque/analytic" not in saved.columns
    assert "/joints/joint_3/torque/measured" in saved.columns


def test_meshes_are_shown_by_the_boxes_around_them() -> None:
    """The Panda's meshes become boxes of an arm's size."""
    boxes = link_boxes(ArmModel.load("panda"))
    assert {"panda_link0", "panda_link7"} <= boxes.keys()
    largest = max(float(box["half_sizes"].max()) for box in boxes.values())
    assert 0.05 < largest < 0.4


def test_viewer_that_fails_is_told(arm: ArmModel, motions: list[Motion], monkeypatch: pytest.MonkeyPatch) -> None:
    """The viewer is started for a whole file, listening on this machine only; where it fails, the remedy is --rrd."""
    commands: list[list[str]] = []

    def no_screen(command: list[str], check: bool) -> subprocess.CompletedProcess[bytes]:
        commands.append(command)
        assert Path(command[-1]).stat().st_size > 0
        return subprocess.CompletedProcess(command, 1)

    monkeypatch.setattr(subprocess, "run", no_screen)
    with pytest.raises(InputError, match="--rrd"):
        show_timeline(arm, motions)
    assert commands[0][commands[0].index("--bind") + 1] == "127.0.0.1"
