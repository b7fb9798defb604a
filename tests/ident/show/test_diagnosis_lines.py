"""A diagnosis on a terminal: one thing first, whole, wrapped; no keys; numbers beside the URDF's."""

from __future__ import annotations

import copy
import re
import shlex
from io import StringIO
from pathlib import Path
from typing import Any

import pytest
import typer

from ident.cli.app import app
from ident.command_options import DiagnoseOptions
from ident.show.console import PlainConsole, wrap
from ident.show.diagnosis_lines import patch_call, print_diagnosis, untold_issues
from ident.show.report.diagnosis_actions import first_action, second_action
from ident.show.report.diagnosis_gap import describe_noise
from ident.show.report.diagnosis_verdict import diagnosis_headline
from ident.show.report.finding_words import place_words
from ident.show.report.numbers import (
    IN_LAW,
    MEANS_FROM_ZERO,
    MEANS_IN_LAW,
    MEANS_OF_LOAD,
    Number,
    describe_marks,
    describe_numbers,
    numbers_of,
    sure_change,
    table_of,
    with_error,
)
from tests.ident.show.report.test_report_diagnosis import RECORD
from tests.ident.show.report.test_report_first_line import SCALE, acted_on

JOINTS = ("shoulder", "elbow")
WIDTH = 80
# What no sentence ends with, where it was cut.
CUT = re.compile(r"…$", re.MULTILINE)
# Keys of the contract: words joined by underscores that are no name of this record's own.
KEY = re.compile(r"\b(?!why_|tm5_|joint_)[a-z]+(?:_[A-Za-z0-9]+)+\b")


def figure(nominal: float | None, value: float, half: float, tolerant: float = 0.0) -> dict[str, Any]:
    """A number of the record with the torque that the difference makes."""
    wide = max(half, tolerant)
    return {
        "nominal": nominal,
        "value": value,
        "low": value - half,
        "high": value + half,
        "low_with_urdf": value - wide,
        "high_with_urdf": value + wide,
        "change_rms_Nm": abs(value - (nominal or 0.0)),
    }


def healthy(factor: float = 1.0, stated: float | None = 8.0) -> dict[str, Any]:
    """The record of an arm without a gap, whose friction is so many times the URDF's."""
    record = copy.deepcopy(RECORD)
    record |= {"verdict": "no_gap", "joints": list(JOINTS), "findings": [], "where": [], "heldout": {}}
    record |= {"next_experiment": None, "not_testable": []}
    gap = record["gap"]["joint_1"]
    record["gap"] = {joint: {**gap, "urdf_rms_Nm": 3.0, "unexplained": None} for joint in JOINTS}
    losses = {
        "viscous_Nms_rad": figure(None if stated is None else 2.0 * stated, 16.0 * factor, 0.04),
        "coulomb_Nm": figure(stated, 8.0 * factor, 0.03),
        "armature_kgm2": figure(None, 0.6, 0.002, 0.06),
        "offset_Nm": figure(0.0, 0.001, 0.02),
        "torque_gain": figure(1.0, 1.0, 0.01),
    }
    record["identified"] = {joint: copy.deepcopy(losses) for joint in JOINTS} | {"links": {}}
    return record


def told(record: dict[str, Any], details: bool = False, width: int = WIDTH) -> str:
    stream = StringIO()
    print_diagnosis(PlainConsole(file=stream, width=width, markup=False), record, details)
    return stream.getvalue()


def test_friction_that_is_half_as_large_again_is_the_first_line() -> None:
    """Law: the first sentence holds the factor and one example, found within three per cent, and what to do."""
    record = healthy(1.5)
    line = diagnosis_headline(record)
    assert line.startswith("Friction is 1.5 times what your URDF says at every joint: ")
    assert "has damping 24.00 ± 0.04 N m s/rad (URDF: 16)." in line
    assert first_action(record).startswith("Write these numbers into your model: `ident patch ")
    lines = told(record).splitlines()
    assert " ".join(lines[1:4]).startswith("Friction is 1.5 times")
    assert any("16 → 24.00 ± 0.04" in row and "8 → 12.00 ± 0.03" in row for row in lines)


def test_numbers_that_hold_are_no_news() -> None:
    assert describe_numbers(healthy(1.0)) == ""
    assert diagnosis_headline(healthy(1.0)).startswith("No gap")
    assert first_action(healthy(1.0)) == ""


def test_a_difference_below_noise_is_no_news_and_stands_in_the_table() -> None:
    """Law: what makes less torque than noise has no sentence, however sure it is."""
    record = healthy(1.02)
    noise = record["gap"]["elbow"]["noise_floor_Nm"]
    assert all(one.figure["change_rms_Nm"] < noise for one in numbers_of(record) if one.differs)
    assert describe_numbers(record) == ""
    assert "8 → 8.16 ± 0.03" in told(record)


@pytest.mark.parametrize("stated", [0.0, None])
def test_a_urdf_without_friction(stated: float | None) -> None:
    """Law: a simulator takes nothing as zero, so that both are said; the table keeps them apart."""
    line = diagnosis_headline(healthy(1.0, stated))
    assert line.startswith("Your URDF states no friction")
    assert ("0 → 8.00 ± 0.03" if stated == 0.0 else "– → 8.00 ± 0.03") in told(healthy(1.0, stated))


def named(stated: float | None, left: float, untuned: float = 0.0) -> dict[str, Any]:
    """The record of an arm with a named effect at the elbow, whose URDF states so much friction.

    Args:
        stated: The URDF's dry friction; that of the arm is 8 N m.
        left, untuned: What the model tuned, and untuned, errs by at the elbow [N m].
    """
    record = healthy(1.0, stated)
    record |= {"verdict": "named", "where": [{"joint": "elbow", "beyond_noise_Nm": left}]}
    gap = record["gap"]["elbow"]
    record["gap"]["elbow"] = {**gap, "rms_Nm": left, "fixed_rms_Nm": untuned}
    finding = copy.deepcopy(RECORD["findings"][0])
    finding |= {"effect": "spring_torque", "class": ["spring_torque"], "joints": ["elbow"], "probability": 0.9}
    finding |= {"action": "look at the spring", "class_shares": {}}
    finding["heldout"] |= {"rms_before_Nm": {"elbow": left}, "rms_after_Nm": {"elbow": 0.1}}
    return record | {"findings": [finding], "heldout": {}}


@pytest.mark.parametrize("stated", [0.0, None, 4.0])
@pytest.mark.parametrize(("left", "untuned", "leads"), [(1.0, 1.0, True), (1.0, 90.0, False), (90.0, 90.0, False)])
def test_friction_comes_first_where_it_is_most_of_the_error(
    stated: float | None, left: float, untuned: float, leads: bool
) -> None:
    """Law: of a URDF's friction and all that tuning leaves or hides, the larger is said first, and done first."""
    record = named(stated, left, untuned)
    line = diagnosis_headline(record)
    assert line.startswith("Most of the error: ") is leads
    assert line.endswith("eyond that, the gap has a name: spring torque in elbow.") is leads
    assert "spring torque in elbow" in line
    assert ("elbow has" in line) is leads
    orders = [first_action(record), second_action(record)]
    assert orders[0].startswith("Write these numbers") is leads
    assert "Look at the spring." in orders
    text = told(record)
    assert text.count("ook at the spring") == 1
    assert text.count("Write these numbers into your model") == leads


def test_a_urdf_whose_friction_is_right_is_no_news_beside_a_name() -> None:
    assert diagnosis_headline(named(8.0, 1.0)) == "The gap has a name: spring torque in elbow."


def test_a_mass_at_the_end_comes_before_small_effects_of_other_joints() -> None:
    """Law: with the URDF's body wrong, names of other joints are said second, and acted on if named again."""
    record = named(None, 0.02, 0.02)
    hidden = {"rms_Nm": 0.1, "noise_floor_Nm": 0.1, "fixed_rms_Nm": 4.0, "tuned_away_Nm": 3.9}
    record["gap"]["shoulder"] |= hidden
    record["where"] = [{"joint": "shoulder", "beyond_noise_Nm": 3.9}]
    body = {"issue": "body_differs", "severity": "warning", "joints": ["elbow"], "evidence": "less at its end"}
    record["telemetry"] = [{**body, "remedy": "take the hand out of the URDF"}]
    assert diagnosis_headline(record) == (
        "The gap is largest at shoulder, 3.9 N m beyond noise: a mass at the arm's end is not the URDF's. "
        "Beside it, where the model is off by 0.020 N m at most: spring torque in elbow."
    )
    text = " ".join(told(record).split())
    assert "Do: Take the hand out of the URDF; then diagnose again." in text
    assert "act on this only if it is named again" in text
    assert "ook at the spring" not in text


def test_one_joint_that_is_off_is_said_alone() -> None:
    record = healthy(1.0)
    record["identified"]["elbow"]["coulomb_Nm"] = figure(8.0, 10.0, 0.03)
    assert diagnosis_headline(record).startswith(
        "Your URDF's friction is off: elbow has dry friction 10.00 ± 0.03 N m (URDF: 8). Put right"
    )


def test_a_gain_and_an_offset_that_are_off_stand_below_the_table() -> None:
    record = healthy(1.0)
    record["identified"]["elbow"]["torque_gain"] = figure(1.0, 1.1, 0.01)
    record["identified"]["elbow"]["torque_gain"]["change_rms_Nm"] = 2.0
    record["identified"]["shoulder"]["offset_Nm"] = figure(0.0, -0.5, 0.02)
    text = told(record)
    assert "Torque gain, each as if it alone were wrong: elbow 1.100 ± 0.010." in text
    assert "Torque offset, each as if it alone were wrong: shoulder −0.50 ± 0.02 N m." in text
    record["identified"]["shoulder"]["offset_Nm"] = figure(0.0, -0.1, 0.02)
    assert "offset" not in told(record)  # it is below the noise


def test_a_wider_interval_stands_in_brackets() -> None:
    """Law: what the URDF's tolerance adds is told apart, and only where it adds much."""
    (row, _) = table_of(healthy())
    assert row["cells"]["armature_kgm2"].value == "0.600 ± 0.002"
    assert row["cells"]["armature_kgm2"].tolerant == "± 0.06"
    assert row["cells"]["coulomb_Nm"].tolerant == ""


@pytest.mark.parametrize("details", [False, True])
@pytest.mark.parametrize("verdict", ["named", "no_gap", "partial", "none_of_catalogue", "not_testable"])
def test_every_line_is_whole_and_within_the_terminal(verdict: str, details: bool) -> None:
    """Law: at 80 columns nothing is wider but a command that can't be broken, nothing is cut, no key is shown."""
    record = copy.deepcopy(RECORD) if verdict != "no_gap" else healthy(1.5)
    record["verdict"] = verdict
    for finding in record["findings"]:
        finding["class_shares"] = dict.fromkeys(finding["class"], 0.4)
        finding["action"] = "let the friction of joint_2 fall over speed, " * 5 + "as grease that has aged does it"
    for gap in record["gap"].values():
        gap["unexplained"] = "memory"
    record["reservations"] = [
        {"effect": "torque_delay", "joints": [], "reason": "the 95 % interval of lag_s holds zero", "parameters": {}}
    ]
    text = told(record, details)
    wide = [line for line in text.splitlines() if len(line) > WIDTH and "`" not in line]
    assert wide == []
    assert not CUT.search(text)
    assert KEY.findall(re.sub(r"`[^`]*`|joint_\d|tm5_900", "", text)) == []


def test_the_rest_is_folded_and_said_to_be_there() -> None:
    record = healthy(1.0)
    record["not_testable"] = [{"effect": "thermal_friction", "joints": ["elbow"], "reason": "too short"}]
    assert "too little" not in told(record)
    assert "`--details` prints what these recordings can't show" in told(record).replace("\n", " ")
    assert "thermal friction (elbow)" in told(record, details=True)


@pytest.mark.parametrize(
    ("value", "half", "shown"),
    [
        (12.0003, 0.0307, "12.00 ± 0.03"),
        (0.60682, 0.00174, "0.6068 ± 0.0017"),
        (149.6, 12.0, "150 ± 12"),
        (-0.0001, 0.02, "0.00 ± 0.02"),
    ],
)
def test_a_value_has_the_digits_that_its_error_leaves(value: float, half: float, shown: str) -> None:
    assert with_error(figure(None, value, half)) == shown


@pytest.mark.parametrize(
    ("value", "low", "high", "shown"),
    [
        (0.0, 0.0, 0.27, "0 to 0.27"),
        (0.3, 0.18, 2.0, "0.3 (0.18 to 2.0)"),
        (1.0, 0.0, 6.0, "1 (0 to 6.0)"),
        (12.0, 11.97, 12.03, "12.00 ± 0.03"),
        (0.4, -0.6, 1.4, "0.4 (0 to 1.4)"),
    ],
)
def test_what_can_t_be_negative_is_never_shown_so(value: float, low: float, high: float, shown: str) -> None:
    """Law: of friction and rotors neither an end nor a value less its ± is below zero, and zero alone is no answer."""
    ends = {"low": low, "high": high, "low_with_urdf": low, "high_with_urdf": high}
    number = Number(
        "elbow", "coulomb_Nm", "dry friction", "N m", {"value": value, "nominal": None, **ends}, False, False
    )
    assert number.value == shown
    assert number.from_zero == (low <= 0.0)


def test_the_ends_at_zero_are_said_to_be_so() -> None:
    record = healthy()
    assert MEANS_FROM_ZERO not in told(record)
    record["identified"]["elbow"]["viscous_Nms_rad"] = figure(None, 0.1, 0.3)
    text = told(record)
    assert "0.1 (0 to 0.40)" in text
    assert MEANS_FROM_ZERO in text


def test_damping_beside_a_named_law_of_friction_is_the_law_s() -> None:
    """Law: where a law of friction is named, damping that may be none is not told apart from it, and that is said."""
    record = healthy()
    record["findings"] = [{**copy.deepcopy(RECORD["findings"][0]), "effect": "stribeck_friction", "joints": ["elbow"]}]
    record["findings"][0]["class"] = ["stribeck_friction"]
    record["heldout"] = RECORD["heldout"]
    record["identified"]["elbow"]["viscous_Nms_rad"] = figure(None, 0.0, 1.8)
    (shoulder, elbow) = table_of(record)
    assert elbow["cells"]["viscous_Nms_rad"].value == IN_LAW
    assert IN_LAW not in (elbow["cells"]["coulomb_Nm"].value, shoulder["cells"]["viscous_Nms_rad"].value)
    assert describe_marks(record) == [MEANS_IN_LAW]


def test_beside_a_named_load_a_rotor_may_be_the_load_s() -> None:
    """Law: where a load is named, which is found as a point, the table says what rotors may hold of it."""
    record = healthy()
    assert MEANS_OF_LOAD not in describe_marks(record)
    record["findings"] = [{**copy.deepcopy(RECORD["findings"][0]), "effect": "payload", "joints": ["elbow"]}]
    assert (MEANS_OF_LOAD in describe_marks(record)) == ("armature_kgm2" in record["identified"]["elbow"])
    record["identified"]["elbow"]["armature_kgm2"] = figure(None, 0.1, 0.3)
    assert MEANS_OF_LOAD in describe_marks(record)


def test_noise_that_is_all_that_is_left_has_no_column() -> None:
    """Law: two columns of one figure are one, and why they are alike is said; of some joints alone it is said where."""
    record = healthy()
    for gap in record["gap"].values():
        gap["noise_floor_Nm"] = gap["rms_Nm"]
    assert "noise\n" not in told(record)
    assert "What is left is counted as noise: at no joint" in told(record)
    record["gap"]["elbow"]["noise_floor_Nm"] = 0.5 * record["gap"]["elbow"]["rms_Nm"]
    assert "noise\n" in told(record)
    assert describe_noise(record).startswith("What is left at shoulder is counted as noise: there no cause")
    record["gap"]["shoulder"]["noise_floor_Nm"] = 0.5 * record["gap"]["shoulder"]["rms_Nm"]
    assert describe_noise(record) == ""


def test_what_a_name_closes_begins_at_an_error_of_the_table() -> None:
    """Law: where tuned links hide a name, the error of the untuned ones stands beside theirs; else it has no column."""
    record = named(8.0, 0.3)
    assert "untuned" not in told(record)
    (finding,) = record["findings"]
    finding["evidence"] = {**finding.get("evidence", {}), "judged_against": "urdf"}
    for gap in record["gap"].values():
        gap["fixed_rms_Nm"] = 7.448
    text = told(record)
    header = next(line for line in text.splitlines() if line.split()[:1] == ["URDF"])
    assert header.split()[:3] == ["URDF", "untuned", "tuned"]
    assert "7.448" in text


def test_the_example_is_the_number_that_is_surest() -> None:
    """Law: the largest number, if hardly known, is no example of what is wrong."""
    record = healthy(stated=None)
    record["identified"]["shoulder"]["coulomb_Nm"] = figure(None, 11.0, 10.9)
    record["identified"]["shoulder"]["viscous_Nms_rad"] = figure(None, 30.0, 29.0)
    assert describe_numbers(record).startswith("Your URDF states no friction; elbow has")


def test_friction_that_differs_from_run_to_run_is_no_noise_in_silence() -> None:
    """Law: what no single number of friction fits is said where nothing else is left; a warm arm's spread is not."""
    record = healthy(1.5)
    for gap in record["gap"].values():
        gap["noise_floor_Nm"] = gap["rms_Nm"]
    steady = told(record)
    record["gap"]["shoulder"]["friction_spread"] = 0.01
    record["gap"]["elbow"]["friction_spread"] = 0.02
    assert told(record) == steady
    record["gap"]["elbow"]["friction_spread"] = 0.325
    record["gap"]["elbow"] |= {"rms_Nm": 4.2, "noise_floor_Nm": 4.2}
    line = diagnosis_headline(record)
    assert "friction still differs from run to run, by 32 % at elbow; 4.2 N m are left there" in line
    assert "noise" not in line
    assert "the friction of elbow changes" in second_action(record)
    for joint in ("elbow", "shoulder"):
        record["leftover"] = {joint: 0.3}
        assert ("by 32 % at elbow" in diagnosis_headline(record)) is (joint == "elbow")
        assert ("30 % an unnamed cause at shoulder" in diagnosis_headline(record)) is (joint == "shoulder")
    del record["leftover"]
    assert "by 32 % (standard deviation) at elbow" in describe_noise(record)


@pytest.mark.parametrize("factor", [1.0, 1.5])
def test_a_link_beyond_what_urdfs_are_off_by_is_no_gap_in_silence(factor: float) -> None:
    """Law: what tuning had to do to a link is said where nothing else is left, whatever friction is."""
    record = healthy(factor)
    before = told(record)
    moment = {"value": 0.5, "low": 0.4, "high": 0.6}
    small = {"value": 0.01, "low": 0.0, "high": 0.02}
    record["tuned_links"] = {
        "upper": {"joint": "shoulder", "beyond_tolerance": False, "moment_kgm": {"x": moment}},
        "lower": {"joint": "elbow", "beyond_tolerance": True, "moment_kgm": {"x": small}},
        "hand": {"joint": "wrist", "beyond_tolerance": True, "moment_kgm": {}, "about_axis_kgm": moment},
    }
    for name in ("lower", "hand"):
        reason = f"{name} is off by more than URDFs are: tuning moved its moment"
        record.setdefault("reservations", []).append({"effect": None, "joints": [], "reason": reason, "parameters": {}})
    assert "hand is off by more than URDFs are" in diagnosis_headline(record)
    assert second_action(record).startswith("hand is off by more than URDFs are: tuning moved")
    assert first_action(record).startswith("Write these numbers")
    record["gap"]["elbow"]["friction_spread"] = 0.4
    assert "hand is off" not in diagnosis_headline(record) + second_action(record)
    del record["gap"]["elbow"]["friction_spread"]
    record["tuned_links"]["hand"]["beyond_tolerance"] = False
    record["tuned_links"]["lower"]["beyond_tolerance"] = False
    record["reservations"] = []
    assert told(record) == before


def test_a_command_is_not_broken_over_lines() -> None:
    command = "`plan excite --robot my_arm.urdf --separate spring_torque,payload --joint elbow`"
    lines = wrap(f"record this to tell them apart: {command}, then 4.45 N m more", 40).splitlines()
    assert any(command in line for line in lines)
    assert "4.45 N m" in wrap("aaaa bbbb cccc dddd eeee ffff gggg 4.45 N m more", 38).replace("\n", "|")


def test_a_factor_is_said_once() -> None:
    """Law: what the headline begins with stands in no warning above it; any other warning does."""
    reading = "elbow reads 0.89 ± 0.03 times the model's gravity torque"
    scale = {"issue": "torque_scale", "joints": ["elbow"], "evidence": f"log: {reading}", "remedy": "check its gain"}
    gains = {"issue": "guessed_gains", "joints": ["elbow"], "evidence": "log: the drive gains are guesses"}
    record = {"verdict": "no_gap", "telemetry": [scale, gains]}
    assert untold_issues(record, "elbow reads 0.89 ± 0.03 times the model's gravity torque.") == [gains]
    assert untold_issues(record, "The gap has a name: payload felt at elbow.") == [scale, gains]


def test_factors_that_neither_headline_nor_action_has_are_printed() -> None:
    """Law: where the first action is about a body, the factors of the joints after the first stand in the warning."""
    record = acted_on("link_inertial_error", 0.97, {**SCALE, "joints": ["elbow", "wrist"]})
    record |= {"joints": ["shoulder", "elbow", "wrist"], "where": [{"joint": "elbow"}]}
    (issue,) = record["telemetry"]
    assert first_action(record) == "Do so."
    assert untold_issues(record, diagnosis_headline(record)) == [issue]


def test_what_tolerance_may_explain_is_not_said_to_be_wrong() -> None:
    """Law: a number matters by the least that it is off within its interval, not by its likeliest value."""
    record = healthy(1.0)
    gain = {**figure(1.0, 0.87, 0.006), "high_with_urdf": 0.998, "change_rms_Nm": 2.0}
    record["identified"]["elbow"]["torque_gain"] = gain
    assert sure_change(gain) == pytest.approx(2.0 * 0.002 / 0.13)
    assert "gain" not in told(record)
    gain["high_with_urdf"] = 0.93
    assert "elbow 0.870 ± 0.006 (± 0.06)." in told(record)


def test_an_effect_of_the_whole_arm_is_in_no_joint() -> None:
    """Law: a payload hangs at the flange: its joints are where it shows."""
    assert place_words("payload", ["elbow"]) == " felt at elbow"
    assert place_words("coulomb_friction", ["elbow"]) == " in elbow"
    assert place_words("payload", ["a", "b", "c", "d"]) == ""


@pytest.mark.parametrize("record", [None, Path("-"), Path("out/why 1.json")], ids=str)
@pytest.mark.parametrize(
    "options",
    [DiagnoseOptions(), DiagnoseOptions(topic="/arm/states", session_file=Path("s.toml"), accept=("mounting",))],
    ids=["as usual", "read otherwise"],
)
def test_the_command_that_is_proposed_is_one_with_the_names_of_this_run(
    record: Path | None, options: DiagnoseOptions
) -> None:
    """Law: what stands between the marks is taken by `ident patch` as it is, and reads what was diagnosed."""
    told = patch_call("my arm.urdf:left", [Path("log 1"), Path("log_2")], record, options)
    words = shlex.split(told.split("`")[1])
    command = typer.main.get_command(app).commands["patch"]  # type: ignore[attr-defined]
    given = command.make_context("patch", words[2:], resilient_parsing=False).params
    assert words[:2] == ["ident", "patch"]
    assert given["robot"] == "my arm.urdf:left"
    assert list(map(str, given["on"])) == ["log 1", "log_2"]
    assert given["topic"] == options.topic
    assert str(given["session_file"]) == str(options.session_file)
    assert list(given["accept"] or ()) == list(options.accept)
    is_written = record == Path("out/why 1.json")
    assert str(given["diagnosis"]) == ("out/why 1.json" if is_written else "why.json")
    assert ("`--json why.json`" in told) is not is_written
