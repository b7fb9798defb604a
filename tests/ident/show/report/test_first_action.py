"""What a diagnosis says first: a torque that is off by a factor outranks every name but the one that explains it."""

from __future__ import annotations

from typing import Any

import pytest

from ident.show.report.diagnosis_verdict import first_action

SCALE = {
    "issue": "torque_scale",
    "joints": ["elbow"],
    "severity": "warning",
    "evidence": "elbow reads 1.32 ± 0.05 of the model's gravity torque",
    "remedy": "check its drive gain",
}


def record(effect: str, probability: float, *telemetry: dict[str, Any]) -> dict[str, Any]:
    finding = {"effect": effect, "joints": ["elbow"], "class": [effect], "probability": probability, "action": "do so"}
    return {"verdict": "named", "findings": [finding], "telemetry": list(telemetry), "gap": {}}


def test_without_it_the_first_name_comes_first() -> None:
    assert first_action(record("stribeck_friction", 0.97)) == "Do so."


@pytest.mark.parametrize("effect", ["stribeck_friction", "load_dependent_friction"])
def test_a_factor_comes_before_friction(effect: str) -> None:
    assert first_action(record(effect, 0.97, SCALE)).startswith("elbow reads 1.32")


@pytest.mark.parametrize("effect", ["payload", "torque_gain_error"])
def test_a_likely_name_of_the_factor_comes_in_its_place(effect: str) -> None:
    assert first_action(record(effect, 0.97, SCALE)) == "Do so."
    assert first_action(record(effect, 0.30, SCALE)).startswith("elbow reads 1.32")
