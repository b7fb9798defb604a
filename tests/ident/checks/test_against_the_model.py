"""Laws of a recording held against its robot: mount, order of columns, size and kind of torques, unrecorded joints."""

from itertools import product
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ident.api.inspecting import inspect as inspect_files
from ident.checks.arrangement import check_bodies
from ident.checks.conventions.reread import read_conventions
from ident.checks.effort import collect_states
from ident.checks.effort_kind import fit_scale
from ident.checks.inspection import inspect_alone as found
from ident.checks.inspection import inspect_sessions
from ident.checks.report import REPORTED_BY_A_FIT, TelemetryReport, overrule
from ident.command_options import FitOptions
from ident.errors import RecordingError
from ident.fitting.fit import fit_hybrid
from ident.model.hybrid import HybridModel
from ident.recordings.load import load_session
from ident.recordings.recording import Recording, Session, TelemetryIssue
from ident.recordings.save import write_session
from ident.robot.arm import ArmModel
from ident.robot.chain import compute_joint_poses
from ident.robot.names import data_path
from ident.sessions import open_sessions
from tests.ident.checks.faults import inspect, spoil, spoil_column, without_velocity
from tests.ident.made_up import joint, link, made_session, urdf

GRAVITY = np.array([0.0, 0.0, -9.81])
REAL = {
    "rokae": ("rokae_ar5", "rokae_ar5/robot.urdf"),
    "airbot": ("airbot_play", "airbot_play/robot.urdf"),
    "dual arm": ("dual_arm_v2", "dual_arm_v2/robot.urdf"),
    "panda": ("panda/unisa_fer/panda_exciting_trajectory.db3", "panda"),
    "ur10": ("ur10_cb/ur10_exciting_trajectory.db3", "ur10"),
}


@pytest.fixture(scope="module")
def session() -> Session:
    return load_session(data_path("logs/tm5_900/E1"))


def changed(session: Session, channel: str, change: object) -> Session:
    """A session whose one channel is worked on, columns by joint."""
    assert callable(change)
    return session.replace(runs=[run.replace(**{channel: change(getattr(run, channel))}) for run in session.runs])


def mounted(session: Session, arm: ArmModel) -> tuple[ArmModel, list[TelemetryIssue]]:
    """The arm as the search finds it mounted, and what is told of that."""
    reading = read_conventions(session, arm)
    return reading.arm, [issue for issue in reading.issues if issue.issue == "mounting"]


def angle_between(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.degrees(np.arccos(one @ other / np.linalg.norm(one) / np.linalg.norm(other))))


def require_mounts(session: Session, arm: ArmModel) -> None:
    """Thirty orientations of the base, by chance: gravity is found within 3°, and nothing is refused for it."""
    as_it_is = found(session, arm)
    assert not as_it_is.find("mounting")
    for turn in Rotation.random(30, random_state=np.random.RandomState(7)):
        report = found(session, arm.with_gravity(turn.apply(GRAVITY)))
        # A mount is proposed, and nothing else is refused for it.
        assert {issue.issue for issue in report.fatal} <= {issue.issue for issue in as_it_is.fatal} | {"mounting"}
        # A tilt below 20° as it is measured is for a diagnosis to find.
        assert report.find("mounting") or angle_between(turn.apply(GRAVITY), GRAVITY) < 23.0
        for issue in report.find("mounting"):
            assert angle_between(np.array(report.session.gravity), GRAVITY) < 3.0
            assert "gravity_mps2 = [" in issue.remedy


@pytest.mark.parametrize("axis", ["x", "y"])
@pytest.mark.parametrize("degrees", [6.0, 14.0, 24.0, 80.0])
def test_no_turn_of_the_base_is_refused_as_anything_else(
    degrees: float, axis: str, session: Session, arm: ArmModel
) -> None:
    """Joint 1 of an upright arm then has a gravity torque in the model, and none in its recording."""
    report = found(session, arm.with_gravity(Rotation.from_euler(axis, degrees, degrees=True).apply(GRAVITY)))
    assert {issue.issue for issue in report.fatal} <= ({"mounting"} if degrees > 20.0 else set())


def test_a_mount_is_read_from_joints_that_move(session: Session, arm: ArmModel) -> None:
    """Friction holds a joint that stands still: whichever torque it shows there turns no base."""
    run = session.runs[0]
    still = run.replace(name="still", position=run.position[::-1], velocity=np.zeros_like(run.position))
    held = np.arange(len(run)) // 200 * 200
    still = still.replace(position=still.position[held], effort=run.effort[held] + 15.0 * np.sign(run.position[held]))
    turned, issues = mounted(session.replace(runs=[*session.runs, still]), arm.with_gravity([9.81, 0.0, 0.0]))
    assert issues
    assert angle_between(np.array(turned.model.gravity.linear), GRAVITY) < 3.0


def test_a_rotor_bends_no_scale() -> None:
    """Law: what a motor feels of its own rotor is no part of the links' torque, and moves neither scale nor mount."""
    arm = ArmModel.load("tm5-900")
    rotors = 2.0 * arm.mean_inertia(np.random.default_rng(2).uniform(-1.5, 1.5, (50, 6)))
    law = lambda q, dq, ddq: arm.inverse_dynamics(q, dq, ddq) + rotors * ddq + 2.0 * np.tanh(dq / 0.01)  # noqa: E731
    made = made_session(arm, law, [3, 4], duration=20.0)
    states = collect_states(made, arm)
    heavy = map(int, np.flatnonzero(states.heavy))
    assert [fit_scale(states, joint)[0] for joint in heavy] == pytest.approx([1.0] * int(states.heavy.sum()), abs=0.03)
    turned, _ = mounted(made, arm.with_gravity(np.array([9.81, 0.0, 0.0])))
    assert angle_between(np.array(turned.model.gravity.linear), GRAVITY) < 1.0


def test_a_planar_arm_with_a_spring_stands_as_it_stands() -> None:
    """Law: gravity out of a planar arm's plane only scales its torque, and none is turned that has its own size."""
    places = zip("ab", ("base", "upper"), ("upper", "fore"), strict=True)
    joints = [joint(*place, axis="0 1 0", turn="0 0 0") for place in places]
    links = [link("base"), link("upper", 3.4, "0.16 0.01 0", 0.04), link("fore", 1.9, "0.13 0 0")]
    arm = ArmModel.from_urdf(urdf(*links, *joints))
    spring = np.array([0.3, 0.0])
    law = lambda q, dq, ddq: arm.inverse_dynamics(q, dq, ddq) + spring * q + 0.8 * np.tanh(dq / 0.01)  # noqa: E731
    made = made_session(arm, law, [3, 4], duration=20.0)
    assert not mounted(made, arm)[1]
    turned, issues = mounted(made, arm.with_gravity([9.81, 0.0, 0.0]))
    assert issues
    along, across, down = turned.model.gravity.linear
    assert angle_between(np.array([along, 0.0, down]), GRAVITY) < 3.0
    assert abs(across) < 0.25 * abs(down)  # 14 degrees out of the plane are 3 % of the torque


def test_stated_gravity_stands(session: Session, arm: ArmModel) -> None:
    """Law: gravity that session.toml states is used, and doubted where the torque follows another."""
    report = found(session.replace(gravity=(9.81, 0.0, 0.0)), arm)
    assert report.session.gravity == (9.81, 0.0, 0.0)
    (issue,) = report.find("mounting")
    assert "session.toml's is used" in issue.evidence
    assert not found(session.replace(gravity=(0.0, 0.0, -9.81)), arm).find("mounting")


@pytest.mark.real
@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=pytest.mark.xfail(reason="one of thirty turns is read as gravity that is compensated"))
        if name == "dual arm"
        else name
        for name in REAL
    ],
)
def test_gravity_is_found_however_a_real_base_is_mounted(name: str, real_data: Path) -> None:
    recording, robot = REAL[name]
    arm = ArmModel.load(real_data / robot if "/" in robot else robot)
    require_mounts(load_session(real_data / recording), arm)


@pytest.mark.real
@pytest.mark.parametrize("towards", [20.0, 140.0, 260.0])
@pytest.mark.parametrize("degrees", [12.0, 18.0, 26.0])
def test_a_likelier_mount_spares_a_torque(degrees: float, towards: float, real_data: Path) -> None:
    """Law: joint 1 of an upright arm shows none of the gravity torque that a tilt would give it; not
    the torque, but the tilt is wrong, however little it gains at the other joints.
    """
    recording, robot = REAL["ur10"]
    axis = Rotation.from_euler("z", towards, degrees=True).apply([1.0, 0.0, 0.0])
    tilt = Rotation.from_rotvec(np.radians(degrees) * axis)
    arm = ArmModel.load(robot).with_gravity(tilt.apply(GRAVITY))
    report = found(load_session(real_data / recording), arm)
    assert {issue.issue for issue in report.fatal} <= {"mounting"}


@pytest.mark.real
@pytest.mark.parametrize("name", ["panda", "rokae", "ur10"])
def test_a_wrong_gain_of_a_real_joint_that_feels_gravity_is_said_first(name: str, real_data: Path) -> None:
    """And as large as it is, beside what the arm's URDF makes of the untouched log."""
    recording, robot = REAL[name]
    arm = ArmModel.load(real_data / robot if "/" in robot else robot)
    session = found(load_session(real_data / recording), arm).session
    states = collect_states(session, arm.keeping(session.joints))
    judged = np.flatnonzero(states.heavy & states.alive & states.moving)
    assert len(judged) > 1
    for at, factor in product(judged, (0.5, 0.7, 1.5)):
        own, error, _ = fit_scale(states, at)
        gains = np.where(np.arange(len(session.joints)) == at, factor, 1.0)
        (issue,) = found(changed(session, "effort", gains.__mul__), arm).find("torque_scale")
        assert issue.joints[0] == session.joints[at]
        seen = float(issue.evidence.split(" reads ")[1].split()[0])
        assert seen == pytest.approx(factor * own, abs=2.0 * factor * error + 0.01)


def test_a_model_of_an_arm_on_a_wall_keeps_its_gravity(session: Session, arm: ArmModel, tmp_path: Path) -> None:
    """session.toml's gravity, or the one that was found, goes with the session, the model, and what it is tested on."""
    write_session(session.replace(gravity=(0.0, 0.0, -9.81)), tmp_path / "session")
    again = load_session(tmp_path / "session")
    assert again.gravity == (0.0, 0.0, -9.81)
    opened = open_sessions(again, arm.with_gravity([9.81, 0.0, 0.0]))
    np.testing.assert_allclose(opened.arm.model.gravity.linear, GRAVITY)
    with pytest.raises(RecordingError, match="gravity_mps2"):
        open_sessions(session, arm.with_gravity([9.81, 0.0, 0.0]))
    wall = open_sessions(session, arm.with_gravity([9.81, 0.0, 0.0]), accept=["mounting"])
    model = fit_hybrid(wall.motions, wall.arm, FitOptions(links=6, inertia="nominal", net="none"), []).model
    model.save(tmp_path / "model")
    loaded = HybridModel.load(tmp_path / "model")
    np.testing.assert_allclose(loaded.arm.model.gravity.linear, wall.arm.model.gravity.linear)
    assert angle_between(np.array(wall.arm.model.gravity.linear), GRAVITY) < 3.0


@pytest.mark.parametrize("channels", [("effort",), ("position", "velocity")])
@pytest.mark.parametrize("pair", [(1, 2), (4, 5), (0, 3)])
def test_columns_under_another_joints_name_are_found(
    pair: tuple[int, int], channels: tuple[str, ...], session: Session, arm: ArmModel
) -> None:
    order, swapped = np.arange(6), session
    order[list(pair)] = pair[::-1]
    for channel in channels:
        swapped = changed(swapped, channel, lambda values: values[:, order])
    (issue,) = found(swapped, arm).find("columns_swapped")
    assert issue.severity == "fatal"
    assert set(issue.joints) == {session.joints[j] for j in pair}


@pytest.mark.parametrize("joint", [1, 2])
@pytest.mark.parametrize("factor", [0.5, 0.9, 1.12])
def test_a_wrong_gain_is_said_first_and_never_fit_for_use(
    joint: int, factor: float, session: Session, arm: ArmModel
) -> None:
    """Law: the reported scale follows the planted factor to 1e-9, wherever it is; the interval is of its size."""
    gains = np.where(np.arange(6) == joint, factor, 1.0)
    report = found(changed(session, "effort", lambda effort: effort * gains), arm)
    assert session.joints[joint] in report.issues[0].joints
    assert report.verdict == "to be used with care: torque_scale"
    pair = [collect_states(one.session, arm) for one in (found(session, arm), report)]
    (before, *_), (after, error, _) = (fit_scale(states, joint) for states in pair)
    assert after == pytest.approx(factor * before, rel=1e-6)
    assert abs(after - factor) < max(0.08 * factor, 3.0 * error)
    assert f"is {after:.2f} ± {2.0 * error:.2f} times" in report.effort[joint].evidence


@pytest.mark.parametrize("stiffness", [-60.0, -25.0, 40.0, 120.0, 300.0])
def test_a_spring_is_no_wrong_gain_and_no_wrong_sign(stiffness: float, session: Session, arm: ArmModel) -> None:
    """What a spring beside gravity explains is not reported as gravity's size, nor as its sign where it is stronger."""
    springs = np.diag(stiffness * (np.arange(6) == 1))
    sprung = session.replace(runs=[run.replace(effort=run.effort + run.position @ springs) for run in session.runs])
    assert not found(sprung, arm).find("torque_scale") + found(sprung, arm).find("effort_sign_flipped")


@pytest.mark.parametrize("factor", [1e3, 1e9])
def test_effort_beyond_any_rating_is_refused_with_the_factor(factor: float, session: Session, arm: ArmModel) -> None:
    loud = changed(session, "effort", lambda values: values * np.array([1, 1, 1, 1, 1, factor]))
    (issue,) = found(loud, arm).find("effort_not_torque")
    assert issue.joints == ("joint_6",)
    assert "times the 43 N m that it is rated for" in issue.evidence


def test_one_joints_columns_alone_while_others_moved_are_refused(session: Session, arm: ArmModel) -> None:
    seen, *_ = found(session.replace(runs=[run.select(["joint_3"]) for run in session.runs]), arm).find("joints_locked")
    assert seen.severity == "fatal"
    assert "may have moved" in seen.evidence


def test_a_joint_that_is_not_recorded_and_stood_still_is_not_suspected(session: Session, arm: ArmModel) -> None:
    """Law: gravity and inertia of joints that move together are the model's, no sum of single angles' waves."""
    still, rng = arm.locked(["joint_6"]), np.random.default_rng(3)

    def bent(run: Recording) -> Recording:
        """The run's path with elbow and wrist bending wide, under the model's torque with the last joint still."""
        waves = np.sin(run.time[:, None] * rng.uniform(0.7, 2.3, 5) + rng.uniform(0.0, 6.0, 5))
        q = np.array([1.5, 1.2, 1.5, 1.4, 1.2]) * waves
        dq = np.gradient(q, run.time, axis=0)
        effort = still.inverse_dynamics(q, dq, np.gradient(dq, run.time, axis=0))
        return run.select(arm.joint_names[:5]).replace(position=q, velocity=dq, effort=effort)

    seen = found(session.replace(runs=[bent(run) for run in session.runs]), arm).find("joints_locked")
    assert [one.severity for one in seen] == ["note"]


def test_guessed_gains_are_told_and_make_no_recording_fit_without_a_word(
    session: Session, arm: ArmModel, tmp_path: Path
) -> None:
    """session.toml marks them; two sessions of one arm with different guesses are told so."""
    gains = dict.fromkeys(session.joints, 10.0)
    lines = "".join(f"{joint} = 10.0\n" for joint in session.joints)
    write_session(session, tmp_path / "session")
    (tmp_path / "session/session.toml").write_text(f"[drive_gain_Nm_per_A]\n{lines}guessed = true\n")
    marked = load_session(tmp_path / "session")
    assert marked.guessed_gains == gains
    report = found(marked, arm)
    assert report.find("guessed_gains")[0].joints == session.joints
    assert report.verdict == "to be used with care: guessed_gains"
    other = marked.replace(guessed_gains={**gains, "joint_2": 12.0}, name="other")
    first, _ = inspect_sessions([marked, other], arm)
    assert any("other" in issue.evidence and "joint_2" in issue.joints for issue in first.find("guessed_gains"))


def test_another_guess_of_a_gain_is_no_change_of_the_arm(session: Session, arm: ArmModel) -> None:
    """Law: the same currents are the same torques, whatever a later session's gains were guessed to be."""
    guesses = [np.full(len(session.joints), 10.0), np.linspace(8.0, 13.0, len(session.joints))]
    marked = [
        spoil(
            session, lambda run, gains=gains: run.replace(current=run.effort / 10.0, effort=gains / 10.0 * run.effort)
        ).replace(guessed_gains=dict(zip(session.joints, gains, strict=True)), name=name)
        for gains, name in zip(guesses, ("before", "after"), strict=True)
    ]
    before, after = (report.session.runs[0].effort for report in inspect_sessions(marked, arm))
    np.testing.assert_allclose(after, before, rtol=1e-12)


def test_an_effort_of_zeros_is_refused(session: Session, arm: ArmModel) -> None:
    assert not inspect_sessions([changed(session, "effort", np.zeros_like)], arm)[0].is_fit


def test_nothing_is_written_where_nothing_is_left(session: Session, arm: ArmModel, tmp_path: Path) -> None:
    run: Recording = session.runs[0]
    empty = run.at(slice(0, 0))
    with pytest.raises(RecordingError, match="nothing that can be used is left"):
        TelemetryReport(session.replace(runs=[run, empty]), (), arm).mend(tmp_path / "mended")
    assert not (tmp_path / "mended").exists()


LOGS = Path(__file__).parents[3] / "logs/tm5_900"


def compensated(session: Session, arm: ArmModel) -> Session:
    """As a driver logs it that takes gravity out."""
    return spoil(session, lambda run: run.replace(effort=run.effort - arm.gravity(run.position)))


@pytest.mark.parametrize("velocity", [True, False])
def test_gravity_that_was_taken_out_is_found_and_put_back(clean: Session, arm: ArmModel, velocity: bool) -> None:
    """Neither another unit nor another time base: the torque comes back to rounding."""
    session = clean if velocity else without_velocity(clean)
    report = inspect(compensated(session, arm), arm)
    assert [(one.issue, one.severity) for one in report.issues] == [("effort_gravity_compensated", "warning")]
    assert {one.kind for one in report.effort} == {"gravity_compensated"}
    for before, after in zip(session.runs, report.session.runs, strict=True):
        np.testing.assert_allclose(after.effort, before.effort, atol=1e-9)


def test_the_payload_is_in_the_gravity_that_is_added() -> None:
    session, arm = load_session(LOGS / "payload_1544g"), ArmModel.load("tm5-900")
    report = inspect(compensated(session, arm.with_payload(session.payload)), arm)
    assert [one.issue for one in report.issues] == ["effort_gravity_compensated"]
    np.testing.assert_allclose(report.session.runs[0].effort, session.runs[0].effort, atol=1e-9)


def test_a_spring_that_carries_the_arm_is_not_gravity_taken_out(clean: Session, arm: ArmModel) -> None:
    """It hides gravity on its own joint; the others show it."""
    sprung = spoil(clean, lambda run: run.replace(effort=run.effort - (np.arange(6) == 1) * arm.gravity(run.position)))
    assert not inspect(sprung, arm).find("effort_gravity_compensated")


def test_an_arm_that_gravity_does_not_load_is_not_judged(clean: Session) -> None:
    """Vertical axes only: nothing tells whether gravity is in the effort, and nothing is said."""
    scara = ArmModel.from_urdf(
        urdf(
            link("base"),
            link("link_1"),
            link("link_2"),
            joint("turn_1", "base", "link_1").replace("0.4 -0.7 1.1", "0 0 1.1"),
            joint("turn_2", "link_1", "link_2").replace("0.4 -0.7 1.1", "0 0 1.1"),
        )
    )

    def turned(run: Recording) -> Recording:
        q, dq = run.position[:, :2], np.asarray(run.velocity)[:, :2]
        ddq = np.gradient(dq, run.time, axis=0)
        noise = 0.02 * np.random.default_rng(1).normal(size=q.shape)
        tau = scara.inverse_dynamics(q, dq, ddq) + 0.5 * np.tanh(dq / 0.01) + 0.8 * dq + noise
        return Recording(run.name, scara.joint_names, run.time, q, tau, velocity=dq)

    session = Session("scara", tuple(turned(run) for run in clean.runs))
    assert np.abs(scara.gravity(session.runs[0].position)).max() < 1e-9
    report = inspect(session, scara)
    assert not report.find("effort_gravity_compensated")
    assert "gravity_compensated" not in {one.kind for one in report.effort}


def test_session_toml_says_so_where_the_motion_cannot(clean: Session, arm: ArmModel, tmp_path: Path) -> None:
    """Added once: the mended session says that gravity is in its effort now."""
    whole, folder = clean.replace(runs=clean.runs[:2]), tmp_path / "said"
    write_session(compensated(whole, arm), folder)
    (folder / "session.toml").write_text('effort_kind = "gravity_compensated"\n')
    report = inspect(load_session(folder), arm)
    (issue,) = report.find("effort_gravity_compensated")
    assert issue.severity == "warning"
    assert "session.toml says" in issue.evidence
    report.mend(tmp_path / "mended")
    again = inspect(load_session(tmp_path / "mended"), arm)
    assert not again.find("effort_gravity_compensated")
    np.testing.assert_allclose(again.session.runs[0].effort, whole.runs[0].effort, atol=1e-9)


def test_session_toml_has_the_last_word_against_a_guess(clean: Session, arm: ArmModel) -> None:
    said = compensated(clean, arm).replace(effort_kind="joint_torque")
    assert not inspect(said, arm).find("effort_gravity_compensated")


def test_gravity_that_is_there_is_not_added_again(clean: Session, arm: ArmModel) -> None:
    report = inspect(clean.replace(effort_kind="gravity_compensated"), arm)
    assert [(one.issue, one.severity) for one in report.issues] == [("effort_gravity_compensated", "fatal")]


def test_an_unknown_kind_is_refused(clean: Session, tmp_path: Path) -> None:
    write_session(clean.replace(runs=clean.runs[:1]), tmp_path / "session")
    (tmp_path / "session/session.toml").write_text('effort_kind = "gravity"\n')
    with pytest.raises(RecordingError, match=r"effort_kind = 'gravity'.*write"):
        load_session(tmp_path / "session")


def frictionless(run: Recording, arm: ArmModel) -> Recording:
    """As a sensor behind the gear has it, with its noise: what a model explains to the last is no measurement."""
    ddq = np.gradient(np.asarray(run.velocity), run.time, axis=0)
    torque = arm.inverse_dynamics(run.position, np.asarray(run.velocity), ddq)
    bearings = 0.04 * torque.std(axis=0) * np.tanh(np.asarray(run.velocity) / 0.01)
    noise = 0.1 * torque.std(axis=0) * np.random.default_rng(0).normal(size=torque.shape)
    return run.replace(effort=torque + bearings + noise)


def at_rest(run: Recording) -> Recording:
    """The last joint stands still."""
    position, velocity = np.array(run.position), np.array(run.velocity)
    position[:, 5], velocity[:, 5] = 0.4, 0.0
    return run.replace(position=position, velocity=velocity)


KINDS = {
    "motor_torque": lambda run, arm: run,
    "joint_torque": frictionless,
    "motor_current": lambda run, arm: run.replace(current=run.effort / 12.0),
    "gravity_compensated": lambda run, arm: run.replace(effort=run.effort - arm.gravity(run.position)),
    "external_torque": lambda run, arm: run.replace(effort=np.random.default_rng(3).normal(size=run.effort.shape)),
    "commanded": lambda run, arm: run.replace(effort_command=run.effort),
    "unknown": lambda run, arm: at_rest(run),
}
# How the summary says them.
KINDS_IN_WORDS = {
    "motor_torque": "the motor's torque, with the gear's friction",
    "joint_torque": "torque at the joint, hardly any friction",
    "motor_current": "the motor's current",
    "gravity_compensated": "torque without gravity",
    "external_torque": "torque from outside: it follows neither gravity nor motion",
    "commanded": "a command",
    "unknown": "unknown",
}


@pytest.mark.parametrize("kind", KINDS)
def test_every_joints_effort_has_a_verdict_with_evidence(
    kind: str, clean: Session, arm: ArmModel, tmp_path: Path
) -> None:
    """Law: `inspect` says of each joint what its effort is, and from which numbers; so do its JSON and its lines."""
    write_session(spoil(clean, lambda run: KINDS[kind](run, arm)), tmp_path / "session")
    found = inspect_files(tmp_path / "session", arm)
    (record,) = found.to_dict()["sessions"]
    seen = {one["joint"]: one for one in record["effort"]}
    assert tuple(seen) == arm.joint_names
    chosen = ("joint_6",) if kind == "unknown" else ("joint_2",) if kind == "external_torque" else arm.joint_names
    lines = " ".join(found.summary().split())
    for name in chosen:
        evidence = seen[name]["evidence"]
        assert seen[name]["kind"] == kind, seen[name]
        assert any(letter.isdigit() for letter in evidence) or kind == "unknown"
        assert f"effort of {name}: {KINDS_IN_WORDS[kind]} ({evidence})" in lines


@pytest.mark.parametrize("robot", ["tm5-900", "panda", "ur10", "z1"])
def test_bodies_in_the_frame_of_the_base_are_refused_as_such(robot: str, session: Session) -> None:
    """A diagnosis refuses such a URDF and blames no torque; a fit, which finds the bodies, goes on."""
    arm = ArmModel.load(robot)
    poses = compute_joint_poses(arm.chain, np.zeros((1, arm.n)), range(1, arm.n + 1))
    links = np.array(arm.inertial_parameters.reshape(arm.n, 10))
    links[:, 1:4] += links[:, :1] * np.concatenate([place for _, place in poses.values()])
    assert not check_bodies(session, arm)
    assert len(check_bodies(session, arm.with_inertial_parameters(links.ravel()))[0].joints) > 1
    if robot == "tm5-900":
        report = found(session, arm.with_inertial_parameters(links.ravel()))
        assert [issue.issue for issue in report.fatal] == ["bodies_misplaced"]
        assert not overrule(report, (), REPORTED_BY_A_FIT).fatal


@pytest.mark.parametrize(("joint", "factor"), [(3, 10.0), (3, 5.0), (4, 20.0)])
def test_a_wrist_of_another_scale_is_told(joint: int, factor: float, clean: Session, arm: ArmModel) -> None:
    """Law: a torque that its URDF's tolerance leaves no room for is named, however little gravity changes there."""
    report = inspect(spoil_column(clean, "effort", joint, lambda effort: factor * effort), arm)
    told = {name for issue in report.issues if issue.severity != "note" for name in issue.joints}
    assert told == {arm.joint_names[joint]}
    assert {issue.issue for issue in report.issues if issue.severity != "note"} <= {"torque_scale", "effort_not_torque"}


def test_a_urdf_within_its_tolerance_has_no_scale(clean: Session, arm: ArmModel) -> None:
    """Law: links that are some per cent off, as URDFs are, are told of no wrist."""
    rng = np.random.default_rng(8)
    for _ in range(3):
        off = arm.with_inertial_parameters(arm.inertial_parameters * rng.lognormal(0.0, 0.05, 10 * arm.n))
        joints = {name for issue in inspect(clean, off).find("torque_scale") for name in issue.joints}
        assert not joints & {"joint_4", "joint_5", "joint_6"}
