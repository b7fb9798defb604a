"""The page of a diagnosis, made from the contract's record alone."""

import copy
import json
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from ident.regression.discrepancy import BLOCKS
from ident.show.diagnosis_lines import describe_gap, print_diagnosis
from ident.show.report.diagnosis_actions import first_action
from ident.show.report.diagnosis_doubts import describe_reservations
from ident.show.report.diagnosis_pages import gap_rows, map_table, write_diagnosis_report
from ident.show.report.diagnosis_verdict import diagnosis_headline
from ident.show.report.evaluation import ReportInput
from ident.show.report.numbers import LOSSES, READINGS
from ident.show.report.words import parameter_rows, with_units
from tests.accessible import tables_cut
from tests.ident.show.report.reader import read

# A desk's screen, less the bar that scrolls [px].
DESK = 1185
RECORD: dict[str, Any] = {
    "schema": "ident.diagnosis/1",
    "robot": "tm5_900",
    "joints": ["joint_1", "joint_2"],
    "session": {"runs": 10, "samples": 31240, "duration_s": 124.9},
    "telemetry": [
        {"issue": "jitter", "joints": [], "severity": "note", "evidence": "3 % of the interval", "remedy": "resampled"}
    ],
    "verdict": "named",
    "gap": {
        "joint_1": {"rms_Nm": 0.5, "noise_floor_Nm": 0.4, "ceiling_rms_Nm": 0.41,
            "energy_error_J": {"mean": -0.2, "std": 0.1}},
        "joint_2": {"rms_Nm": 1.1, "noise_floor_Nm": 0.4, "ceiling_rms_Nm": 0.45,
            "energy_error_J": {"mean": -1.2, "std": 0.4}},
    },
    "where": [
        {"joint": "joint_2", "axis": "speed", "low": 0.0, "high": 0.2, "share_of_gap": 0.71, "p_value": 0.001},
        {"joint": "joint_1", "axis": "load", "low": 5.0, "high": 9.0, "share_of_gap": 0.3, "p_value": 0.4},
    ],
    "findings": [
        {
            "effect": "stribeck_friction", "joints": ["joint_2"], "probability": 0.97,
            "class": ["stribeck_friction", "nonlinear_viscous_friction"],
            "parameters": {"stribeck_velocity_rad_s": {"value": 0.08, "low": 0.06, "high": 0.11}},
            "heldout": {
                "rms_before_Nm": {"joint_2": 1.1}, "rms_after_Nm": {"joint_2": 0.47},
                "energy_error_before_J": -3.1, "energy_error_after_J": -0.2, "shrink": 0.93,
            },
        }
    ],
    "heldout": {"rms_before_Nm": {"joint_2": 1.1}, "rms_after_Nm": {"joint_2": 0.47}, "shrink": 0.93},
    "not_testable": [{"effect": "thermal_friction", "joints": ["joint_1"], "reason": "too short"}],
    "next_experiment": {"separates": ["stribeck_friction", "torque_delay"], "motion": "slow sweeps", "minutes": 4},
}  # fmt: skip


def written(path: Path, record: dict[str, Any], evaluation: ReportInput | None = None) -> str:
    return read(write_diagnosis_report(path / "d.html", record, evaluation).read_text(encoding="utf-8")).text


def test_page_tells_the_whole_record(tmp_path: Path) -> None:
    """Effect, joint, probability, twin, parameter with interval, before and after, place, reason, next motion."""
    text = written(tmp_path, json.loads(json.dumps(RECORD)))
    for seen in (
        "The gap has a name: Stribeck friction in joint_2.",
        "closes 93 % of what can be closed",
        "Probability 97 %",
        "can't tell it from nonlinear viscous friction",
        "0.0600 to 0.110",
        "joint_2 1.1 → 0.47 N m",
        "−3.10 → −0.20 J",
        "71 %",
        "too short",
        "slow sweeps (4 min). It tells Stribeck friction and torque delay apart.",
        "3 % of the interval",
    ):
        assert seen in text


def test_a_joint_that_slides_is_of_forces_and_metres(tmp_path: Path) -> None:
    """Law: its card, its place and its torque are; those of joints that turn are as ever."""
    record = json.loads(json.dumps(RECORD))
    record["gap"]["joint_2"]["unit"] = "N"
    silent = {"effect": "backlash", "joints": ["joint_2"], "reason": "load never changes sign (520 to 631 N m)"}
    record["not_testable"] = [silent]
    text = written(tmp_path, record)
    words = ("joint_2 1.1 → 0.47 N;", "0.20 m/s", "[N m; of joints that slide N]", "(520 to 631 N)")
    assert all(seen in text for seen in words)
    assert "rad/s" not in text.partition("Units: SI")[0]  # the foot names the units of both kinds
    tilt = {"effect": "gravity_misalignment", "parameters": {"tilt_x_rad": {"value": 0.02, "low": 0.01, "high": 0.03}}}
    record["findings"][0] |= tilt
    assert "0.0100 to 0.0300rad" in written(tmp_path, record)  # of the whole arm, though it shows where one slides


@pytest.mark.parametrize(
    ("verdict", "words"),
    [("no_gap", "No gap"), ("none_of_catalogue", "no effect of the catalogue"), ("not_testable", "can't tell")],
)
def test_page_without_findings(tmp_path: Path, verdict: str, words: str) -> None:
    """Every verdict has a page, with or without findings; keys that are empty are no error."""
    bare = {"schema": RECORD["schema"], "robot": "tm5_900", "joints": ["joint_1"], "verdict": verdict}
    assert words in written(tmp_path, bare)
    assert "What causes it" not in written(tmp_path, bare)


def test_names_of_the_lesser_part_do_not_stand_below_a_gap_without_any() -> None:
    record = {**copy.deepcopy(RECORD), "verdict": "none_of_catalogue"}
    assert "Most of the gap is unexplained" in diagnosis_headline(record)
    assert "Stribeck friction" in diagnosis_headline(record)
    assert "no effect of the catalogue" in diagnosis_headline({**record, "findings": []})


def test_where_no_gap_is_told_a_doubt_is_told_as_well() -> None:
    """Law: what may be left at a joint, less likely than not, stands beside "no gap"; hardly likely, it does not."""
    record = {
        **copy.deepcopy(RECORD),
        "verdict": "no_gap",
        "findings": [],
        "leftover": {"joint_1": 0.1, "joint_2": 0.4},
    }
    assert diagnosis_headline(record).endswith("With 40 % an unnamed cause is left at joint_2.")
    assert "unnamed" not in diagnosis_headline({**record, "leftover": {"joint_1": 0.1, "joint_2": 0.1}})


def test_a_card_is_called_as_the_first_line_has_it(tmp_path: Path) -> None:
    """Law: a name that is less likely than not heads its card with those of its class, and how likely they are."""
    record = copy.deepcopy(RECORD)
    record["findings"][0] |= {"probability": 0.48, "class_probability": 0.93}
    words = "Stribeck friction or nonlinear viscous friction in joint_2 (93 %)"
    assert words in diagnosis_headline(record)
    assert f"1. {words}" in written(tmp_path, record).replace("\xa0", " ")


def test_names_that_leave_more_than_there_was_close_nothing(tmp_path: Path) -> None:
    """Law: a share below zero is none: names that improve one joint may leave a little more at the others."""
    record = copy.deepcopy(RECORD)
    record["heldout"]["shrink"] = -0.43
    assert "all names close nothing of what can be closed." in written(tmp_path, record).replace("\xa0", " ")


def test_names_that_one_reason_speaks_against_stand_in_one_line() -> None:
    doubt = {"effect": "spring_torque", "reason": "mu holds zero", "parameters": {}}
    record = {"reservations": [{**doubt, "joints": [joint]} for joint in ("elbow", "wrist")]}
    (line,) = describe_reservations(record)
    assert line.startswith("Not believed: spring torque in elbow and wrist would fit, but ")
    for one, found in zip(record["reservations"], ("it grows", "it falls"), strict=True):
        one["reason"] = f"{found}: no spring does"
    (line,) = describe_reservations(record)
    assert line.endswith(
        "though they would fit: spring torque in elbow and wrist. Of the first, it grows: no spring does."
    )
    (line,) = describe_reservations({"reservations": record["reservations"][:1]})
    assert line == "Not believed: spring torque in elbow would fit, but it grows: no spring does."


def test_a_gap_without_a_name_says_what_speaks_for_it(tmp_path: Path) -> None:
    """What tuning hides stands under the verdict."""
    record = {**copy.deepcopy(RECORD), "verdict": "none_of_catalogue", "findings": []}
    record["gap"]["joint_2"]["tuned_away_Nm"] = 1.25
    text = written(tmp_path, record).replace("\xa0", " ")
    assert "what they hide acts most on joint_2" in text
    assert "no effect of the catalogue explains it" in text


def test_first_action_is_about_most_of_the_gap(tmp_path: Path) -> None:
    """Not of a name that closes little: rather of inertias beyond their tolerance, or of too few recordings."""
    record = {**copy.deepcopy(RECORD), "verdict": "none_of_catalogue"}
    record["findings"][0]["action"] = "look at the gear"
    assert first_action({**record, "verdict": "named"}) == "Look at the gear."
    assert first_action(record).startswith("Record this next: ")
    record["findings"][0]["probability"] = 0.48
    tied = first_action({**record, "verdict": "named"})
    assert tied.startswith(
        "Act on none yet, for it may be Stribeck friction or nonlinear viscous friction in joint_2; record"
    )
    record["gap"]["joint_2"]["tuned_away_Nm"] = 1.25
    for verdict in (record["verdict"], "named"):  # a doubt outranks a name of 48 %
        assert "fit the arm's own inertias" in first_action({**record, "verdict": verdict})
    record["gap"]["joint_2"]["fixed_rms_Nm"] = 0.2 * record["gap"]["joint_2"]["rms_Nm"]
    assert first_action(record).startswith("Record this again")
    text = written(tmp_path, record).replace("\xa0", " ")
    assert "further off on the rest than as it was given (joint_2: " in text
    assert "(ident fit)" in text


def test_a_terminal_shows_brackets_and_what_a_gap_follows(capsys: pytest.CaptureFixture[str]) -> None:
    doubt = {"effect": "", "joints": [], "reason": "knee 0.6 rad/s [open]"}
    gap = {kind: {**RECORD["gap"]["joint_2"], "unexplained": kind} for kind in BLOCKS}
    record = {**RECORD, "findings": [], "gap": gap, "reservations": [doubt]}
    print_diagnosis(Console(width=80), record, details=True)
    told = capsys.readouterr().out
    assert ("[open]" in told, told.count("What is left at")) == (True, len(BLOCKS))
    same = {**RECORD["gap"]["joint_2"], "unexplained": "state", "ceiling_rms_Nm": 0.5}
    assert "depends on" not in describe_gap("joint_2", same, 0.5)  # nothing is left to follow anything


def test_doubts_tell_figures_by_words_and_units() -> None:
    """Keys of figures become words, numbers get their units; other words with underscores stay."""
    text = with_units("wrist_2 would fit, but com_x_m -6.84 lies outside -0.48 to 0.48")
    assert text == "wrist_2 would fit, but com x −6.84 m lies outside −0.48 to 0.48"
    assert with_units("hides mass_change_kg below 78") == "hides mass change below 78 kg"
    assert with_units("the interval of mu holds zero") == "the interval of friction per load holds zero"
    assert with_units("the 95 % interval of stiffness_Nm_rad holds zero") == "the 95 % interval of stiffness holds zero"


def test_refusal_shows_the_remedy_first(tmp_path: Path) -> None:
    """A refused session's fatal issue and its remedy stand right under the verdict."""
    record = {**copy.deepcopy(RECORD), "verdict": "refused", "findings": [], "gap": {}, "where": []}
    record["telemetry"][0] |= {"severity": "fatal", "remedy": "set effort_sign"}
    text = written(tmp_path, record)
    text = text[text.index("Refused") :]
    assert text.index("set effort_sign") < text.index("Recordings:") < text.index("slow sweeps")


def test_an_evaluation_is_added(source: ReportInput, tmp_path: Path) -> None:
    """Its sections follow, and no section stands twice."""
    reader = read(write_diagnosis_report(tmp_path / "d.html", RECORD, source).read_text(encoding="utf-8"))
    assert len(reader.ids) == len(set(reader.ids))
    assert {"findings", "ladder", "fits"} <= set(reader.ids)


def test_page_tells_how_far_the_motion_nears(tmp_path: Path) -> None:
    """The replay is reported in mrad for the named joint; what else is known of each stands in the table."""
    forward = {"window_s": 0.25, "position_rms_rad": {"before": {"joint_2": 5.86e-3}, "after": {"joint_2": 1.12e-3}}}
    further = {
        "forward": forward,
        "energy_error_after_J": {"joint_2": -0.17},
    }
    gap = {**RECORD["gap"], "joint_2": {**RECORD["gap"]["joint_2"], "fixed_rms_Nm": 1.33, "ceiling_rms_Nm": 0.61}}
    text = written(tmp_path, {**RECORD, "gap": gap, "heldout": {**RECORD["heldout"], **further}})
    assert "is off after 250 ms by [mrad]: joint_2 5.9 → 1.1." in text.replace("\u00a0", " ")
    for seen in ("0.61", "1.33", "−0.17", "inertias of the URDF, friction tuned"):
        assert seen in text


def test_what_is_zero_but_for_rounding_is_no_parameter() -> None:
    flat = {key: {"value": 1e-17, "low": 0.0, "high": 1e-14} for key in ("stiffness_Nm_rad", "rest_rad", "low_Nm")}
    assert [row["name"] for row in parameter_rows(flat)] == ["torque at the lower end"]


def test_what_tuning_made_worse_is_shown_beside_what_it_left(tmp_path: Path) -> None:
    """Law: a joint's bars begin before tuning where that erred less, or hides a named effect, and only there."""
    record = copy.deepcopy(RECORD)
    for rms, shown in ((0.9, True), (1.3, False)):
        record["gap"]["joint_2"]["fixed_rms_Nm"] = rms
        first, second = gap_rows(record)
        assert (first["bars"]["untuned"], second["bars"]["untuned"] is not None) == (None, shown)
        assert ("or made it worse" in written(tmp_path, record)) is shown
    record["findings"][0]["evidence"] = {"judged_against": "urdf"}
    assert gap_rows(record)[1]["bars"]["untuned"] == 100.0


def test_the_slowest_frequencies_are_no_place() -> None:
    """Law: however little it is by chance, a gap's share of the slowest band is not outlined; of the next it is."""
    ends = {"edges": [0.0, 1.0, 5.0], "share_of_gap": [0.7, 0.3], "share_of_time": [0.2, 0.1], "p_value": [0.01, 0.01]}
    for axis, outlined in (("frequency", [False, True]), ("speed", [True, True])):
        strip = {"joint": "joint_2", "axis": axis, "energy_J": [None, None], **ends}
        (row,) = map_table([strip], ["joint_1", "joint_2"])["rows"]
        assert [cell["sure"] for cell in row["strips"][0]["cells"]] == outlined


def test_what_a_result_was_made_with_is_told_without_rounding_s_digits(tmp_path: Path) -> None:
    record = {**RECORD, "provenance": {"settings": {"cutoff_hz": 11.999999999999998}}}
    assert "11.99" not in written(tmp_path, record)


def test_session_time_counts_from_its_start(tmp_path: Path) -> None:
    """A clock of seconds since 1970 has too many digits for a cell."""
    record = copy.deepcopy(RECORD)
    place = {"joint": "joint_2", "axis": "time", "low": 1.7e9 + 20.0, "high": 1.7e9 + 40.0}
    record["where"] = [{**place, "share_of_gap": 0.71, "p_value": 0.001}]
    record["provenance"] = {"sessions": [{"path": "a", "sha256": "", "first": 1.7e9, "last": 1.7e9 + 90.0, "runs": []}]}
    assert "at session time 20 to 40 s" in written(tmp_path, record)


@pytest.mark.parametrize(("value", "shown"), [(-8.94e-5, "0"), (0.0, "0"), (8.4e-3, "0.00840"), (0.84, "0.840")])
def test_what_a_solver_left_of_zero_is_shown_as_zero(value: float, shown: str) -> None:
    """Law: of an interval of 1.7 nobody reads a ten-thousandth."""
    (row,) = parameter_rows({"coulomb_change_Nm": {"value": value, "low": -0.842, "high": 0.842}})
    assert row["value"] == shown


def test_tables_are_whole_where_joints_have_long_names(tmp_path: Path) -> None:
    """Law: on a desk's screen nothing is to be scrolled sideways, however long names and intervals are."""
    name = "left_arm_shoulder_pan_joint_of_the_robot"
    interval = {"low": 0.0, "high": 0.0018, "low_with_urdf": 0.0, "high_with_urdf": 0.0041, "change_rms_Nm": 9.0}
    numbers = {key: {"nominal": 0.123456, "value": 0.000213, **interval} for key in (*LOSSES, *READINGS)}
    text = json.dumps(copy.deepcopy(RECORD)).replace('"joint_1"', f'"{name}"')
    record = json.loads(text) | {"identified": {name: numbers, "links": {}}}
    page = write_diagnosis_report(tmp_path / "long.html", record)
    assert tables_cut(page, tmp_path, DESK) == []
