"""First line, first action and first name of a diagnosis: which joint and cause they speak of, and in which order."""

import re
from itertools import product
from typing import Any

import pytest

from ident.show.report.diagnosis_actions import first_action, order_of
from ident.show.report.diagnosis_verdict import LONGEST_HEADLINE, diagnosis_headline
from ident.show.report.leading_joint import in_order_of_joints
from ident.show.terminal import describe_name, headline

SCALE = {
    "issue": "torque_scale",
    "joints": ["elbow"],
    "severity": "warning",
    "evidence": "elbow reads 1.32 ± 0.05 times the model's gravity torque",
    "remedy": "check its drive gain",
}


def acted_on(effect: str, probability: float, *telemetry: dict[str, Any]) -> dict[str, Any]:
    finding = {"effect": effect, "joints": ["elbow"], "class": [effect], "probability": probability, "action": "do so"}
    finding["class_probability"] = probability
    return {"verdict": "named", "findings": [finding], "telemetry": list(telemetry), "gap": {}}


@pytest.mark.parametrize("probability", [0.97, 0.3])
@pytest.mark.parametrize(("named", "mapped"), product(("elbow", "wrist"), ("elbow", "wrist")))
@pytest.mark.parametrize("scale", [None, "elbow", "wrist"])
def test_first_line_first_action_and_first_name_are_about_the_first_place(
    scale: str | None, named: str, mapped: str, probability: float
) -> None:
    """Law: whatever is named and off by a factor elsewhere, all three begin with the joint of the first place.

    What is off by a factor there is its gap; what has no name there is said to have none, and what to record.
    """
    off = [{**SCALE, "joints": [scale], "evidence": f"session: {scale} reads 1.10 ± 0.02"}] if scale else []
    record = acted_on("spring_torque", probability, *off) | {"joints": ["elbow", "wrist", "base"]}
    record["findings"][0] |= {"joints": ["knee", named], "action": f"look at {named}"}
    record["findings"].insert(0, {**record["findings"][0], "joints": ["base"], "action": "look at base"})
    record["where"] = [{"joint": mapped, "beyond_noise_Nm": 0.5}]
    record["next_experiment"] = {"separates": [], "motion": f"move {mapped}"}
    line, action = diagnosis_headline(record), first_action(record)
    assert re.findall("elbow|wrist|base|knee", line)[0] == mapped
    assert re.findall("elbow|wrist|base|knee", action)[0] == mapped
    gap, reading = f"The gap is largest at {mapped}, 0.50 N m beyond noise", f"{scale} reads 1.10 ± 0.02 in session"
    if scale == mapped:
        assert line.startswith(f"{reading} (0.50 N m beyond noise). Beyond that, the gap ")
        assert action == f"At {mapped}: check its drive gain."
        return
    assert line.endswith(f" {reading}. Check its drive gain.") is bool(scale)
    assert line.startswith(f"{gap}, and is unexplained there.") is (named != mapped)
    if named == mapped:
        assert f"ook at {mapped}" in action
        assert line.index(f"spring torque in {mapped} and knee") < line.index("spring torque in base")
    else:
        assert action == f"0.50 N m at {mapped} are unexplained. Record this next: move {mapped}."


def test_where_names_close_a_part_the_first_line_says_where_most_of_the_rest_is() -> None:
    """Law: beyond noise, and in the slide's unit; nowhere where they leave noise alone."""
    gap = {"base": {"rms_Nm": 9.0, "noise_floor_Nm": 4.0, "unit": "N"}, "elbow": {"rms_Nm": 2.0, "noise_floor_Nm": 0.4}}
    record = acted_on("spring_torque", 0.97) | {"verdict": "partial", "gap": gap}
    for after, rest in (
        ((5.0, 0.5), "at base, 3.0 N beyond"),
        ((4.0, 0.5), "at elbow, 0.30 N m beyond"),
        ((4, 0.4), ""),
    ):
        record["heldout"] = {"rms_after_Nm": dict(zip(gap, after, strict=True))}
        assert (f"most of the rest is {rest} noise." in diagnosis_headline(record)) is bool(rest)


def test_a_change_less_likely_than_not_is_not_told_by_one_name() -> None:
    """Law: the first line of a comparison names what it may be as well; what is likely it names alone."""
    change = {"effect": "torque_offset", "joints": ["knee"], "class": ["torque_offset", "asymmetric_friction"]}
    record = {"verdict": "changed", "changes": [change | {"parameters": {}, "probability": 0.4}], "not_testable": []}
    assert headline(record)[0] == "What changed: torque offset or asymmetric friction in knee."
    change = record["changes"][0] | {"action": "correct it"}
    assert order_of(change, record).startswith("act on none yet, for it may be torque offset or asymmetric friction in")
    record["changes"][0]["probability"] = 0.8
    assert headline(record)[0] == "What changed: torque offset in knee."
    assert order_of(change | {"probability": 0.8}, record) == "correct it"


def test_of_names_that_show_at_the_leading_joint_the_one_that_closes_most_there_is_first() -> None:
    """Law: a load that hangs on another joint stands before a ripple of the joint itself, and is its factor."""
    record = acted_on("torque_ripple", 0.97, SCALE) | {"where": [{"joint": "elbow", "beyond_noise_Nm": 9.0}]}
    load = {**record["findings"][0], "effect": "link_inertial_error", "joints": ["wrist"], "action": "weigh it"}
    closed = {"rms_before_Nm": {"elbow": 9.0, "wrist": 1.0}, "rms_after_Nm": {"elbow": 0.8, "wrist": 0.1}}
    ripple = {"rms_before_Nm": {"elbow": 0.8}, "rms_after_Nm": {"elbow": 0.7}}
    record["findings"] = [{**record["findings"][0], "heldout": ripple}, {**load, "heldout": closed}]
    assert in_order_of_joints(record)[0]["effect"] == "link_inertial_error"
    assert first_action(record) == "Weigh it."
    assert "Beyond that" not in diagnosis_headline(record)


def test_of_several_joints_off_by_a_factor_the_leading_one_is_said_first() -> None:
    """Law: also where a body may be the factor, or nothing else is a gap; of one session its name says nothing."""
    two = {**SCALE, "joints": ["wrist", "elbow"], "evidence": "s: wrist reads 1.50 ± 0.02; elbow reads 1.32 ± 0.05"}
    record = acted_on("payload", 0.97, two) | {"where": [{"joint": "elbow", "beyond_noise_Nm": 2.0}]}
    record["provenance"] = {"sessions": ["s"]}
    line = diagnosis_headline(record)
    assert line.startswith("The gap has a name: payload felt at elbow.")
    assert line.endswith("elbow reads 1.32 ± 0.05; off as well: wrist: the body may be why.")
    record |= {"verdict": "no_gap", "findings": [], "where": []}
    record["gap"] = {name: {"rms_Nm": rms, "noise_floor_Nm": 0.3} for name, rms in {"base": 0.9, "elbow": 0.5}.items()}
    assert diagnosis_headline(record).startswith("elbow reads 1.32 ± 0.05; off as well: wrist. Beyond that, no gap: ")
    assert first_action(record).startswith("At elbow (1.32) and wrist (1.50): check")


@pytest.mark.parametrize("mapped", ["elbow", "wrist", ""])
def test_a_name_that_shows_at_the_first_place_is_a_name_there(mapped: str) -> None:
    """A link's mass shows at the joints before it; of gaps too small for a place the first is one that has a name."""
    record = acted_on("link_inertial_error", 0.97) | {"where": [{"joint": mapped}] if mapped else []}
    record["findings"][0] |= {"joints": ["wrist"], "heldout": {"rms_before_Nm": {"elbow": 0.5}}}
    record["gap"] = {name: {"rms_Nm": rms, "noise_floor_Nm": 0.3} for name, rms in {"base": 0.9, "elbow": 0.5}.items()}
    line = diagnosis_headline(record)
    assert (first_action(record), "unexplained there" in line) == ("Do so.", False)
    assert ("largest at elbow, " in line and "where a cause elsewhere is felt" in line) is (mapped != "wrist")
    record["findings"].append({**record["findings"][0], "joints": ["elbow"], "probability": 0.3})
    assert in_order_of_joints(record)[0]["joints"] == ["wrist" if mapped == "wrist" else "elbow"]


@pytest.mark.parametrize(("left", "off"), [(0.31, False), (0.8, True)])
def test_a_zero_that_explains_a_factor_comes_in_its_place(left: float, off: bool) -> None:
    """Law: what turns gravity at several joints, and closes the gap there, is what read as a factor without it.

    Also where tuning had absorbed it: what the name closes counts, not what the tuned model leaves.
    """
    record = acted_on("encoder_offset", 0.97, SCALE)
    errors = {"rms_before_Nm": {"shoulder": 1.0, "elbow": 1.2}, "rms_after_Nm": {"shoulder": 0.3, "elbow": left}}
    record["findings"][0] |= {"joints": ["shoulder"], "heldout": errors}
    record["gap"] = {name: {"rms_Nm": 0.3, "noise_floor_Nm": 0.3} for name in ("shoulder", "elbow")}
    assert ("elbow reads 1.32" in diagnosis_headline(record)) is off


@pytest.mark.parametrize("effect", ["payload", "torque_gain_error"])
def test_a_likely_name_of_the_factor_comes_in_its_place(effect: str) -> None:
    """A gain of one joint says nothing of another that is off; a load acts on all."""
    assert first_action(acted_on(effect, 0.97, SCALE)) == "Do so."
    assert first_action(acted_on(effect, 0.30, SCALE)) == "At elbow: check its drive gain."
    two = acted_on(effect, 0.97, {**SCALE, "joints": ["elbow", "wrist"]})
    two["gap"] = {"elbow": {"rms_Nm": 0.5, "noise_floor_Nm": 0.3}}
    assert first_action(two).startswith("Do so." if effect == "payload" else "At elbow (1.32) and wrist: check")
    reading = "elbow reads 1.32 ± 0.05 times the model's gravity torque; off as well: wrist"
    line = diagnosis_headline(two)
    assert line.endswith(f"{reading}: the body may be why.") if effect == "payload" else line.startswith(f"{reading}.")


def test_a_factors_gain_is_not_beyond_the_factor() -> None:
    """Law: a gain of a joint whose factor is said is only another name of it: others are listed, or it stands alone."""
    record = acted_on("torque_gain_error", 0.97, {**SCALE, "joints": ["elbow", "wrist"]})
    record |= {"where": [{"joint": "elbow", "beyond_noise_Nm": 9.0}]}
    assert diagnosis_headline(record).endswith("wrist. The gap has a name: torque gain error in elbow.")
    record["findings"] += acted_on("spring_torque", 0.97)["findings"]
    assert diagnosis_headline(record).endswith("wrist. Beyond that, the gap has a name: spring torque in elbow.")


@pytest.mark.parametrize(("gain", "same"), [(0.3, True), (-0.09, False)])
def test_a_gain_of_the_other_side_is_no_name_of_a_factor(gain: float, same: bool) -> None:
    """Law: a joint that reads 1.32 of gravity is not explained by a gain that reads too little; both are said."""
    record = acted_on("torque_gain_error", 0.97, SCALE) | {"where": [{"joint": "elbow", "beyond_noise_Nm": 9.0}]}
    record["findings"][0]["parameters"] = {"gain": {"value": gain, "low": gain - 0.02, "high": gain + 0.02}}
    line = diagnosis_headline(record)
    assert line.startswith("elbow reads 1.32") is not same
    assert ("Beyond that, the gap has a name: torque gain error in elbow" in line) is not same
    assert first_action(record) == ("Do so." if same else "At elbow: check its drive gain.")


@pytest.mark.parametrize("joint", ["elbow", "wrist"])
def test_a_body_may_be_the_factor_of_joints_that_carry_it(joint: str) -> None:
    """Law: a body on a link loads the joints before it, also where tuning hides that; none behind it."""
    record = acted_on("link_inertial_error", 0.97, {**SCALE, "joints": [joint]})
    record |= {"joints": ["shoulder", "elbow", "forearm", "wrist"], "where": [{"joint": joint}]}
    record["findings"][0]["joints"] = ["forearm"]
    assert ("It may be a body: link inertial error" in diagnosis_headline(record)) is (joint == "elbow")
    assert (first_action(record) == "Do so.") is (joint == "elbow")


def test_gains_of_all_joints_that_are_off_stand_first() -> None:
    """Law: where the leading joint's factor has a name those of others come next, before all else that it has."""
    record = acted_on("torque_gain_error", 0.97, {**SCALE, "joints": ["elbow", "wrist"]})
    record["where"] = [{"joint": "wrist", "beyond_noise_Nm": 9.0}]
    record["findings"] += [
        {**record["findings"][0], "effect": effect, "joints": ["wrist"]}
        for effect in ("spring_torque", "torque_gain_error")
    ]
    order = [(one["effect"], *one["joints"]) for one in in_order_of_joints(record)]
    assert order == [("torque_gain_error", "wrist"), ("torque_gain_error", "elbow"), ("spring_torque", "wrist")]


@pytest.mark.parametrize("guessed", [True, False])
def test_a_guessed_gain_comes_before_what_is_told_in_its_unit(guessed: bool) -> None:
    """Law: at the leading joint a likely gain that nobody measured stands before a friction that closes more."""
    issue = {"issue": "guessed_gains", "joints": ["elbow"], "evidence": "guesses", "remedy": "measure them"}
    record = acted_on("torque_gain_error", 0.9, *[issue] * guessed) | {"where": [{"joint": "elbow"}]}
    rms = {"rms_before_Nm": {"elbow": 2.0}, "rms_after_Nm": {"elbow": 1.0}}
    friction = {**record["findings"][0], "effect": "load_dependent_friction", "heldout": rms}
    record["findings"].insert(0, friction)
    assert (in_order_of_joints(record)[0]["effect"] == "torque_gain_error") is guessed


def test_a_body_that_is_not_the_first_name_is_no_factor() -> None:
    """Law: a name at the joint that reads a factor, and a body behind it, do not come before its drive gain."""
    record = acted_on("load_dependent_friction", 0.97, SCALE) | {"where": [{"joint": "elbow", "beyond_noise_Nm": 9.0}]}
    record["findings"] += [{**one, "joints": ["wrist"]} for one in acted_on("link_inertial_error", 0.97)["findings"]]
    assert first_action(record) == "At elbow: check its drive gain."


def test_headline_says_how_sure_a_name_is_that_is_less_likely_than_not() -> None:
    assert diagnosis_headline(acted_on("payload", 0.43)) == "The gap may have a name: payload felt at elbow (43 %)."
    record = acted_on("payload", 0.97)
    record["findings"] += acted_on("stribeck_friction", 0.11)["findings"]
    assert (
        diagnosis_headline(record) == "The gap has a name: payload felt at elbow and Stribeck friction in elbow (11 %)."
    )


def test_a_motion_that_parts_other_names_or_moves_another_joint_is_not_told() -> None:
    """Law: tied names are distinguished by a motion of their own."""
    record = acted_on("spring_torque", 0.4)
    record["findings"][0]["class"] = ["spring_torque", "joint_coupling"]
    for separates, fits in ((["spring_torque"], False), (record["findings"][0]["class"], True)):
        record["next_experiment"] = {"separates": separates, "motion": "move it; `plan excite --joint elbow --out x`"}
        assert ("move it" in order_of(record["findings"][0], record)) is fits
    record["next_experiment"]["motion"] = "move it; `plan excite --joint wrist --out x`"
    assert "--separate spring_torque,joint_coupling --joint elbow" in order_of(record["findings"][0], record)
    record["findings"][0]["class"] = ["payload", "link_inertial_error"]  # which no motion can part
    assert "take everything off the flange" in order_of(record["findings"][0], record)


@pytest.mark.parametrize("scale", [(), (SCALE,)])
def test_a_first_line_holds_as_many_names_as_one_sentence_takes(scale: tuple[dict[str, Any], ...]) -> None:
    """Law: no more characters than it may have, whatever is named; the names that are left out are counted."""
    record = acted_on("spring_torque", 0.3, *scale) | {"where": [{"joint": "elbow", "beyond_noise_Nm": 9.0}]}
    tied = ["load_dependent_friction", "position_dependent_friction", "link_inertial_error", "torque_offset"]
    record["findings"] += [{**record["findings"][0], "class": tied}, {**record["findings"][0], "class": tied}]
    line = diagnosis_headline(record)
    assert len(line) <= LONGEST_HEADLINE
    listed = line.count("elbow (30 %)")
    assert listed == (1 if scale else 2)
    assert line.endswith(f", and {3 - listed} more.")
    record["findings"] = record["findings"][:1]
    assert "more" not in diagnosis_headline(record)


def test_what_is_less_likely_than_not_is_told_by_all_that_it_may_be() -> None:
    """Law: name and probability are those of the class, the same in the first line and in the list below it."""
    record = acted_on("spring_torque", 0.3)
    tied = ["spring_torque", "torque_offset", "joint_coupling", "joint_elasticity", "backlash"]
    finding = record["findings"][0] | {"class": tied, "class_probability": 0.97}
    record["findings"] = [finding | {"heldout": {f"rms_{when}_Nm": {"elbow": 1.0} for when in ("before", "after")}}]
    name = "pring torque or torque offset or joint coupling or one of 2 others in elbow"
    assert f"{name} (97 %)." in diagnosis_headline(record)
    line = describe_name(record["findings"][0], record, "on unseen runs")
    assert line == f"S{name}: 97 % sure that it is one of these; torque error on unseen runs stays at 1.0 N m at elbow"


def test_a_gain_beside_a_factor_that_has_another_cause_waits_for_it() -> None:
    """Law: where the first line says a factor, a gain of another size does not contradict it."""
    record = acted_on("torque_gain_error", 0.97, {**SCALE, "joints": ["elbow", "wrist"]})
    record |= {"where": [{"joint": "elbow", "beyond_noise_Nm": 9.0}]}
    assert order_of(record["findings"][0], record).startswith("settle the factor above first; ")
    record["telemetry"] = []
    assert order_of(record["findings"][0], record) == "do so"


@pytest.mark.parametrize(("mass", "first"), [(0.8, "give what the arm carries"), (-0.7, "take the hand or tool")])
def test_a_links_mass_and_a_body_that_the_check_has_found_say_one_thing(mass: float, first: str) -> None:
    """Law: at the arm's end the order is the check's, the link comes after it; elsewhere the link stands alone."""
    body = {"issue": "body_differs", "joints": ["elbow"], "severity": "warning", "evidence": "…", "remedy": "…"}
    record = acted_on("link_inertial_error", 0.97, body)
    finding = record["findings"][0] | {"parameters": {"mass_change_kg": {"value": mass}}}
    record["findings"] = [finding]
    assert order_of(finding, record).startswith(first)
    assert diagnosis_headline(record).endswith(" mass at the arm's end than the URDF has.")
    assert order_of(finding, record).endswith(", do so")
    assert order_of(finding | {"joints": ["base"]}, record) == "do so"
    assert order_of(finding | {"joints": ["base"], "class": ["link_inertial_error", "payload"]}, record) != "do so"


@pytest.mark.parametrize("mass", [0.8, -0.7])
@pytest.mark.parametrize("further", [(), ("viscous_friction",)], ids=["alone", "beside friction"])
def test_a_load_and_the_last_link_are_one_mass_in_the_first_line(mass: float, further: tuple[str, ...]) -> None:
    """Law: a name stands in the first line once, however many findings have it."""
    body = {"issue": "body_differs", "joints": ["elbow"], "severity": "warning", "evidence": "…", "remedy": "…"}
    record = acted_on("payload", 0.97, body)
    load = record["findings"][0] | {"parameters": {"mass_kg": {"value": mass}}}
    parameters = {"mass_change_kg": {"value": mass}}
    link = load | {"effect": "link_inertial_error", "class": ["link_inertial_error"], "parameters": parameters}
    record["findings"] = [load, link, *(load | {"effect": name, "class": [name]} for name in further)]
    line = diagnosis_headline(record)
    assert line.count("mass at the arm's end than the URDF has") == 1
    assert ("viscous friction" in line) is bool(further)


@pytest.mark.parametrize("is_found", [True, False])
def test_a_gap_that_a_body_at_the_end_explains_is_not_called_unexplained(is_found: bool) -> None:
    """Law: what tuned inertias hide and the check of the recordings has weighed is told as the check has it."""
    remedy = "take the hand or tool that is not mounted out of the URDF"
    body = {"issue": "body_differs", "joints": ["wrist"], "severity": "warning", "evidence": "…", "remedy": remedy}
    record = acted_on("viscous_friction", 0.9, *([body] if is_found else []))
    record |= {"joints": ["elbow", "shoulder", "wrist"], "where": [{"joint": "shoulder", "beyond_noise_Nm": 3.9}]}
    record["gap"] = {"shoulder": {"rms_Nm": 4.0, "noise_floor_Nm": 0.1, "tuned_away_Nm": 3.8}}
    line, action = diagnosis_headline(record), first_action(record)
    assert ("unexplained" in line) is not is_found
    assert ("mass at the arm's end" in line) is is_found
    assert action.startswith("Take the hand or tool") is is_found
    assert line.startswith("The gap is largest at shoulder, 3.9 N m beyond noise")


def test_a_joint_that_an_effect_counts_goes_by_its_name() -> None:
    record = acted_on("joint_coupling", 0.97) | {"joints": ["elbow", "wrist"]}
    record["findings"][0]["action"] = "compensate elbow while joint number 2 moves"
    assert order_of(record["findings"][0], record) == "compensate elbow while wrist moves"


@pytest.mark.parametrize(("both", "told"), [(0.63, True), (0.4, False)])
def test_a_load_that_the_check_has_weighed_is_said_as_it_has_it(both: float, told: bool) -> None:
    """Law: load or last link, which nobody can part, are one mass at the end if likely together; the order is the
    check's, which has the mass.
    """
    remedy = "weigh it and write `payload = {mass_kg = 0.6}`"
    body = {"issue": "body_differs", "joints": ["elbow"], "severity": "warning", "evidence": "…", "remedy": remedy}
    record = acted_on("payload", 0.45, body)
    tied = {"class": ["payload", "link_inertial_error"], "class_probability": both}
    record["findings"] = [record["findings"][0] | tied | {"parameters": {"mass_kg": {"value": 0.5}}}]
    assert ("more mass at the arm's end than the URDF has" in diagnosis_headline(record)) is told
    assert (order_of(record["findings"][0], record) == remedy) is told


def test_a_first_line_that_is_too_long_leaves_sizes_to_the_table() -> None:
    """Law: of several wrong numbers of a URDF the one that matters most is said, and how many more there are."""
    joints = [f"a_long_joint_name_{number}" for number in range(5)]
    figure = {"nominal": 1.0, "value": 1.4, "low": 1.39, "high": 1.41, "low_with_urdf": 1.38, "high_with_urdf": 1.42}
    numbers = {
        key: {**figure, "value": 1.4 + 0.1 * k, "high_with_urdf": 1.6, "change_rms_Nm": 2.0 - k}
        for k, key in enumerate(("coulomb_Nm", "viscous_Nms_rad"))
    }
    record = acted_on("payload", 0.9) | {"verdict": "no_gap", "findings": [], "joints": joints, "where": []}
    record["identified"] = dict.fromkeys(joints, numbers)
    record["gap"] = {joint: {"rms_Nm": 0.1, "noise_floor_Nm": 0.1} for joint in joints}
    record["leftover"] = {joints[0]: 0.4}
    line = diagnosis_headline(record)
    assert len(line) <= LONGEST_HEADLINE
    assert "and 9 more numbers" in line
    assert "with 40 % an unnamed cause" in line


@pytest.mark.parametrize(("ends", "is_told"), [((0.98, 1.03), False), ((1.2, 1.35), True), ((0.9, 1.28), True)])
@pytest.mark.parametrize("probability", [0.97, 0.3])
def test_a_factor_that_is_none_beside_a_likely_law_of_its_joint_is_not_said_first(
    ends: tuple[float, float], is_told: bool, probability: float
) -> None:
    """Law: readings that flatten read a factor; beside their law the gain is one, and the law is what is said."""
    record = acted_on("torque_saturation", probability, SCALE)
    gain = {"nominal": 1.0, "value": 1.0, "low_with_urdf": ends[0], "high_with_urdf": ends[1]}
    record["identified"] = {"elbow": {"torque_gain": gain}}
    is_first = is_told or probability < 0.5
    assert ("elbow reads 1.32" in diagnosis_headline(record)) is is_first
    assert (first_action(record) == "At elbow: check its drive gain.") is is_first
    record["identified"] = {}
    assert "elbow reads 1.32" in diagnosis_headline(record)
