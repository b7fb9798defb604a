"""A checker of the diagnosis's JSON against what was promised: its schema, and what no schema says."""

from collections.abc import Mapping
from typing import Any

from ident.inference.estimate import CLASS_ODDS
from tests.schemas import check_record


def check_diagnosis(record: dict[str, Any]) -> dict[str, Any]:
    """Passes a record that is as the contract says, after a round through strict JSON; returns that."""
    record = check_record(record)
    assert record["schema"] == "ident.diagnosis/1"
    joints = set(record["joints"])
    assert joints >= {*record["gap"], *(place["joint"] for place in record["where"])}
    for issue in record["telemetry"]:
        assert set(issue["joints"]) <= joints
        assert all(issue[key] for key in ("issue", "evidence", "remedy"))
    for gap in record["gap"].values():
        energy = gap["energy_error_J"]
        assert energy["std"] is not None if record["session"]["runs"] > 1 else energy["std_missing"]
    assert all(0.0 < place["p_value"] <= 1.0 for place in record["where"])
    check_places(record)
    for finding in record["findings"]:
        _check_finding(finding, joints)
    for silent in record["not_testable"]:
        assert set(silent["joints"]) <= joints
        assert silent["reason"]
    for doubt in record["reservations"]:
        _check_reservation(doubt, joints)
    if record["gap"]:
        assert set(record["heldout"]["rms_before_Nm"]) == set(record["heldout"]["rms_after_Nm"]) == joints
        assert record["heldout"]["shrink"] is not None
    return record


def check_places(record: Mapping[str, Any]) -> None:
    """Places are of joints with a gap, in the order of harm; names in that of what each closes, unlikely ones last."""
    gap, places = record["gap"], record["where"]
    judged = [(set(f["joints"]) | set(f["heldout"]["rms_before_Nm"]), f["evidence"]) for f in record["findings"]]
    for place in places:
        one = gap[place["joint"]]
        hidden = [how["judged_against"] == "urdf" for joints, how in judged if place["joint"] in joints]
        errors = (one["fixed_rms_Nm"], one["rms_Nm"])
        error = max(errors) if any(hidden) or one["tuned_away_Nm"] > 0.0 else min(errors)
        assert error > one["noise_floor_Nm"]
        assert place["share_of_gap"] > place["share_of_time"]
        assert (place["axis"], place["low"]) != ("frequency", 0.0)
    listed = [-place["beyond_noise_Nm"] for place in places]
    assert listed == sorted(listed)
    errors = [(one["heldout"]["rms_before_Nm"], one["heldout"]["rms_after_Nm"]) for one in record["findings"]]
    closed = [sum(old**2 - after[joint] ** 2 for joint, old in before.items()) for before, after in errors]
    ranks = [(one["probability"] < 0.5, -most) for one, most in zip(record["findings"], closed, strict=True)]
    assert ranks == sorted(ranks)


def _check_finding(finding: dict[str, Any], joints: set[str]) -> None:
    odds = finding["rivals"]
    assert all(one > 0.0 for one in odds.values())
    assert finding["effect"] not in odds
    nearest = sorted((name for name, one in odds.items() if one <= CLASS_ODDS), key=odds.__getitem__)
    assert finding["class"] == [finding["effect"], *nearest]
    assert set() < set(finding["joints"]) <= joints
    assert 0.0 <= finding["probability"] <= finding["class_probability"] <= 1.0
    _check_reasons(finding["reasons"])
    _check_parameters(finding["parameters"])
    held_out = finding["heldout"]
    assert set(held_out["rms_before_Nm"]) == set(held_out["rms_after_Nm"]) <= joints
    assert all(isinstance(held_out[f"energy_error_{when}_J"], float) for when in ("before", "after"))
    assert held_out["shrink"] <= 1.0


def _check_reservation(doubt: dict[str, Any], joints: set[str]) -> None:
    """Effects that were weighed have a probability below even odds, with reasons."""
    assert set(doubt["joints"]) <= joints
    assert doubt["reason"]
    assert ("probability" in doubt) == ("reasons" in doubt)
    if "probability" in doubt:
        assert doubt["effect"] is not None
        assert 0.0 <= doubt["probability"] < 0.5
        _check_reasons(doubt["reasons"])
    _check_parameters(doubt["parameters"])


def _check_reasons(reasons: list[dict[str, Any]]) -> None:
    """Reasons have words, and are in the order of their weight."""
    weights = [one["weight"] for one in reasons]
    assert weights == sorted(weights, reverse=True)
    assert all(one["weight"] >= 0.0 for one in reasons)
    assert all(one["what"] for one in reasons)


def _check_parameters(parameters: dict[str, dict[str, Any]]) -> None:
    """Intervals hold their values, and with the URDF's own error they are no narrower."""
    for value in parameters.values():
        assert value["low"] <= value["value"] <= value["high"]
        assert ("low_with_urdf" in value) == ("high_with_urdf" in value)
        if "low_with_urdf" in value:
            assert value["low_with_urdf"] <= value["low"]
            assert value["high"] <= value["high_with_urdf"]
