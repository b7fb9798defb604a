"""Laws of runs held against one another: what is otherwise in some is named with its runs; sound sessions hold none."""

from collections.abc import Callable

import numpy as np
import pytest
from conftest import COULOMB, RATE_HZ, ROTOR, TORQUE_NOISE, VISCOUS, make_run
from faults import inspect, spoil

from ident.checks.between_runs import partings
from ident.checks.odd_runs import check_odd_runs
from ident.recordings.load import load_session
from ident.recordings.recording import Recording, Session
from ident.robot.arm import ArmModel
from ident.robot.names import data_path

Change = Callable[[Recording], Recording]


def torque(joints: list[int], factor: float) -> Change:
    """Torques of some joints times a factor."""

    def change(run: Recording) -> Recording:
        factors = np.ones(len(run.joints))
        factors[joints] = factor
        return run.replace(effort=factors * run.effort)

    return change


def exchange(first: int, second: int) -> Change:
    """All columns of two joints in each other's place."""

    def change(run: Recording) -> Recording:
        order = list(range(len(run.joints)))
        order[first], order[second] = second, first
        return run.replace(**{name: values[:, order] for name, values in run.channels().items()})

    return change


def move_zero(joint: int, angle: float) -> Change:
    def change(run: Recording) -> Recording:
        position = np.array(run.position)
        position[:, joint] += angle
        return run.replace(position=position)

    return change


CHANGES: dict[str, tuple[Change, str, tuple[str, ...]]] = {
    "all signs": (torque([0, 1, 2, 3, 4, 5], -1.0), "effort_sign_flipped", ()),
    "sign of joint 2": (torque([1], -1.0), "effort_sign_flipped", ("joint_2",)),
    "sign of joint 3": (torque([2], -1.0), "effort_sign_flipped", ("joint_3",)),
    "joints 2 and 3": (exchange(1, 2), "columns_swapped", ("joint_2", "joint_3")),
    "joints 1 and 3": (exchange(0, 2), "columns_swapped", ("joint_1", "joint_3")),
    "ten times": (torque([0, 1, 2, 3, 4, 5], 10.0), "effort_not_torque", ()),
    "a tenth": (torque([0, 1, 2, 3, 4, 5], 0.1), "effort_not_torque", ()),
}


@pytest.fixture(scope="module")
def eight(arm: ArmModel) -> Session:
    """Eight sound runs of 8 s."""
    rng = np.random.default_rng(17)
    return Session("eight", tuple(make_run(arm, rng, f"run{k}", 20.0 * k, 8.0) for k in range(8)))


@pytest.mark.parametrize("odd", [0, 5])
@pytest.mark.parametrize("change", CHANGES)
def test_a_run_that_is_otherwise_is_named(change: str, odd: int, eight: Session, arm: ArmModel) -> None:
    """Law: its name, its kind and its joints are told, and later checks see the rest alone."""
    spoil_it, kind, joints = CHANGES[change]
    rest, (issue,) = check_odd_runs(spoil(eight, spoil_it, odd), arm)
    assert (issue.issue, issue.severity) == (kind, "fatal")
    assert f"run{odd}:" in issue.evidence
    assert {*joints} <= {*issue.joints}
    assert [run.name for run in rest.runs] == [run.name for run in eight.runs if run.name != f"run{odd}"]


@pytest.mark.parametrize(("joint", "angle"), [(1, 0.3), (2, -0.3), (1, -0.2)])
def test_a_zero_that_is_moved_between_two_runs_is_named(
    joint: int, angle: float, eight: Session, arm: ArmModel
) -> None:
    """Law: with its joint and by how much, of the fewer runs against the more."""
    moved = eight
    for number in (5, 6, 7):
        moved = spoil(moved, move_zero(joint, angle), number)
    _, (issue,) = check_odd_runs(moved, arm)
    assert issue.issue == "zero_shifted"
    assert issue.joints == (arm.joint_names[joint],)
    assert "run5, run6, run7" in issue.evidence
    told = float(issue.evidence.partition("moved by ")[2].partition(" rad")[0])
    assert told == pytest.approx(angle, abs=0.1)


@pytest.mark.parametrize("odd", [(2,), (5, 6, 7)])
def test_another_arm_is_told(odd: tuple[int, ...], eight: Session, arm: ArmModel) -> None:
    """Law: runs of an arm of other links are told to differ, whatever their motion."""
    other = ArmModel.load("ur5")
    rng = np.random.default_rng(3)
    runs = list(eight.runs)
    for number in odd:
        strange = make_run(other, rng, runs[number].name, runs[number].time[0], 8.0)
        runs[number] = Recording(strange.name, arm.joint_names, strange.time, strange.position, strange.effort)
    _, (issue,) = check_odd_runs(eight.replace(runs=runs), arm)
    assert issue.severity == "fatal"
    assert all(f"run{number}" in issue.evidence for number in odd)
    assert issue.issue == "runs_differ"


@pytest.mark.parametrize("name", ["E1", "E2", "T1", "payload_516g", "payload_1544g", "sealed_1"])
def test_runs_as_they_were_recorded_hold_no_odd_one(name: str) -> None:
    session = load_session(data_path(f"logs/tm5_900/{name}"))
    assert check_odd_runs(session, ArmModel.load("tm5-900"))[1] == []


@pytest.mark.parametrize("seed", range(4))
def test_motion_of_another_kind_is_no_difference(seed: int, arm: ArmModel) -> None:
    """Law: slow runs beside fast ones, and short ones beside long ones, are alike."""
    rng = np.random.default_rng(seed)
    runs = []
    for k, speed in enumerate((0.2, 1.0, 2.0, 0.5, 1.5, 0.1)):
        runs.append(make_run(arm, rng, f"run{k}", 40.0 * k, float(rng.uniform(6.0, 14.0)), speed))
    assert check_odd_runs(Session("mixed", tuple(runs)), arm)[1] == []


def warmed(share: float) -> Change:
    """Friction at a share of what it is, and as much of it at every joint."""

    def change(run: Recording) -> Recording:
        assert run.velocity is not None
        friction = COULOMB * np.tanh(run.velocity / 0.01) + VISCOUS * run.velocity
        return run.replace(effort=run.effort + (share - 1.0) * friction)

    return change


@pytest.mark.parametrize("seed", range(3))
def test_friction_that_falls_as_the_arm_warms_is_no_difference(seed: int, arm: ArmModel) -> None:
    """Law: a warm part of a session is neither another arm, nor is its torque in another unit."""
    rng = np.random.default_rng(seed)
    runs = []
    for k, share in enumerate((1.6, 1.5, 1.4, 1.3, 1.05, 1.0, 1.0, 0.95)):
        run = make_run(arm, rng, f"run{k}", 60.0 * k, 8.0, float(rng.uniform(1.0, 3.0)))
        runs.append(warmed(share)(run))
    assert check_odd_runs(Session("warm", tuple(runs)), arm)[1] == []


def jog_one(arm: ArmModel, rng: np.random.Generator, name: str, start: float, joint: int) -> Recording:
    """One joint swings; the others stand where they are, held by anything within their dry friction."""
    time = np.arange(0.0, 8.0, 1.0 / RATE_HZ)
    speed = float(rng.uniform(0.8, 1.6))
    size = float(rng.uniform(0.3, 0.6))
    q = np.tile(np.linspace(-0.4, 0.4, arm.n), (len(time), 1))
    dq, ddq = np.zeros_like(q), np.zeros_like(q)
    q[:, joint] += size * (np.sin(speed * time) + 0.4 * np.sin(2.3 * speed * time + 1.0))
    dq[:, joint] = size * speed * (np.cos(speed * time) + 0.92 * np.cos(2.3 * speed * time + 1.0))
    ddq[:, joint] = -size * speed**2 * (np.sin(speed * time) + 2.116 * np.sin(2.3 * speed * time + 1.0))
    held = np.broadcast_to(COULOMB * rng.uniform(-1.0, 1.0, arm.n), q.shape)
    moving = np.arange(arm.n) == joint
    friction = np.where(moving, COULOMB * np.tanh(dq / 0.01) + VISCOUS * dq, held)
    tau = arm.inverse_dynamics(q, dq, ddq) + ROTOR * ddq + friction
    noise = TORQUE_NOISE * rng.normal(size=tau.shape)
    return Recording(name, arm.joint_names, start + time, q, tau + noise, velocity=dq)


@pytest.mark.parametrize("seed", range(3))
def test_jogs_of_one_joint_after_the_other_are_no_difference(seed: int, arm: ArmModel) -> None:
    """Law: what moves in a few runs alone the others can't foretell, and what stands may be held by any friction."""
    rng = np.random.default_rng(seed)
    runs = [jog_one(arm, rng, f"run{k}", 20.0 * k, k // 3) for k in range(3 * arm.n)]
    assert check_odd_runs(Session("jogs", tuple(runs)), arm)[1] == []


def test_of_two_runs_nobody_knows_the_odd_one(eight: Session, arm: ArmModel) -> None:
    two = eight.replace(runs=eight.runs[:2])
    assert check_odd_runs(spoil(two, torque([1, 2], -1.0), 0), arm)[1] == []


def test_the_recording_is_refused_and_nobody_else_accused(eight: Session, arm: ArmModel) -> None:
    report = inspect(spoil(eight, torque([1], -1.0), 4), arm)
    assert [issue.issue for issue in report.fatal] == ["effort_sign_flipped"]


def test_runs_that_differ_each_in_its_own_way_are_all_named(eight: Session, arm: ArmModel) -> None:
    """Law: a second odd run is told as itself; it accuses no torque of the others."""
    twice = spoil(spoil(eight, torque([0, 1, 2, 3, 4, 5], -1.0), 2), torque([1], -1.0), 5)
    report = inspect(twice, arm)
    assert [issue.issue for issue in report.fatal] == ["effort_sign_flipped"] * 2
    told = sorted(issue.evidence for issue in report.fatal)
    assert ["run2:" in told[0], "run5:" in told[1]] == [True, True]
    assert {run.name for run in report.session.runs} == {f"run{k}" for k in (0, 1, 3, 4, 6, 7)}


def test_every_run_stands_alone_once_and_the_fewer_stand_out() -> None:
    assert partings(5) == [(0,), (1,), (2,), (3,), (4,), (0, 1), (3, 4)]
    assert all(2 * len(odd) <= 9 for odd in partings(9))
