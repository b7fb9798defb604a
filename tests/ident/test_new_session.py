"""A foreign table becomes a session: what `ident new` writes opens, and says what the table truly holds."""

import re
import tomllib
from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin
from typer.testing import CliRunner

from ident.api.daily import new
from ident.api.inspecting import inspect
from ident.cli.app import app
from ident.errors import InputError
from ident.infer.gains import common_scale, shown_unit, without_outliers
from ident.recordings.load import load_session
from ident.recordings.recording import Payload, Recording
from ident.robot.arm import ArmModel
from tests.ident.foreign import lerobot, write_states
from tests.ident.made_up import Law, made_session, sliding_arm
from tests.schemas import check_file

VISCOUS, COULOMB = 8.0, 5.0


def driven(arm: ArmModel) -> Law:
    """Rigid, with friction."""
    return lambda q, dq, ddq: arm.inverse_dynamics(q, dq, ddq) + VISCOUS * dq + COULOMB * np.tanh(dq / 0.01)


@pytest.fixture(scope="module")
def run(arm: ArmModel) -> Recording:
    """Twenty seconds of the TM5-900 with friction, and its measured velocity."""

    one = made_session(arm, driven(arm), [3], duration=20.0).runs[0]
    noise = np.random.default_rng(1)
    speed = np.gradient(one.position, one.time, axis=0)
    torque = one.effort + 0.2 * noise.standard_normal(one.effort.shape)
    return one.replace(velocity=speed + 1e-3 * noise.standard_normal(speed.shape), effort=torque)


def text_table(path: Path, names: list[str], table: np.ndarray, separator: str = ",") -> Path:
    rows = [separator.join(f"{cell:.9g}" for cell in row) for row in table]
    path.write_text("\n".join([separator.join(names), *rows] if names else rows) + "\n")
    return path


def assert_same(folder: Path, run: Recording, velocity: bool = True) -> None:
    """The session opens, passes the telemetry check, and holds the run in SI units."""
    read = load_session(folder).runs[0]
    np.testing.assert_allclose(read.time - read.time[0], run.time - run.time[0], atol=1e-6)
    np.testing.assert_allclose(read.position, run.position, atol=1e-6)
    np.testing.assert_allclose(read.effort, run.effort, rtol=1e-5, atol=1e-5)
    assert (read.velocity is not None) == velocity


def test_an_rtde_log_is_told_by_its_names(run: Recording, tmp_path: Path) -> None:
    """Commands beside measurements, torque with the other sign on one joint: each finds its place.

    Source of the names: Universal Robots' RTDE guide; separated by blanks, as its example recorder writes.
    """
    turned = run.effort.copy()
    turned[:, 1] *= -1
    kinds = ("target_q", "actual_q", "actual_qd", "actual_current_as_torque")
    names = ["timestamp", *(f"{kind}_{i}" for kind in kinds for i in range(6))]
    table = np.column_stack([run.time, run.position + 0.01, run.position, run.velocity, turned])
    text_table(tmp_path / "run.csv", names, table, " ")
    found = new(tmp_path, "tm5-900")
    assert found.settings["effort_sign"] == {"joint_2": -1}
    assert found.columns["target_q_0"] == "joint_1/position_command"
    assert_same(tmp_path, run)
    assert inspect(tmp_path).is_fit  # the robot is named in the file


def test_a_libfranka_log_is_in_milliseconds(run: Recording, tmp_path: Path) -> None:
    """Names that stand twice (`q_d[0]` of state and command) are no names; time counts milliseconds.

    Source of the names: libfranka, log.cpp.
    """
    names = ["duration", " success rate"]
    names += [f" {kind}[{i}]" for kind in ("q", "q_d", "dq", "tau_J", "tau_ext_hat_filtered", "q_d") for i in range(6)]
    zero, measured = np.zeros_like(run.position), (run.position, run.position, run.velocity, run.effort)
    table = np.column_stack([8000 + 1e3 * run.time, np.ones(len(run)), *measured, zero, zero])
    text_table(tmp_path / "run.csv", names, table)
    found = new(tmp_path, "tm5-900")
    assert found.settings["time_unit"] == "ms"
    assert found.columns["tau_J[0]"] == "joint_1/effort"
    assert_same(tmp_path, run)


def test_degrees_are_told_by_the_robots_limits(run: Recording, arm: ArmModel, tmp_path: Path) -> None:
    """Velocity in another unit than position is left out, and that is reported."""
    wide = run.replace(position=run.position * 2.0, velocity=None)
    names = ["t", *(f"q{i}" for i in range(1, 7)), *(f"dq{i}" for i in range(1, 7)), *(f"tau{i}" for i in range(1, 7))]
    values = [wide.time, np.degrees(wide.position), np.gradient(wide.position, wide.time, axis=0), wide.effort]
    text_table(tmp_path / "run.csv", names, np.column_stack(values))
    found = new(tmp_path, "tm5-900")
    assert found.settings["angle_unit"] == "deg"
    assert any("0.0175" in line for line in found.left_out)
    assert_same(tmp_path, wide, velocity=False)
    # An arm that, read in degrees, would stand nearly still moved in radians: its URDF's limits are too narrow.
    narrow = re.sub(r'(lower|upper)="[^"]*"', lambda one: f'{one[1]}="{-0.1 if one[1] == "lower" else 0.1}"', arm.urdf)
    (tmp_path / "narrow.urdf").write_text(narrow, encoding="utf-8")
    text_table(tmp_path / "log.csv", [*names[:7], *names[13:]], np.column_stack([run.time, run.position, run.effort]))
    found = new(tmp_path / "log.csv", tmp_path / "narrow.urdf")
    assert found.settings.get("angle_unit", "rad") == "rad"
    assert "URDF's limits" in found.summary()


def test_columns_without_names_are_told_by_their_numbers(run: Recording, arm: ArmModel, tmp_path: Path) -> None:
    """Time, then a command, position, velocity, a rigid model's torque and a current: the measured ones are taken."""
    rigid = arm.inverse_dynamics(run.position, np.zeros_like(run.position), np.zeros_like(run.position))
    motion = (run.position, np.gradient(run.position, run.time, axis=0), run.position, run.velocity)
    text_table(tmp_path / "run.csv", [], np.column_stack([run.time, *motion, rigid, run.effort / 10.0]))
    found = new(tmp_path, arm)
    assert found.columns.items() >= {"1": "time", "20": "joint_1/velocity", "32": "joint_1/current"}.items()
    assert found.settings["drive_gain_Nm_per_A"]["joint_2"] == pytest.approx(10.0, rel=0.05)  # gravity moves it
    assert found.report.is_fit


def test_without_time_the_rate_is_told_by_the_velocity(run: Recording, tmp_path: Path) -> None:
    """Arrays of an archive: the model shows which is which; a velocity beside its acceleration is no position."""
    tables = (run.position, speed := np.gradient(run.position, run.time, axis=0), np.gradient(speed, run.time, axis=0))
    np.savez(tmp_path / "run.npz", *tables, run.effort)  # type: ignore[arg-type]
    found = new(tmp_path / "run.npz", "tm5-900")
    assert found.file == tmp_path / "run.toml"
    assert found.settings["sample_rate_hz"] == pytest.approx(125.0, rel=0.01)
    np.testing.assert_allclose(load_session(tmp_path / "run.npz").runs[0].effort, run.effort)


def test_without_time_and_velocity_the_rate_is_asked_for(run: Recording, tmp_path: Path) -> None:
    """Law: what nothing tells is asked for by the option that answers it, and then it is believed."""
    names = [*(f"q{i}" for i in range(6)), *(f"tau{i}" for i in range(6))]
    text_table(tmp_path / "run.csv", names, np.column_stack([run.position, run.effort]))
    with pytest.raises(InputError, match="--rate"):
        new(tmp_path, "tm5-900")
    found = new(tmp_path, "tm5-900", rate=125.0)
    assert found.settings["sample_rate_hz"] == 125.0
    np.testing.assert_allclose(load_session(tmp_path).runs[0].time[:2], [0.0, 0.008])
    with pytest.raises(InputError, match="no rate"):
        new(tmp_path, "tm5-900", rate=0.0)


def test_an_angle_that_rises_all_the_time_is_no_clock(run: Recording, tmp_path: Path) -> None:
    """Law: a column whose name speaks of a channel is none of time, however evenly it rises."""
    position = np.array(run.position)
    position[:, 2] = np.linspace(-1.0, 1.0, len(position))
    names = [f"{channel}_{j}" for channel in ("pos", "vel", "torque") for j in range(1, 7)]
    path = text_table(tmp_path / "log.csv", names, np.hstack([position, run.velocity, run.effort]))
    found = new(path, "tm5-900", rate=125.0)
    assert found.settings["sample_rate_hz"] == 125.0
    np.testing.assert_allclose(load_session(path).runs[0].position, position, atol=1e-5)


def test_a_cell_beyond_any_torque_is_told_and_left_out(run: Recording, tmp_path: Path) -> None:
    """Law: one cell of 1e300 stops no guess."""
    effort = np.array(run.effort)
    effort[60, 2] = 1e300
    names = ["time", *(f"{channel}_{j}" for channel in ("pos", "vel", "torque") for j in range(1, 7))]
    table = np.hstack([run.time[:, None], run.position, run.velocity, effort])
    found = new(text_table(tmp_path / "log.csv", names, table), "tm5-900")
    assert any(issue.issue == "garbage_cells" for issue in found.report.issues)


def test_a_gain_unlike_its_neighbours_is_no_guess() -> None:
    """Law: one that is fifteen times off the others is left out; of gains that merely differ none is."""
    like = {"a": 0.1, "b": 0.12, "c": 0.09, "d": 0.14}
    even = dict.fromkeys("abcde", 1.0)
    assert without_outliers(like, even) == (like, {})
    assert without_outliers({**like, "e": 1.5}, even) == (like, {"e": 1.5})
    assert without_outliers({**like, "e": 1.5}, {**even, "e": 9.0}) == (like, {"e": 1.5})  # alone, however heavy
    two = {"a": 0.1, "b": 1.5}
    assert without_outliers(two, even) == (two, {})  # two say nothing of each other


def test_gains_of_a_heavy_base_stand_though_wrists_have_others() -> None:
    """Law: two that agree and bear most of the weight are no outliers; two that bear little are."""
    arm = {"a": 0.135, "b": 0.121, "c": 0.28, "d": 0.303, "e": 0.294}
    heavy = {"a": 10.0, "b": 12.0, "c": 4.0, "d": 4.0, "e": 0.5}
    assert without_outliers(arm, heavy) == (arm, {})
    kept, unlike = without_outliers(arm, dict.fromkeys("abcde", 1.0))
    assert (set(kept), set(unlike)) == (set("cde"), set("ab"))


def test_the_common_scale_is_that_of_what_weighs_most() -> None:
    """Law: light wrists outvote no shoulder; of joints alike in weight it is the median."""
    assert common_scale({}, {}) == 1.0
    assert common_scale({"a": 1.1, "b": 10.0, "c": 12.0}, {"a": 40.0, "b": 0.3, "c": 0.2}) == 1.1
    assert common_scale({"a": 0.1, "b": 0.12, "c": 5.0}, {"a": 1.0, "b": 1.0, "c": 1.0}) == 0.12


def test_a_torque_stays_one_though_the_wrist_carries_what_the_urdf_lacks(arm: ArmModel, tmp_path: Path) -> None:
    """A body of 3 kg turns the wrists' torque into several times the URDF's: no reason to call it a current."""
    carrying = arm.with_payload(Payload(3.0, (0.08, 0.0, 0.1)))
    run = made_session(arm, driven(carrying), [3], duration=20.0).runs[0]
    names = ["stamp", *(f"q{i}" for i in range(1, 7)), *(f"trq{i}" for i in range(1, 7))]
    text_table(tmp_path / "run.csv", names, np.column_stack([run.time, run.position, run.effort]))
    found = new(tmp_path, "tm5-900")
    assert "drive_gain_Nm_per_A" not in found.settings
    assert found.columns["trq2"] == "joint_2/effort"


def test_a_corrected_guess_and_a_users_file_stay(run: Recording, tmp_path: Path) -> None:
    """What armgap guessed may be guessed again; a line that a person changed, or a file of theirs, is theirs."""
    names = ["t", *(f"q{i}" for i in range(6)), *(f"tau{i}" for i in range(6))]
    text_table(tmp_path / "run.csv", names, np.column_stack([run.time, run.position, run.effort]))
    first = (place := new(tmp_path, "tm5-900").file).read_text()
    assert new(tmp_path, "tm5-900").text == first
    place.write_text(first.replace('"joint_1/position"', '"joint_9/position"'))
    with pytest.raises(InputError, match="was corrected"):
        new(tmp_path, "tm5-900")
    place.write_text('robot = "tm5-900"\n')
    with pytest.raises(InputError, match="did not write"):
        new(tmp_path, "tm5-900")
    assert place.read_text() == 'robot = "tm5-900"\n'


def test_channels_in_files_of_their_own_are_told_so(run: Recording, arm: ArmModel, tmp_path: Path) -> None:
    """Position in one file and torque in another are no table: the user's own file is named, and what to do."""
    (session := tmp_path / "session").mkdir()
    files = [text_table(session / f"{name}.txt", [], getattr(run, name)) for name in ("position", "effort")]
    with pytest.raises(
        InputError, match=r"columns of numbers: 6; .* of 6 joints are 18; put them side by side"
    ) as caught:
        new(session, arm)
    assert caught.value.where in [str(one) for one in files]
    assert not (session / "session.toml").exists()


def test_positions_alone_are_refused(run: Recording, tmp_path: Path) -> None:
    """A session needs torque, current or goals: nothing is written where there is none."""
    names = ["timestamp", *(f"observation.state.joint_{i}.pos" for i in range(1, 7))]
    text_table(tmp_path / "run.csv", names, np.column_stack([run.time, run.position]))
    with pytest.raises(InputError, match="torque or current"):
        new(tmp_path, "tm5-900")
    assert [path.name for path in tmp_path.iterdir()] == ["run.csv"]


def test_goals_without_torque_are_told_for_ident_servo(run: Recording, tmp_path: Path) -> None:
    """LeRobot's names, ISO times, counts of an encoder about the middle of a turn: the session is the log in SI."""
    names = ["timestamp", *(f"{one}.joint_{i}.pos" for one in ("observation.state", "action") for i in range(1, 7))]
    counts = np.round(np.tile(run.position, 2) * 4096 / (2 * np.pi)) + 2048
    stamps = np.datetime64("2026-05-03T14:00:00") + (1e9 * run.time).astype("m8[ns]")
    rows = [",".join(map(str, (t, *row))) for t, row in zip(stamps, counts, strict=True)]
    (tmp_path / "run.csv").write_text("\n".join([",".join(names), *rows]) + "\n")
    assert not new(tmp_path, "tm5-900").has_effort
    (read,) = load_session(tmp_path, with_effort=False).runs
    np.testing.assert_allclose(read.time - read.time[0], run.time - run.time[0], atol=2e-6)
    np.testing.assert_allclose([read.position, read.position_command], [run.position] * 2, atol=np.pi / 4096)


def test_the_command_writes_its_guess_beside_the_tables(run: Recording, tmp_path: Path) -> None:
    """`ident new SESSION`: the record says what was guessed and why."""
    names = ["t", *(f'q"{i}' for i in range(6)), *(f"tau_{i}" for i in range(6))]
    (session := tmp_path / "session").mkdir()
    text_table(session / "log.csv", names, np.column_stack([run.time, run.position, run.effort]))
    record = tmp_path / "new.json"
    done = CliRunner().invoke(app, ["new", str(session), "--robot", "tm5-900", "--json", str(record)])
    assert done.exit_code == 0, done.output
    assert sorted(path.name for path in session.iterdir()) == ["log.csv", "session.toml"]
    assert tomllib.loads((session / "session.toml").read_text())["robot"] == "tm5-900"
    assert {one["what"] for one in check_file(record)["reasons"]} >= {"time", "position", "effort", "joints"}


def test_a_data_set_and_a_bag_are_told_by_their_names(run: Recording, tmp_path: Path) -> None:
    """LeRobot's features without joints' names, and the fields of a driver's own message."""
    columns = {"observation.state": run.position, "action": run.position, "observation.effort": run.effort}
    folder = lerobot(tmp_path / "set", None, {**columns, "timestamp": run.time})
    assert new(folder, "tm5-900").columns["action.5"] == "joint_6/position_command"
    assert_same(folder, run, velocity=False)

    channels = (("q", "position"), ("tau_J", "effort"))
    write_states(tmp_path / "bag", "/arm/states", run, channels, StoragePlugin.MCAP)
    assert new(tmp_path / "bag", "tm5-900").columns["/arm/states:tau_J.0"] == "joint_1/effort"
    assert_same(tmp_path / "bag", run, velocity=False)


def test_a_whole_robots_log_leaves_its_arms_joints(run: Recording, tmp_path: Path) -> None:
    """Law: columns named as the robot's joints are those, whatever else is there and in whichever order."""
    joints = ["a_head", *run.joints, "wheel"]
    names = [f"states:{kind}.{joint}" for kind in ("position", "effort") for joint in joints]
    table = [np.column_stack([run.time, one, run.time]) for one in (run.position, run.effort)]
    text_table(tmp_path / "run.csv", ["time", *names], np.column_stack([run.time, *table]))
    assert new(tmp_path, "tm5-900").columns["states:position.joint_4"] == "joint_4/position"
    assert_same(tmp_path, run, velocity=False)


def test_names_in_another_language_axes_by_letters_slides_in_millimetres(tmp_path: Path) -> None:
    """Law: beside a torque the only others of as many joints are the position, and what rises evenly is time."""
    arm = sliding_arm()
    made = made_session(arm, driven(arm), [3], duration=20.0).runs[0]
    heads = [f"{what}_{axis}" for what in ("Ist", "Moment") for axis in "ABCD"]
    names = [f"{head} {'[mm]' if head[-1] in 'BD' else '[Grad]'}" if head[0] == "I" else head for head in heads]
    scaled = made.position * np.array([np.degrees(1.0), 1e3, np.degrees(1.0), 1e3])
    path = text_table(
        tmp_path / "run.txt", ["Zeit[ms]", *names], np.column_stack([1e3 * made.time, scaled, made.effort]), ";"
    )
    path.write_text(path.read_text().replace(".", ","))
    (tmp_path / "arm.urdf").write_text(arm.urdf, encoding="utf-8")
    found = new(path, tmp_path / "arm.urdf")
    assert found.settings["slide_scale"] == {"slide_2": 1e-3, "slide_4": 1e-3}
    assert_same(path, made, velocity=False)


def test_a_drives_trace_names_the_axis_first(tmp_path: Path) -> None:
    """Law: what stands before a channel's name is its joint, by letter or number, as scopes of drives write."""
    arm = sliding_arm()
    made = made_session(arm, driven(arm), [3], duration=20.0).runs[0]
    heads = [f"{axis}.{what}" for axis in ("A1", "Z", "A2", "W") for what in ("ActPos", "ActTorque")]
    pairs = np.stack([made.position * np.array([1.0, 1e3, 1.0, 1e3]), made.effort], axis=2)
    path = text_table(tmp_path / "run.csv", ["time", *heads], np.column_stack([made.time, pairs.reshape(-1, 8)]))
    (tmp_path / "arm.urdf").write_text(arm.urdf, encoding="utf-8")
    assert "not used" not in new(path, tmp_path / "arm.urdf").summary()
    assert_same(path, made, velocity=False)


def test_words_that_are_glued_a_counter_and_forces_of_slides(tmp_path: Path) -> None:
    """Law: Istwinkel is an angle, a column that counts samples is no clock, a slide's force stands for a torque."""
    arm = sliding_arm()
    made = made_session(arm, driven(arm), [3], duration=20.0).runs[0]
    heads = [f"{what}{i}" for what in ("Istwinkel", "Solldrehmoment") for i in range(1, 5)]
    heads += ["torque 1", "force 2", "torque 3", "force 4"]
    table = np.column_stack([np.arange(len(made.time)), made.time, made.position, 0.9 * made.effort, made.effort])
    path = text_table(tmp_path / "run.csv", ["n", "Zeit", *heads], table)
    (tmp_path / "arm.urdf").write_text(arm.urdf, encoding="utf-8")
    found = new(path, tmp_path / "arm.urdf")
    assert found.columns["Zeit"] == "time"
    assert_same(path, made, velocity=False)


@pytest.mark.parametrize(("goal", "measured"), [("goal_{}", "present_{}"), ("cmd{}", "feedback{}")])
def test_goals_and_what_came_of_them_need_no_word_for_position(
    run: Recording, tmp_path: Path, goal: str, measured: str
) -> None:
    """Law: what is commanded or measured and no other quantity by its name is the position."""
    names = ["t", *(kind.format(i) for kind in (goal, measured) for i in range(6))]
    text_table(tmp_path / "run.csv", names, np.column_stack([run.time, run.position + 0.01, run.position]))
    columns = new(tmp_path, "tm5-900").columns
    assert columns[measured.format(0)] == "joint_1/position"
    assert columns[goal.format(0)] == "joint_1/position_command"


def test_gains_are_found_of_an_arm_on_a_wall(arm: ArmModel, tmp_path: Path) -> None:
    """Law: how an arm hangs is found before its gains, which are gravity over what the columns show of it."""
    wall = arm.with_gravity(np.array([9.81, 0.0, 0.0]))
    made = made_session(wall, driven(wall), [3], duration=20.0).runs[0]
    names = ["time", *(f"{kind}_{i}" for kind in ("q", "current") for i in range(6))]
    text_table(tmp_path / "run.csv", names, np.column_stack([made.time, made.position, made.effort / 12.0]))
    gains = new(tmp_path, "tm5-900").settings["drive_gain_Nm_per_A"]
    assert all(6.0 < gain < 24.0 for gain in gains.values())
    assert gains["joint_2"] == pytest.approx(12.0, rel=0.1)


def test_percent_are_of_the_urdfs_limit(run: Recording, arm: ArmModel, tmp_path: Path) -> None:
    """Law: a torque whose name says percent is no torque in N m; a hundred stand for the limit, marked as a guess."""
    names = ["time", *(f"{kind}_{i}{unit}" for kind, unit in (("q", ""), ("tau", " [%]")) for i in range(6))]
    table = np.column_stack([run.time, run.position, 100.0 * run.effort / arm.effort_limit])
    text_table(tmp_path / "run.csv", names, table)
    new(tmp_path, "tm5-900")
    read = load_session(tmp_path).runs[0]
    np.testing.assert_allclose(read.effort, run.effort, rtol=1e-2, atol=1e-4)


@pytest.mark.parametrize("tip", ["", ":joint_6"])
def test_the_robot_of_a_guess_is_found_from_any_folder(
    tip: str, run: Recording, arm: ArmModel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Law: a path with the last joint of an arm behind it is one, too."""
    folder = tmp_path / "session"
    folder.mkdir()
    names = [f"{joint}/{kind}" for kind in ("position", "effort") for joint in arm.joint_names]
    text_table(folder / "run.csv", ["time", *names], np.column_stack([run.time, run.position, run.effort]))
    (tmp_path / "arm.urdf").write_text(arm.urdf)
    monkeypatch.chdir(tmp_path)
    new("session", f"arm.urdf{tip}")
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    monkeypatch.chdir(elsewhere)
    assert inspect([folder]).reports[0].is_fit


@pytest.mark.parametrize("name", ["present_current_{}_mA", "I {} [mA]", "motor current {} (mA)"])
def test_gains_of_currents_in_milliamperes_are_of_one_ampere(
    name: str, run: Recording, arm: ArmModel, tmp_path: Path
) -> None:
    """Law: what is called N m/A is that, and the current is in A when it is read."""
    gain = np.array([14.0, 13.0, 11.0, 9.0, 9.0, 9.0])
    names = [pattern.format(j + 1) for pattern in ("q{}", name) for j in range(arm.n)]
    table = np.column_stack([run.time, run.position, 1000.0 * run.effort / gain])
    text_table(tmp_path / "run.csv", ["time", *names], table)
    new(tmp_path, arm)
    (read,) = load_session(tmp_path).runs
    np.testing.assert_allclose(read.current, run.effort / gain, rtol=1e-5, atol=1e-6)
    written = tomllib.loads((tmp_path / "session.toml").read_text())
    guessed = written["drive_gain_Nm_per_A"]
    assert written["current_unit"] == "mA"
    assert [guessed[joint] for joint in arm.joint_names[1:3]] == pytest.approx(gain[1:3], rel=0.05)
    (tmp_path / "session.toml").write_text('current_unit = "uA"\n')
    with pytest.raises(InputError, match=r'current_unit = .uA.; write "A" or "mA"'):
        load_session(tmp_path)


@pytest.mark.parametrize(
    ("name", "unit", "factor"),
    [
        ("tau_{}_mNm", "mNm", 1e-3),
        ("Torque {} [N cm]", "Ncm", 1e-2),
        ("effort{} (kgf·cm)", "kgfcm", 0.0980665),
        ("tau_{}_Nm", None, 1.0),
        ("tau{}", "Ncm", 1e-2),
        ("tau{}", "mNm", 1e-3),
    ],
)
def test_torques_in_another_unit_are_torques(
    name: str, unit: str | None, factor: float, run: Recording, arm: ArmModel, tmp_path: Path
) -> None:
    """Law: what a name says, or all joints show, is the unit of an effort; it is no current with a gain for each."""
    names = [pattern.format(j + 1) for pattern in ("q{}", name) for j in range(arm.n)]
    text_table(tmp_path / "run.csv", ["time", *names], np.column_stack([run.time, run.position, run.effort / factor]))
    found = new(tmp_path, arm)
    assert found.settings.get("effort_unit") == unit
    assert "drive_gain_Nm_per_A" not in found.settings
    assert_same(tmp_path, run, velocity=False)


def test_a_unit_is_shown_by_all_joints_alike() -> None:
    """Law: one joint, joints that differ, and gains of 10 N m/A (a kgf m is 9.8 N m) show no unit."""
    assert shown_unit({"a": 100.0}) is None
    assert shown_unit({"a": 100.0, "b": 30.0}) is None
    assert shown_unit({"a": 0.1, "b": 0.102}) is None
    assert shown_unit({"a": 104.0, "b": 97.0}) == "Ncm"


def test_a_clock_that_is_set_on_leaves_gravity_as_it_is(run: Recording, arm: ArmModel, tmp_path: Path) -> None:
    """Law: nothing is derived through a leap of the clock: signs and sizes are those of the pieces."""
    names = [pattern.format(j + 1) for pattern in ("q{}", "current{}") for j in range(arm.n)]
    gains = {}
    for leap in (0.0, 37.2):
        folder = tmp_path / f"leap_{leap}"
        folder.mkdir()
        time = run.time + leap * (np.arange(len(run)) > len(run) // 2)
        text_table(folder / "run.csv", ["time", *names], np.column_stack([time, run.position, run.effort / 9.0]))
        gains[leap] = new(folder, arm).settings["drive_gain_Nm_per_A"]
    for joint in arm.joint_names[1:3]:
        assert gains[37.2][joint] == pytest.approx(gains[0.0][joint], rel=0.05)


@pytest.mark.parametrize("reverse", [False, True])
def test_of_more_joints_those_are_taken_that_move_so(reverse: bool, arm: ArmModel, tmp_path: Path) -> None:
    """Law: columns without names, fewer than the robot's joints, are those that explain the torque, in any order."""
    lower = made_session(arm, driven(arm), [5], duration=20.0).runs[0]
    position = lower.position.copy()
    position[:, 0] = 0.0
    speed = np.gradient(position, lower.time, axis=0)
    torque = driven(arm)(position, speed, np.gradient(speed, lower.time, axis=0))
    order = range(arm.n - 1, 0, -1) if reverse else range(1, arm.n)
    names = [f"{kind}{place}" for kind in ("q", "tau") for place in range(arm.n - 1)]
    table = np.column_stack([lower.time, position[:, list(order)], torque[:, list(order)]])
    text_table(tmp_path / "run.csv", ["time", *names], table)
    found = new(tmp_path, arm)
    assert [found.columns[f"q{place}"] for place in range(arm.n - 1)] == [
        f"{arm.joint_names[j]}/position" for j in order
    ]
    assert sum(reason.what == "joints" for reason in found.reasons) == 1


def test_a_second_arm_in_the_table_is_mentioned(run: Recording, tmp_path: Path) -> None:
    """Law: of two arms in one table one is taken, and it says where the other is."""
    names = ["time", *(f"{side}_{kind}{i}" for side in ("left", "right") for kind in ("q", "tau") for i in range(6))]
    half = np.column_stack([run.position, run.effort])
    text_table(tmp_path / "run.csv", names, np.column_stack([run.time, half, half]))
    said = new(tmp_path, "tm5-900").summary()
    assert "right_q…" in said


@pytest.mark.parametrize("zero", [0, 2048])
def test_a_servos_counts_are_told_by_limits_in_degrees_and_read_from_their_own_zero(
    zero: int, run: Recording, tmp_path: Path
) -> None:
    """Law: whole numbers beyond what the robot's limits are in degrees are counts; below zero they have a zero of 0."""
    text = Path("urdf/tm5_900.urdf").read_text()
    limits = r'lower="[^"]*" upper="[^"]*"'
    short = re.sub(limits, 'lower="-1.9" upper="1.9"', text)
    (tmp_path / "short.urdf").write_text(short)
    counts = np.round(0.5 * run.position * 4096 / (2 * np.pi)) + zero
    assert np.abs(counts).max() < 1080 or zero
    names = ["time", *(f"ID{k}_PresentPosition" for k in range(1, 7)), *(f"ID{k}_Torque" for k in range(1, 7))]
    session = tmp_path / "session"
    session.mkdir()
    text_table(session / "run.csv", names, np.column_stack([run.time, counts, run.effort]))
    found = new(session, str(tmp_path / "short.urdf"))
    assert found.settings["counts_per_turn"] == 4096
    read = load_session(session).runs[0]
    np.testing.assert_allclose(read.position, 0.5 * run.position, atol=np.pi / 4096 + 1e-5)
