"""Scores of semi-real cases are relative to what the untouched recordings are told."""

from __future__ import annotations

from typing import Any

import pytest

from ident.benchmark.real_check import rows_of, score, tables


def _finding(effect: str, joint: str, p: float = 0.9, **more: Any) -> dict[str, Any]:
    return {"effect": effect, "class": [effect], "joints": [joint], "probability": p, "parameters": {}, **more}


def _answer(kind: str, *effects: dict[str, Any]) -> dict[str, Any]:
    return {"kind": kind, "arm": "a", "control": "control", "effects": list(effects)}


PLANTED = {
    "effect": "spring_torque",
    "asked": 3.0,
    "in_catalogue": True,
    "joints": ["j2"],
    "may_stand_at": ["j2"],
    "parameters": {"stiffness_Nm_rad": 2.0, "other_joint": "j1"},
}
CONTROL = {"diagnosis": {"verdict": "partial", "findings": [_finding("stribeck_friction", "j1")]}}


def _rows(kind: str, findings: list[dict[str, Any]], *effects: dict[str, Any]) -> Any:
    told = {"control": CONTROL, "case": {"diagnosis": {"verdict": "named", "findings": findings}}}
    return rows_of({"control": _answer("control"), "case": _answer(kind, *effects)}, told)


def test_a_name_that_the_untouched_arm_has_is_none() -> None:
    for findings, alarm in ([_finding("stribeck_friction", "j1")], 0.0), ([_finding("payload", "j1")], 1.0):
        assert score(*_rows("untouched", findings))["scores"]["false_alarm"] == alarm


@pytest.mark.parametrize(
    ("finding", "named", "strict"),
    [
        (_finding("spring_torque", "j2"), 1.0, 1.0),
        (_finding("spring_torque", "j1"), 0.0, 0.0),
        (_finding("spring_torque", "j2", 0.4), 0.0, 0.0),
        (_finding("spring_torque", "j2", 0.4, class_probability=0.6), 1.0, 1.0),
        (_finding("torque_offset", "j2", **{"class": ["torque_offset", "spring_torque"]}), 1.0, 0.0),
    ],
)
def test_the_planted_effect_is_found_in_the_class_at_its_joint(finding: Any, named: float, strict: float) -> None:
    found = score(*_rows("single", [finding], PLANTED))["scores"]
    assert (found["class_aware"], found["strict"]) == (named, strict)


@pytest.mark.parametrize(("high", "inside"), [(2.5, 1.0), (1.9, 0.0)])
def test_intervals_are_held_against_what_was_planted(high: float, inside: float) -> None:
    figures = {"stiffness_Nm_rad": {"value": 1.8, "low": 1.0, "high": high}}
    rows = _rows("single", [_finding("spring_torque", "j2", parameters=figures)], PLANTED)
    assert score(*rows)["scores"]["interval_coverage"] == inside
    assert any("spring_torque" in line for line in tables(*rows))
