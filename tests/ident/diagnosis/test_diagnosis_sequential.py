"""Looking again and again: the chance of a false name is spent, not had anew; what is missing is told."""

from dataclasses import replace

import numpy as np
import pytest

from ident.api.diagnosing import first_runs
from ident.diagnosis.diagnose import diagnose
from ident.diagnosis.next_experiment import next_experiment
from ident.diagnosis.result import Diagnosis
from ident.diagnosis.sequential import diagnose_sequentially, find_missing
from ident.effects.base import Effect
from ident.effects.catalogue import CATALOGUE, find_effect
from ident.effects.effect_info import describe_motion
from ident.errors import InputError
from ident.recordings.recording import Recording, Session
from ident.robot.arm import ArmModel
from ident.show.diagnosis_lines import describe_looks
from tests.ident.diagnosis.planted import record, spring_on_3


def empty(verdict: str, runs: int) -> Diagnosis:
    return Diagnosis("arm", ("joint_1",), verdict, {"runs": runs, "samples": 0, "duration_s": 10.0 * runs}, ())


def test_it_stops_when_it_is_sure() -> None:
    """Law: no run beyond those that were enough is looked at."""
    asked: list[int] = []

    def look(runs: int) -> Diagnosis:
        asked.append(runs)
        return empty("no_gap" if runs >= 8 else "not_testable", runs)

    found = diagnose_sequentially(look, 30, 0.9)
    assert asked == [5, 8]
    assert found.enough
    assert found.to_dict()["runs"] == 8
    assert describe_looks(found.to_dict()).startswith("Sure after 8 runs (1.3 min)")


def test_what_is_missing_is_told_at_the_end() -> None:
    found = diagnose_sequentially(lambda runs: empty("none_of_catalogue", runs), 9, 0.9)
    assert not found.enough
    assert len(found.looks) == 3
    assert "the gap is unexplained" in describe_looks(found.to_dict())


@pytest.mark.parametrize("sure", [0.2, 1.0, float("nan")])
def test_what_nobody_can_be_is_refused(sure: float) -> None:
    with pytest.raises(InputError, match="until"):
        diagnose_sequentially(lambda runs: empty("no_gap", runs), 9, sure)


# A flexible function of the state imitates a spring well: its name is no surer than some nine in ten.
SURE = 0.85


def test_a_planted_spring_is_sure_and_is_not_sure_enough_for_more(short_arm: ArmModel) -> None:
    """Law: a name counts from its probability on, which is told where it lies below."""
    motions = record(short_arm, spring_on_3)
    effects = [find_effect("spring_torque")]

    def look(runs: int) -> Diagnosis:
        return diagnose(motions[:runs], short_arm, effects, common_clock=False).diagnosis

    found = diagnose_sequentially(look, len(motions), SURE)
    assert found.enough
    assert [one.effect for one in found.diagnosis.findings] == ["spring_torque"]
    (finding,) = found.diagnosis.findings
    doubtful = replace(finding, estimate=replace(finding.estimate, probability=0.7))
    (words,) = find_missing(replace(found.diagnosis, findings=(doubtful,)), SURE)
    assert words == "spring_torque of joint_3 has probability 0.70"


def test_looks_take_the_first_runs_across_sessions() -> None:
    """Law: runs in their order, from as many sessions as they lie in; asked for all, all are there."""
    time = np.arange(3.0)
    runs = [Recording(f"run_{k}", ("joint_1",), time + 10.0 * k, *np.zeros((2, 3, 1))) for k in range(5)]
    sessions = [Session("a", tuple(runs[:2])), Session("b", tuple(runs[2:]))]
    found = [[run.name for session in first_runs(sessions, count) for run in session.runs] for count in (1, 3, 9)]
    assert found == [["run_0"], ["run_0", "run_1", "run_2"], [f"run_{k}" for k in range(5)]]
    assert [len(session.runs) for session in first_runs(sessions, 2)] == [2]


def finding(*effects: str, joint: str = "joint_2") -> dict[str, object]:
    return {"effect": effects[0], "class": list(effects), "joints": [joint]}


def unseen(effect: str, *joints: str, reason: str = "it stands still") -> dict[str, object]:
    return {"effect": effect, "joints": list(joints), "reason": reason}


def test_first_tied_class_is_parted() -> None:
    """The motion is for the joint and the effects of the first class of two or more, not for later ones."""
    found = next_experiment(
        [
            finding("payload"),
            finding("joint_elasticity", "torque_delay", joint="joint_3"),
            finding("stribeck_friction", "presliding_hysteresis"),
        ],
        [unseen("thermal_friction", "joint_1")],
    )
    assert found is not None
    assert found["separates"] == ["joint_elasticity", "torque_delay"]
    assert "swept in frequency" in found["motion"]
    assert "--robot tm5-900 --separate joint_elasticity,torque_delay --joint joint_3 --out" in found["motion"]
    assert found["minutes"] > 0


def test_exact_twins_get_another_set_up() -> None:
    """Payload and last link are one torque in every motion: the proposal is to take the payload off."""
    found = next_experiment([finding("payload", "link_inertial_error", joint="joint_6")], [])
    assert found is not None
    assert "Take everything off the flange" in found["motion"]
    assert "plan excite" not in found["motion"]


def test_a_gap_without_a_name_is_asked_about_where_it_is_largest() -> None:
    """By what could not be tested there; not by what comes first at another joint."""
    silent = [unseen("joint_elasticity", "joint_6"), unseen("backlash", "joint_2", "joint_6")]
    found = next_experiment([], silent, loudest="joint_2")
    assert found is not None
    assert found["separates"] == ["backlash"]
    assert "--joint joint_2 " in found["motion"]


def test_unseen_effects_get_the_motion_that_shows_most_of_them() -> None:
    """Three effects want a ladder of speeds and one a chirp: the ladder is proposed, for the joint that lacks most."""
    entries = [
        unseen("stribeck_friction", "joint_5"),
        unseen("nonlinear_viscous_friction", "joint_5"),
        unseen("asymmetric_friction", "joint_4"),
        unseen("torque_delay", "joint_1"),
    ]
    found = next_experiment([], entries)
    assert found is not None
    assert found["separates"] == ["stribeck_friction", "nonlinear_viscous_friction", "asymmetric_friction"]
    assert found["motion"].startswith("joint_5 there and back at steady speeds")


@pytest.mark.parametrize("effect", CATALOGUE)
def test_every_effect_of_the_catalogue_has_its_motion(effect: Effect) -> None:
    """Whatever is named, there are words for the motion that shows it."""
    assert "{" not in describe_motion(effect.shown_by, "joint_1")
