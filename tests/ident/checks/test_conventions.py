"""Laws of the search: what was turned, shifted, swapped or mounted otherwise is found, and told with its line."""

import tomllib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from faults import inspect, spoil

from ident.checks.conventions.find import find_conventions, is_changed, search_conventions
from ident.checks.conventions.hypothesis import COMPENSATED, Hypothesis
from ident.checks.conventions.model import Model
from ident.checks.conventions.readings import Log, read
from ident.checks.conventions.reread import reread
from ident.checks.inspection import inspect_sessions
from ident.errors import LINE_TO_WRITE
from ident.recordings.load import load_session
from ident.recordings.recording import Recording, Session
from ident.recordings.save import write_session
from ident.robot.arm import ArmModel

PLAIN = Hypothesis.as_it_is(6)
LOG = ("position", "velocity")


def columns(run: Recording, order: list[int]) -> Recording:
    """A run whose columns stand in another order under the same names."""
    return run.replace(**{name: values[:, order] for name, values in run.channels().items()})


def at_joint(joint: int, **changes: Callable[[np.ndarray], np.ndarray]) -> Callable[[Recording], Recording]:
    """A change of one joint's channels."""

    def change(run: Recording) -> Recording:
        found = {}
        for name, function in changes.items():
            values = np.array(getattr(run, name))
            values[:, joint] = function(values[:, joint])
            found[name] = values
        return run.replace(**found)

    return change


def backwards(joint: int) -> Callable[[Recording], Recording]:
    return at_joint(joint, position=np.negative, velocity=np.negative, effort=np.negative)


def shifted(joint: int, angle: float) -> Callable[[Recording], Recording]:
    return at_joint(joint, position=lambda q: q - angle)


# The change of the log, and the hypothesis by which it is read rightly.
CHANGES: dict[str, tuple[Callable[[Recording], Recording], Hypothesis]] = {
    "nothing": (lambda run: run, PLAIN),
    "axis of joint 2": (backwards(1), PLAIN.with_entry("direction", 1, -1)),
    "axis of joint 3": (backwards(2), PLAIN.with_entry("direction", 2, -1)),
    "axis of joint 4": (backwards(3), PLAIN.with_entry("direction", 3, -1)),
    "zero of joint 2": (shifted(1, 0.5 * np.pi), PLAIN.with_entry("quarters", 1, 1)),
    "zero of joint 3": (shifted(2, -0.5 * np.pi), PLAIN.with_entry("quarters", 2, 3)),
    "zero of joint 4": (shifted(3, np.pi), PLAIN.with_entry("quarters", 3, 2)),
    "two columns": (
        lambda run: columns(run, [0, 2, 1, 3, 4, 5]),
        replace(PLAIN, order=(0, 2, 1, 3, 4, 5), effort_order=(0, 2, 1, 3, 4, 5)),
    ),
    "shoulder first and last": (
        lambda run: columns(run, [2, 1, 0, 3, 4, 5]),
        replace(PLAIN, order=(2, 1, 0, 3, 4, 5), effort_order=(2, 1, 0, 3, 4, 5)),
    ),
    "efforts of two": (
        lambda run: run.replace(effort=run.effort[:, [0, 2, 1, 3, 4, 5]]),
        replace(PLAIN, effort_order=(0, 2, 1, 3, 4, 5)),
    ),
    "one torque sign": (at_joint(2, effort=np.negative), PLAIN.with_entry("effort_sign", 2, -1)),
    "all torque signs": (lambda run: run.replace(effort=-run.effort), replace(PLAIN, effort_sign=(-1,) * 6)),
    "degrees of one": (
        at_joint(2, position=np.degrees, velocity=np.degrees),
        PLAIN.with_entry("unit", 2, "deg"),
    ),
    "turns": (
        lambda run: run.replace(position=run.position / (2.0 * np.pi), velocity=run.velocity / (2.0 * np.pi)),
        replace(PLAIN, unit=("turns",) * 6),
    ),
    "axis and torque sign": (
        lambda run: at_joint(2, effort=np.negative)(backwards(1)(run)),
        PLAIN.with_entry("direction", 1, -1).with_entry("effort_sign", 2, -1),
    ),
    "two columns and one torque sign": (
        lambda run: columns(at_joint(3, effort=np.negative)(run), [0, 2, 1, 3, 4, 5]),
        replace(PLAIN, order=(0, 2, 1, 3, 4, 5), effort_order=(0, 2, 1, 3, 4, 5), effort_sign=(1, 1, 1, -1, 1, 1)),
    ),
    "degrees of one and its zero": (
        lambda run: at_joint(2, position=np.degrees, velocity=np.degrees)(shifted(2, 0.5 * np.pi)(run)),
        PLAIN.with_entry("unit", 2, "deg").with_entry("quarters", 2, 1),
    ),
    "axis and zero of joint 4": (
        lambda run: backwards(3)(shifted(3, np.pi)(run)),
        PLAIN.with_entry("direction", 3, -1).with_entry("quarters", 3, 2),
    ),
    "degrees of one under another's name": (
        lambda run: columns(at_joint(1, position=np.degrees, velocity=np.degrees)(run), [2, 1, 0, 3, 4, 5]),
        replace(PLAIN, order=(2, 1, 0, 3, 4, 5), effort_order=(2, 1, 0, 3, 4, 5)).with_entry("unit", 1, "deg"),
    ),
    "order and zero": (
        lambda run: columns(shifted(2, 0.5 * np.pi)(run), [1, 0, 2, 3, 4, 5]),
        replace(PLAIN, order=(1, 0, 2, 3, 4, 5), effort_order=(1, 0, 2, 3, 4, 5), quarters=(0, 0, 1, 0, 0, 0)),
    ),
}


@pytest.mark.parametrize("change", CHANGES)
def test_a_convention_is_found_and_the_session_read_by_it(change: str, clean: Session, arm: ArmModel) -> None:
    """Law: read by what is found, the session is the one before the change."""
    spoil_it, truth = CHANGES[change]
    spoilt = spoil(clean, spoil_it)
    found = find_conventions(spoilt, arm)
    assert found is not None
    assert is_changed(found) == (truth != PLAIN)
    assert replace(found.best.hypothesis, body=None) == truth
    for run, original in zip(reread(spoilt, found.best.hypothesis).runs, clean.runs, strict=True):
        np.testing.assert_allclose(run.position, original.position, atol=1e-9)
        np.testing.assert_allclose(run.effort, original.effort, atol=1e-9)


@pytest.mark.parametrize("gravity", [(9.81, 0.0, 0.0), (0.0, -9.81, 0.0), (0.0, 0.0, 9.81), (6.9, 0.0, -6.97)])
def test_a_mount_is_proposed_with_its_line(gravity: tuple[float, float, float], clean: Session, arm: ArmModel) -> None:
    """Law: gravity is where the recordings have it, the session refused until its user says so, and nothing else is."""
    report = inspect(clean, arm.with_gravity(np.array(gravity)))
    assert {issue.issue for issue in report.fatal} == {"mounting"}
    (issue,) = report.find("mounting")
    (line,) = LINE_TO_WRITE.findall(issue.remedy)
    np.testing.assert_allclose(tomllib.loads(line)["gravity_mps2"], [0.0, 0.0, -9.81], atol=0.3)
    assert not inspect(clean.replace(gravity=(0.0, 0.0, -9.81)), arm.with_gravity(np.array(gravity))).fatal


def test_a_load_turns_no_base(clean: Session, arm: ArmModel) -> None:
    """Law: what a body at the end of the arm explains is neither a mount nor a unit, whichever way it is held."""
    for place in ([0.1, 0.0, 0.1], [-0.2, 0.1, 0.0], [0.0, 0.0, 0.3]):
        parameters = np.array(arm.inertial_parameters)
        parameters[-10:-6] += 3.0 * np.array([1.0, *place])
        loaded = arm.with_inertial_parameters(parameters)
        more = spoil(
            clean,
            lambda run, loaded=loaded: run.replace(
                effort=run.effort + loaded.gravity(run.position) - arm.gravity(run.position)
            ),
        )
        report = inspect(more, arm)
        assert report.is_fit
        assert not report.find("mounting")
        (issue,) = report.find("body_differs")
        assert "more at its end" in issue.evidence
        mass = float(issue.evidence.partition("carries ")[2].partition(" kg")[0])
        assert mass == pytest.approx(3.0, rel=0.2)


@pytest.mark.parametrize("share", [0.5, 0.9, 1.0])
def test_a_tool_that_is_not_on_the_arm_is_taken_out_of_the_urdf(share: float, clean: Session, arm: ArmModel) -> None:
    parameters = np.array(arm.inertial_parameters)
    parameters[-10:-6] += 4.0 * share * np.array([1.0, 0.0, 0.0, 0.25])
    report = inspect(clean, arm.with_inertial_parameters(parameters))
    assert report.is_fit
    (issue,) = report.find("body_differs")
    assert "less at its end than the URDF has" in issue.evidence
    assert not report.find("torque_scale")


@pytest.mark.parametrize(("factor", "issue"), [(1e3, "mass_factor"), (30.0, "mass_factor"), (1.9, "mass_factor")])
def test_masses_that_are_all_off_are_one_factor(factor: float, issue: str, clean: Session, arm: ArmModel) -> None:
    """Law: one cause, told once, with the factor that mends the URDF."""
    heavy = arm.with_inertial_parameters(factor * np.array(arm.inertial_parameters))
    report = inspect(clean, heavy)
    (told,) = [each for each in report.issues if each.severity != "note"]
    assert told.issue == issue
    stated = float(told.remedy.partition("URDF by ")[2].partition(" (")[0])
    assert stated == pytest.approx(1.0 / factor, rel=0.1)
    assert told.severity == ("fatal" if factor > 2.5 else "warning")


def test_gravity_that_a_driver_takes_out_is_no_order_and_no_zero(clean: Session, arm: ArmModel) -> None:
    free = spoil(clean, lambda run: run.replace(effort=run.effort - arm.gravity(run.position)))
    found = find_conventions(free, arm)
    assert found is not None
    assert found.best.hypothesis.gravity == COMPENSATED
    assert [issue.issue for issue in inspect(free, arm).issues] == ["effort_gravity_compensated"]


def test_a_standing_arm_s_levels_speak_against_a_turn() -> None:
    """Law: where only a joint about the vertical moves, the levels that the others hold keep the base."""
    arm = ArmModel.load("tm5-900")
    rng = np.random.default_rng(4)
    t = np.arange(0.0, 40.0, 0.02)
    q = np.tile([0.0, -0.6, 1.2, 0.4, 1.2, 0.0], (len(t), 1))
    q[:, 0] = 1.2 * np.sin(0.5 * t)
    dq, ddq = np.gradient(q, t, axis=0), np.gradient(np.gradient(q, t, axis=0), t, axis=0)
    # Friction that follows the angle looks like gravity about a level axis.
    tau = arm.inverse_dynamics(q, dq, ddq) + 9.0 * np.tanh(dq / 0.02) + 0.3 * rng.standard_normal(q.shape)
    tau[:, 0] += 6.0 * np.sin(q[:, 0])
    found = search_conventions(Log(q, dq, ddq, tau), Model(arm))
    assert not is_changed(found)


def test_sums_of_a_reading_are_those_of_the_motion_it_makes(clean: Session, arm: ArmModel) -> None:
    """Law: reading a log otherwise is recording another motion."""
    run = clean.runs[0]
    ddq = np.gradient(run.velocity, run.time, axis=0)
    log, model = Log(run.position, run.velocity, ddq, run.effort), Model(arm)
    reading = replace(PLAIN, order=(2, 1, 0, 3, 4, 5), direction=(1, -1, 1, 1, 1, 1), quarters=(0, 0, 3, 0, 0, 0))
    other = Log(*(reading.rates(values, model.sliding) for values in (run.position, run.velocity, ddq)), run.effort)
    other = replace(other, q=reading.angles(run.position, model.sliding))
    by_reading, by_motion = read(log, model, [reading]), read(other, model, [PLAIN])
    np.testing.assert_allclose(by_reading.left, by_motion.left, rtol=1e-9, atol=1e-9)


def test_the_lines_that_are_proposed_mend_the_session(clean: Session, arm: ArmModel, tmp_path: Path) -> None:
    """Law: the tables of a remedy, pasted into session.toml, make the recordings fit for use."""
    spoilt = spoil(clean, lambda run: shifted(2, 0.5 * np.pi)(at_joint(1, effort=np.negative)(backwards(3)(run))))
    write_session(spoilt, tmp_path / "session")
    (report,) = inspect_sessions([load_session(tmp_path / "session")], arm)
    assert {issue.issue for issue in report.fatal} == {"axis_reversed", "zero_shifted", "effort_sign_flipped"}
    lines = [line for issue in report.fatal for line in LINE_TO_WRITE.findall(issue.remedy)]
    (tmp_path / "session/session.toml").write_text("\n".join(lines))
    (mended,) = inspect_sessions([load_session(tmp_path / "session")], arm)
    assert mended.is_fit
    np.testing.assert_allclose(mended.session.runs[0].position, clean.runs[0].position, atol=1e-4)


def test_the_record_holds_the_best_two(clean: Session, arm: ArmModel) -> None:
    """Law: what explains more than the best changes more than the best."""
    report = inspect(spoil(clean, backwards(1)), arm)
    best, second = report.to_dict()["conventions"]
    assert best["hypothesis"]["direction"] == {"joint_2": -1}
    changes_more = set(second["hypothesis"]) > set(best["hypothesis"])
    assert best["explains"] > second["explains"] or changes_more
