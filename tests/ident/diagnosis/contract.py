"""A checker of the diagnosis's JSON against what was promised: keys, types, ranges."""

from __future__ import annotations

from collections.abc import Mapping
from numbers import Real
from typing import Any

from tests.schemas import check_record

VERDICTS = {"no_gap", "named", "partial", "none_of_catalogue", "not_testable", "refused"}
AXES = {"speed", "direction", "load", "position", "reversal", "frequency", "time", "temperature", "pose"}
SEVERITIES = {"note", "warning", "fatal"}


def number(value: Any) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool)


def figures(table: Mapping[str, Any], *keys: str) -> bool:
    return all(number(table[key]) for key in keys)


def check_diagnosis(record: dict[str, Any]) -> dict[str, Any]:
    """Passes a record that is as the contract says, after a round through strict JSON; returns that."""
    record = check_record(record)
    assert record["schema"] == "ident.diagnosis/1"
    assert isinstance(record["robot"], str)
    joints = record["joints"]
    assert joints
    assert all(isinstance(name, str) for name in joints)
    assert figures(record["session"], "runs", "samples", "duration_s")
    assert record["verdict"] in VERDICTS
    for issue in record["telemetry"]:
        assert issue["severity"] in SEVERITIES
        assert set(issue["joints"]) <= set(joints)
        assert all(isinstance(issue[key], str) and issue[key] for key in ("issue", "evidence", "remedy"))
    for joint, gap in record["gap"].items():
        assert joint in joints
        assert figures(gap, "rms_Nm", "noise_floor_Nm", "ceiling_rms_Nm")
        energy = gap["energy_error_J"]
        assert figures(energy, "mean")
        assert figures(energy, "std") if record["session"]["runs"] > 1 else energy["std_missing"]
    for place in record["where"]:
        assert place["joint"] in joints
        assert place["axis"] in AXES
        assert figures(place, "low", "high", "share_of_gap", "p_value")
        assert 0.0 < place["p_value"] <= 1.0
    check_places(record)
    for finding in record["findings"]:
        _check_finding(finding, joints)
    for silent in record["not_testable"]:
        assert isinstance(silent["effect"], str)
        assert set(silent["joints"]) <= set(joints)
        assert silent["reason"]
    if record["gap"]:
        assert set(record["heldout"]["rms_before_Nm"]) == set(record["heldout"]["rms_after_Nm"]) == set(joints)
        assert number(record["heldout"]["shrink"])
    return record


def check_places(record: Mapping[str, Any]) -> None:
    """Places are of joints with a gap, in the order of harm but for the first name's joints, which come first."""
    gap, places = record["gap"], record["where"]
    judged = [(set(f["joints"]) | set(f["heldout"]["rms_before_Nm"]), f["evidence"]) for f in record["findings"]]
    for place in places:
        one = gap[place["joint"]]
        hidden = [how["judged_against"] == "urdf" for joints, how in judged if place["joint"] in joints]
        error = one["fixed_rms_Nm"] if any(hidden) or one["tuned_away_Nm"] > 0.0 else one["rms_Nm"]
        assert error > one["noise_floor_Nm"]
        assert place["share_of_gap"] > place["share_of_time"]
        assert (place["axis"], place["low"]) != ("frequency", 0.0)
    first = set(record["findings"][0]["joints"]) if record["findings"] else set()
    listed = list(dict.fromkeys((place["joint"] not in first, -place["beyond_noise_Nm"]) for place in places))
    assert listed == sorted(listed)
    if first & {place["joint"] for place in places}:
        assert places[0]["joint"] in first


def _check_finding(finding: dict[str, Any], joints: list[str]) -> None:
    assert finding["class"][0] == finding["effect"]
    odds = finding["rivals"]
    assert all(number(one) and one > 0.0 for one in odds.values())
    assert finding["effect"] not in odds
    assert finding["class"][1:] == sorted((name for name, one in odds.items() if one <= 10.0), key=odds.__getitem__)
    assert finding["joints"]
    assert set(finding["joints"]) <= set(joints)
    assert 0.0 <= finding["probability"] <= 1.0
    for value in finding["parameters"].values():
        assert figures(value, "value", "low", "high")
        assert value["low"] <= value["value"] <= value["high"]
    held_out = finding["heldout"]
    assert set(held_out["rms_before_Nm"]) == set(held_out["rms_after_Nm"]) <= set(joints)
    assert figures(held_out, "energy_error_before_J", "energy_error_after_J", "shrink")
    assert held_out["shrink"] <= 1.0
