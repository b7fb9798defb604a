"""Laws of labels, decision rules and paired comparisons."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_up_corpus import candidate, entry, truth, write_result

from ident.benchmark.corpus import Truth
from ident.benchmark.corpus_table import FINDING, load_table, store
from ident.benchmark.labels import RIGHT, UNKNOWN, WRONG, Name, label
from ident.benchmark.outcomes import SessionOutcome, apply_rule
from ident.benchmark.paired import CRITERIA, compare, is_compared
from ident.benchmark.score_table import score

SPRING = truth("spring_torque", "joint_2", stiffness_Nm_rad=3.0)


def named(effect: str, joint: str, **changes: Any) -> Name:
    return Name.of_candidate(candidate(effect, joint, **changes))


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        (named("spring_torque", "joint_2"), RIGHT),
        (named("spring_torque", "joint_1"), WRONG),
        (named("torque_ripple", "joint_2", **{"class": ["torque_ripple", "spring_torque"]}), RIGHT),
        (named("torque_ripple", "joint_1", **{"class": ["torque_ripple", "spring_torque"]}), WRONG),
        (named("torque_ripple", "joint_1", **{"class": ["spring_torque:joint_2"]}), RIGHT),
        (named("spring_torque", "joint_1", other="joint_2"), RIGHT),
        (named("torque_ripple", "joint_2"), WRONG),
    ],
)
def test_a_name_is_right_by_its_class_at_a_joint_where_it_may_stand(name: Name, expected: str) -> None:
    assert label(name, entry("other/case", SPRING)) == expected


def test_a_name_of_the_whole_arm_is_right_where_it_shows() -> None:
    whole = Truth("payload", True, ("joint_2", "joint_3"), ("joint_2", "joint_3"))
    session = entry("other/case", whole)
    at_2 = Name.of_candidate({"effect": "payload", "joint": None, "joints": ["joint_2"], "class": []})
    at_1 = Name.of_candidate({"effect": "payload", "joint": None, "joints": ["joint_1"], "class": []})
    assert label(at_2, session) == RIGHT
    assert label(at_1, session) == WRONG


def test_what_an_arm_has_untouched_is_neither_right_nor_wrong() -> None:
    session = entry("real/case", SPRING, control="real/control")
    name = named("torque_ripple", "joint_1")
    assert label(name, session, [named("torque_ripple", "joint_1")]) == UNKNOWN
    assert label(name, session, [named("torque_ripple", "joint_3")]) == WRONG


def test_what_others_measured_on_an_arm_is_neither_right_nor_wrong() -> None:
    session = entry("real/case", SPRING, arm="kr300")
    assert label(named("spring_torque", "a2"), session) == UNKNOWN
    assert label(named("spring_torque", "a3"), session) == WRONG


def outcomes_of(folder: Path, probability: float, rival: float = 0.1) -> dict[str, SessionOutcome]:
    """Two sessions with a spring, a healthy one and one untouched, each with two candidates."""
    folder.mkdir()
    figures = {"stiffness_Nm_rad": {"value": 3.1, "low": 2.8, "high": 3.4}}
    entries = [
        entry("other/case_0", SPRING),
        entry("real/case_1", SPRING, control="real/control"),
        entry("other/case_2", kind="healthy"),
        entry("real/control", kind="control"),
        entry("real/case_3", kind="untouched", control="real/control"),
    ]
    for session in entries:
        there = probability if session.truth else 0.01
        rows = [
            candidate("spring_torque", "joint_2", parameters=figures, features={"p": there}),
            candidate(
                "torque_ripple",
                "joint_1",
                features={"p": rival if session.kind != "control" else 0.01},
            ),
        ]
        write_result(folder / "results", session.case, *rows, verdict="named" if session.truth else "no_gap")
    store(entries, folder / "results", folder / "table")
    table = load_table(folder / "table")
    return apply_rule(table, table.matrix(["p"])[:, 0])


def test_a_perfect_rule_names_all_that_is_there_and_nothing_else(tmp_path: Path) -> None:
    outcomes = outcomes_of(tmp_path / "a", 0.9)
    assert all(outcome.good for outcome in outcomes.values())
    assert outcomes["other/case_0"].f1 == 1.0


def test_a_rule_that_names_a_rival_is_wrong_everywhere_but_on_the_control(tmp_path: Path) -> None:
    outcomes = outcomes_of(tmp_path / "a", 0.9, rival=0.8)
    assert {case for case, outcome in outcomes.items() if outcome.wrong} == set(outcomes) - {"real/control"}


def test_a_table_compared_with_itself_wins_and_loses_nothing(tmp_path: Path) -> None:
    outcomes = outcomes_of(tmp_path / "a", 0.9)
    record = compare(outcomes, outcomes)
    for word in CRITERIA:
        assert record[word]["won"] == record[word]["lost"] == []
    assert record["seconds"]["median after over before"] == 1.0


def test_sides_of_a_comparison_change_places(tmp_path: Path) -> None:
    silent, telling = outcomes_of(tmp_path / "a", 0.3), outcomes_of(tmp_path / "b", 0.9)
    there, back = compare(silent, telling), compare(telling, silent)
    assert there["single named"]["won"] == ["other/case_0", "real/case_1"]
    assert there["single named"]["won"] == back["single named"]["lost"]
    assert there["single named"]["p"] == back["single named"]["p"]


def test_effects_that_hardly_show_are_not_compared(tmp_path: Path) -> None:
    """Nor are untouched recordings that others are judged against."""
    outcomes = outcomes_of(tmp_path / "a", 0.9)
    spring = outcomes["other/case_0"]
    tiny = replace(spring.session, truths=({**spring.session.truths[0], "asked": 0.3},))
    assert is_compared(spring, ("single",))
    assert not is_compared(replace(spring, session=tiny), ("single",))
    assert not is_compared(outcomes["real/control"], ())


def test_scores_count_what_the_outcomes_say(tmp_path: Path) -> None:
    folder = tmp_path / "a"
    outcomes = outcomes_of(folder, 0.9)
    record = score(load_table(folder / "table"), outcomes)
    assert record["all"]["single 3x class"]["value"] == 1.0
    assert record["by unit"]["other:made"] == {"value": 1.0, "low": 0.342, "high": 1.0, "count": 2}
    assert record["by effect"]["spring_torque"]["count"] == 2
    assert record["real"]["single 3x class"]["count"] == 1
    assert record["all"]["untouched new name"]["value"] == 0.0
    assert record["intervals"]["spring_torque.stiffness_Nm_rad"]["inside"]["value"] == 1.0
    assert record["intervals"]["spring_torque.stiffness_Nm_rad"]["median half-width"] == pytest.approx(0.1)


def test_one_thing_is_named_once(tmp_path: Path) -> None:
    """Of two candidates of one class the less probable one says nothing new."""
    session = entry("other/case", SPRING)
    rows = [
        candidate("spring_torque", "joint_2", features={"p": 0.9}),
        candidate(
            "torque_ripple",
            "joint_2",
            features={"p": 0.8},
            **{"class": ["torque_ripple", "spring_torque"]},
        ),
        candidate("torque_ripple", "joint_3", features={"p": 0.6}),
    ]
    write_result(tmp_path / "results", session.case, *rows)
    store([session], tmp_path / "results", tmp_path / "table")
    table = load_table(tmp_path / "table")
    outcome = apply_rule(table, table.matrix(["p"])[:, 0])["other/case"]
    assert [table.rows[name.row]["joint"] for name in outcome.said] == ["joint_2", "joint_3"]
    assert outcome.wrong


def test_findings_are_rows_of_their_own(tmp_path: Path) -> None:
    session = entry("other/case", SPRING)
    finding = {
        "effect": "spring_torque",
        "joints": ["joint_2"],
        "probability": 0.7,
        "class": ["spring_torque"],
    }
    write_result(tmp_path / "results", session.case, diagnosis={"findings": [finding]})
    store([session], tmp_path / "results", tmp_path / "table")
    table = load_table(tmp_path / "table", FINDING)
    assert np.array_equal(table.probability, [0.7])
    assert apply_rule(table, table.probability)["other/case"].good
