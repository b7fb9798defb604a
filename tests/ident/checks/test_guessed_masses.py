"""Laws of a URDF whose masses and centres are guesses: they are suspected, and the log is not."""

from collections.abc import Callable

import numpy as np
import pytest
from conftest import make_run
from faults import inspect

from ident.arrays import Array
from ident.checks.conventions.find import find_conventions, has_placeholders, log_of
from ident.checks.conventions.masses import guessed_masses
from ident.checks.conventions.model import Model
from ident.checks.report import TelemetryReport
from ident.recordings.recording import Session
from ident.robot.arm import ArmModel

ISSUE = "masses_guessed"
# What suspects the URDF's masses, and leaves the log as it says.
OF_URDF = {ISSUE, "body_differs", "torque_scale"}


def links_of(arm: ArmModel) -> Array:
    """Ten numbers of each link, to be changed."""
    return np.array(arm.inertial_parameters).reshape(arm.n, 10)


def shuffled(arm: ArmModel) -> ArmModel:
    """Links in each other's places."""
    return arm.with_inertial_parameters(links_of(arm)[::-1].ravel())


def of_balls(mass: float, centre: tuple[float, float, float]) -> Callable[[ArmModel], ArmModel]:
    """Every link the same ball [kg], at a place in its frame that nobody looked up [m]."""
    place = np.array(centre)
    shift = mass * (place @ place * np.eye(3) - np.outer(place, place))
    about_joint = 0.02 * np.eye(3) + shift

    def change(arm: ArmModel) -> ArmModel:
        links = np.zeros((arm.n, 10))
        links[:, 0] = mass
        links[:, 1:4] = mass * place
        links[:, 4:] = about_joint[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]
        return arm.with_inertial_parameters(links.ravel())

    return change


round_numbers = of_balls(3.0, (0.1, -0.15, 0.15))
GUESSES = {
    "shuffled": shuffled,
    "balls of 3 kg": round_numbers,
    "balls of 2 kg": of_balls(2.0, (0.15, 0.1, -0.1)),
    "balls of 1 kg": of_balls(1.0, (-0.3, 0.0, 0.1)),
}


def told_of(report: TelemetryReport) -> set[str]:
    """All that was refused or warned of, but for what the motion lacks."""
    told = {issue.issue for issue in report.issues if issue.severity != "note"}
    return told - {"insufficient_excitation", "too_few_runs"}


@pytest.mark.parametrize("guess", GUESSES)
def test_guessed_masses_are_no_convention_of_the_log(guess: str, clean: Session, arm: ArmModel) -> None:
    """Law: where other masses at the same links explain what the URDF's do not, the URDF is
    suspected, and the recordings are read as they say, whatever else would explain them.
    """
    report = inspect(clean, GUESSES[guess](arm))
    told = told_of(report)
    assert told
    assert told <= OF_URDF
    assert report.is_fit
    for run, original in zip(report.session.runs, clean.runs, strict=True):
        np.testing.assert_array_equal(run.effort, original.effort)
        np.testing.assert_array_equal(run.position, original.position)


def test_another_reading_is_named_beside_the_guess(clean: Session, arm: ArmModel) -> None:
    """Law: what would explain the log otherwise is told, though it is not sure."""
    report = inspect(clean, shuffled(arm))
    (issue,) = report.find(ISSUE)
    assert "the zero of joint_4" in issue.evidence
    assert "as log and URDF say" in issue.evidence
    assert report.to_dict()["conventions"]


def test_links_that_are_alike_are_placeholders(arm: ArmModel) -> None:
    """Law: all of an arm's links, not some of them, and more than the two of a small arm."""
    alike = round_numbers(arm)
    assert has_placeholders(alike)
    assert not has_placeholders(arm)
    assert not has_placeholders(shuffled(arm))
    assert not has_placeholders(alike.locked(alike.joint_names[:4]))
    links = links_of(alike)
    links[-1] = 1.1 * links[-1]
    assert not has_placeholders(arm.with_inertial_parameters(links.ravel()))


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_masses_that_are_off_as_urdfs_are_stay(seed: int, clean: Session, arm: ArmModel) -> None:
    """Law: an error of the usual size is for a diagnosis to find."""
    rng = np.random.default_rng(seed)
    off = arm.inertial_parameters * rng.lognormal(0.0, 0.1, 10 * arm.n)
    assert not inspect(clean, arm.with_inertial_parameters(off)).find(ISSUE)


def test_the_fitted_masses_make_the_torque(clean: Session, arm: ArmModel) -> None:
    """Law: with the masses that are found the arm makes the torque that the true one does."""
    log = log_of(clean)
    assert log is not None
    variant = guessed_masses(log.thinned(240), Model(round_numbers(arm)))
    assert variant is not None
    parameters = np.array(variant.hypothesis.parameters)
    fitted = arm.with_inertial_parameters(parameters)
    true, found = arm.gravity(log.q), fitted.gravity(log.q)
    left = (found - true) - (found - true).mean(axis=0)  # an offset may hold a part of the level
    assert left.std() < 0.05 * true.std()


def test_one_joint_tells_no_guess() -> None:
    """Law: of one joint its zero, its direction and its centre of mass are one."""
    arm = ArmModel.load("tm5-900").locked(ArmModel.load("tm5-900").joint_names[2:])
    arm = arm.locked(arm.joint_names[:1])
    rng = np.random.default_rng(6)
    lift = ArmModel.load("tm5-900")
    run = make_run(lift, rng, "run", 0.0, 12.0)
    session = Session(
        "one",
        (
            run.replace(
                joints=arm.joint_names,
                position=run.position[:, 1:2],
                velocity=run.velocity[:, 1:2],
                effort=run.effort[:, 1:2],
            ),
        ),
    )
    found = find_conventions(session, arm)
    assert found is not None
    assert found.best.hypothesis.parameters is None
    assert guessed_masses(log_of(session).thinned(240), Model(arm)) is None
