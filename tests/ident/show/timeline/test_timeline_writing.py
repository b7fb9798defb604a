"""The timeline, read back: what was written is what the models and recordings say."""

import subprocess
import warnings
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ident.errors import InputError
from ident.model.evaluation import trace_run
from ident.model.hybrid import HybridModel
from ident.model.loss import LossParameters
from ident.motion.motion import Motion
from ident.recordings.recording import TelemetryIssue
from ident.robot.arm import ArmModel
from ident.show.timeline.series import Mark
from ident.show.timeline.writing import link_boxes, run_starts, show_timeline, write_timeline
from tests.ident.made_up import made_motions
from tests.ident.show.timeline.saved import Saved

MARK = Mark(1, 1.0, 2.0, "joint_2", "slow reversal")
ISSUE = TelemetryIssue("jitter", ("joint_1",), "warning", "2 % of the interval", "none")


@pytest.fixture(scope="module")
def motions(three_joints: ArmModel) -> list[Motion]:
    return made_motions(
        three_joints, lambda q, dq, ddq: three_joints.inverse_dynamics(q, dq, ddq) + 5.0 * np.sign(dq), (1, 2), 3.0
    )


@pytest.fixture(scope="module")
def model(three_joints: ArmModel) -> HybridModel:
    zero = np.zeros(3)
    return HybridModel(
        three_joints, three_joints, three_joints, LossParameters(zero, zero, np.full(3, 4.0), zero, np.full(3, 0.01))
    )


@pytest.fixture(scope="module")
def saved(
    three_joints: ArmModel, motions: list[Motion], model: HybridModel, tmp_path_factory: pytest.TempPathFactory
) -> Saved:
    path = tmp_path_factory.mktemp("timeline") / "t.rrd"
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # Rerun warns where it drops what it can't read
        assert write_timeline(path, three_joints, motions, model, [ISSUE], [MARK]) == path
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


def test_boxes_move_with_the_arm(saved: Saved, three_joints: ArmModel, motions: list[Motion]) -> None:
    """Every link's pose over time is forward kinematics', and its boxes are those of the URDF."""
    boxes = link_boxes(three_joints)
    assert len(boxes) == 7
    for link, box in boxes.items():
        table = saved.columns[f"/arm/{link}"]
        first = three_joints.forward_kinematics(motions[0].q[0])[link]
        np.testing.assert_allclose(table["Transform3D:translation"][0][0], first[:3, 3], atol=1e-6)
        turned = Rotation.from_quat(table["Transform3D:quaternion"][0][0]).as_matrix()
        np.testing.assert_allclose(turned, first[:3, :3], atol=1e-6)
        np.testing.assert_allclose(saved.static[f"/arm/{link}"]["Boxes3D:half_sizes"][0], box["half_sizes"], atol=1e-7)


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


def test_without_a_model_only_measured_curves(three_joints: ArmModel, motions: list[Motion], tmp_path: Path) -> None:
    """No model: torque, power, energy and motion of every joint, no rung; a mark falls on the torque."""
    saved = Saved(write_timeline(tmp_path / "t.rrd", three_joints, motions, marks=[MARK]))
    groups = {path.split("/")[3] for path in saved.columns if path.startswith("/joints/")}
    names = {path.split("/")[4] for path in saved.columns if path.startswith("/joints/")}
    assert groups == {"torque", "power", "energy", "motion"}
    assert names == {"measured", "position", "velocity", "mark"}
    assert "/joints/joint_2/torque/mark" in saved.columns


def test_model_of_fewer_joints(three_joints: ArmModel, motions: list[Motion], tmp_path: Path) -> None:
    """A model that speaks of two of three joints adds its rungs to those two."""
    small = three_joints.locked(["joint_3"])
    zero = np.zeros(2)
    model = HybridModel(three_joints, small, small, LossParameters(zero, zero, zero, zero, zero))
    saved = Saved(write_timeline(tmp_path / "t.rrd", three_joints, motions, model))
    assert "/joints/joint_2/torque/analytic" in saved.columns
    assert "/joints/joint_3/torque/analytic" not in saved.columns
    assert "/joints/joint_3/torque/measured" in saved.columns


def test_viewer_that_fails_is_told(
    three_joints: ArmModel, motions: list[Motion], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The viewer is started for a whole file, listening on this machine only; where it fails, the remedy is --rrd."""
    commands: list[list[str]] = []

    def no_screen(command: list[str], check: bool) -> subprocess.CompletedProcess[bytes]:
        commands.append(command)
        assert Path(command[-1]).stat().st_size > 0
        return subprocess.CompletedProcess(command, 1)

    monkeypatch.setattr(subprocess, "run", no_screen)
    with pytest.raises(InputError, match="--rrd"):
        show_timeline(three_joints, motions)
    assert commands[0][commands[0].index("--bind") + 1] == "127.0.0.1"


def test_boxes_lie_where_the_collision_geometry_does(three_joints: ArmModel) -> None:
    """Link pose times box pose is where Pinocchio puts the collision object, in any posture."""
    q = np.array([0.4, -0.7, 1.1])
    poses = three_joints.forward_kinematics(q)
    for (link, box), body in zip(link_boxes(three_joints).items(), three_joints.geometry.geometryObjects, strict=True):
        frame = three_joints.model.frames[body.parentFrame]
        of_joint = poses[link] @ np.linalg.inv(frame.placement.homogeneous)
        corner = of_joint @ body.placement.homogeneous @ np.array([*body.geometry.halfSide, 1.0])
        shown = Rotation.from_quat(box["quaternions"][0]).apply(box["half_sizes"][0]) + box["centers"][0]
        np.testing.assert_allclose((poses[link] @ [*shown, 1.0])[:3], corner[:3], atol=1e-9)
