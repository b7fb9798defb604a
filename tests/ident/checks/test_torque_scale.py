"""Laws of torques of another size than the model's: gains, ratings, guesses."""

import re
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from ident.checks.effort import collect_states
from ident.checks.inspection import inspect_alone as found
from ident.checks.inspection import inspect_sessions
from ident.checks.scales import fit_scale
from ident.recordings.load import load_session
from ident.recordings.recording import Recording, Session
from ident.recordings.save import write_session
from ident.robot.arm import ArmModel
from tests.ident.checks.faults import changed, inspect, spoil, spoil_column
from tests.ident.checks.mounts import angle_between, mounted
from tests.ident.checks.real_arms import load_real
from tests.ident.made_up import joint, link, made_session, urdf

GRAVITY = np.array([0.0, 0.0, -9.81])


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


@pytest.mark.parametrize(
    ("joints", "count", "issue", "severity"),
    [
        ((2,), 0.01, "effort_not_torque", "fatal"),
        ((3, 4, 5), 0.01, "effort_not_torque", "fatal"),
        ((0, 1, 2, 3, 4, 5), 0.01, "effort_not_torque", "fatal"),
        ((3, 4, 5), 0.9, "whole_numbers", "note"),
    ],
)
def test_counts_in_the_place_of_torques_are_told_at_their_joints(
    joints: tuple[int, ...], count: float, issue: str, severity: str, clean: Session, arm: ArmModel
) -> None:
    """Law: whole numbers are a sign of another unit, beside numbers that are not, and where all are too large."""
    of_joint = np.isin(np.arange(arm.n), joints)
    counted = changed(clean, "effort", lambda tau: np.where(of_joint, np.round(tau / count), tau))
    (told,) = [each for each in found(counted, arm).issues if each.issue == issue]
    places = "every joint" if len(joints) == arm.n else ", ".join(arm.joint_names[joint] for joint in joints)
    assert told.severity == severity
    assert "counts?" in told.evidence
    assert places in told.evidence
    assert not found(clean, arm).find("whole_numbers")


@pytest.mark.parametrize("name", ["scara", "tiago", "upright"])
def test_a_slide_whose_gravity_is_constant_has_no_scale(name: str) -> None:
    """Law: a weight that never changes is an offset; nothing of the joint's torque tells its size."""
    if name == "upright":
        slide = joint("lift", "base", "carriage", "prismatic", "0 0 1")
        turn = joint("turn", "carriage", "rod", axis="0 1 0")
        links = (link("base"), link("carriage", 7.0), link("rod", 2.0))
        arm = ArmModel.from_urdf(urdf(*links, slide, turn))
    else:
        arm = ArmModel.load(name)
    law = lambda q, dq, ddq: arm.inverse_dynamics(q, dq, ddq) + 30.0 * dq + 2.0 * np.tanh(dq / 0.01)  # noqa: E731
    made = made_session(arm, law, [3, 4], duration=20.0)
    states = collect_states(made, arm)
    slides = np.flatnonzero(arm.chain.sliding[: arm.n])
    assert len(slides)
    assert not states.varies[slides].any()
    assert not found(made, arm).find("torque_scale")


@pytest.mark.real
@pytest.mark.parametrize("name", ["panda", "rokae", "ur10"])
def test_a_wrong_gain_of_a_real_joint_that_feels_gravity_is_said_first(name: str, real_data: Path) -> None:
    """And as large as it is, beside what the arm's URDF makes of the untouched log."""
    recording, arm = load_real(name, real_data)
    session = found(recording, arm).session
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
    told = re.search(r"is ([\d.]+) ± ([\d.]+) times", report.effort[joint].evidence)
    assert told is not None
    assert float(told[1]) == pytest.approx(after, abs=0.005)
    # No interval is nothing: its first digit is told, however small it is.
    assert float(told[2]) == pytest.approx(2.0 * error, rel=0.5)


def holding(arm: ArmModel, seed: int, share: float) -> Session:
    """Short runs from hold to hold, in which a share of dry friction stays where a joint has stopped."""
    rng = np.random.default_rng(seed)
    runs = []
    time = np.arange(800) / 200.0
    for number in range(4):
        q, dq, ddq, stays = (np.zeros((len(time), arm.n)) for _ in range(4))
        place = rng.uniform(-0.6, 0.6, arm.n)
        for first in range(0, len(time), 200):
            goal = rng.uniform(-1.0, 1.0, arm.n)
            u = np.minimum(np.arange(200) / 120.0, 1.0)[:, None]
            rows = slice(first, first + 200)
            q[rows] = place + (goal - place) * (10 * u**3 - 15 * u**4 + 6 * u**5)
            dq[rows] = (goal - place) * (30 * u**2 - 60 * u**3 + 30 * u**4) / 0.6
            ddq[rows] = (goal - place) * (60 * u - 180 * u**2 + 120 * u**3) / 0.36
            stays[rows] = share * (u >= 1.0) * np.sign(goal - place)
            place = goal
        dry = np.tanh(dq / 0.005) + stays
        tau = arm.inverse_dynamics(q, dq, ddq) + [12.0, 12.0, 8.0, 3.0, 2.0, 1.0] * (dry + 0.7 * dq)
        noisy = q + 2e-5 * rng.standard_normal(q.shape)
        tau += 0.2 * rng.standard_normal(q.shape)
        runs.append(Recording(f"run_{number}", arm.joint_names, 5.0 * number + time, noisy, tau))
    return Session("holding", tuple(runs), robot="tm5-900", path=Path("holding"))


@pytest.mark.parametrize("share", [0.0, 0.5, 0.9])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_friction_that_stays_where_a_joint_stopped_is_no_scale(share: float, seed: int, arm: ArmModel) -> None:
    """Law: it goes with the place that a joint has come to, as gravity does, and moves no scale beyond its error."""
    session = holding(arm, seed, share)
    states = collect_states(session, arm)
    for heavy in map(int, np.flatnonzero(states.heavy & states.moving)):
        scale, error, _ = fit_scale(states, heavy)
        assert abs(scale - 1.0) < 3.0 * error + 0.03
    assert not found(session, arm).find("torque_scale")


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
