"""What became of semi-real cases: planted effects, names and cases, a row each.

A real arm has effects of its own: a name that its untouched recordings (the control) have already,
or that others measured on this arm, is neither right nor wrong. A probability is that of the class,
where one is given.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from ident.benchmark.scores import is_inside
from ident.effects.catalogue import OF_THE_ARM
from ident.records import JsonRecord, JsonTable
from ident.simulation.real.sources import measured_causes

# A class with this probability or more is named.
CONFIDENT = 0.5

Row = JsonRecord
Finding = JsonTable


def rows_of(
    answers: Mapping[str, Row], results: Mapping[str, Row]
) -> tuple[list[Row], list[Row], list[Row]]:
    """What became of planted effects, names and cases, a row each.

    Args:
        answers: By case, what was planted, its arm, kind and control.
        results: By case, the record of its diagnosis; a case without one is passed over.

    Returns:
        A row an effect that was planted (`named` in its class, `strict` as itself, `covered` by its
        intervals); a row a name that was given (whether it is `right`, or `old`: the control's or
        measured); a row a case.
    """
    effects: list[Row] = []
    names: list[Row] = []
    cases: list[Row] = []
    for case, answer in answers.items():
        if case not in results:
            continue
        result = results[case]
        findings = findings_of(result)
        control = findings_of(results.get(answer["control"], {}))
        measured = _measured_on(answer["arm"])
        base = {"case": case, "arm": answer["arm"], "kind": answer["kind"]}
        planted = [
            {**base, **_effect_row(effect, findings, control)} for effect in answer["effects"]
        ]
        is_control = answer["kind"] == "control"
        given: list[Row] = []
        if not is_control:
            known = [*control, *measured]
            rows = [_name_row(finding, answer["effects"], known) for finding in findings]
            given = [{**base, **row} for row in rows]
        sure = [finding for finding in findings if class_probability(finding) >= CONFIDENT]
        seen = [_is_named(cause, sure) for cause in measured]
        new = [name for name in given if not name["old"]]
        cases.append(
            {
                **base,
                "verdict": _record(result).get("verdict", "error"),
                "new": new,
                "wrong": [name for name in new if not name["right"]],
                "f1": _set_f1(planted, new),
                "seconds": result.get("processor_seconds"),
                "measured": seen if is_control else [],
            }
        )
        effects += planted
        names += given
    return effects, names, cases


def _measured_on(arm: str) -> list[Row]:
    """What others measured on an arm: an entry a cause and joint."""
    causes: list[Row] = []
    for effect, joints in measured_causes(arm).items():
        causes += [{"effect": effect, "joints": [j], "may_stand_at": [j]} for j in joints]
    return causes


def _effect_row(effect: Row, findings: Sequence[Finding], control: Sequence[Finding]) -> Row:
    """What became of a planted effect.

    Args:
        effect: The effect.
        findings: Names of its case.
        control: Names of the untouched recordings.
    """
    in_class = [finding for finding in findings if holds(finding, effect)]
    strict = [finding for finding in in_class if finding["effect"] == effect["effect"]]
    already = any(holds(finding, effect) for finding in control)
    return {
        **{key: effect[key] for key in ("effect", "asked", "in_catalogue")},
        "joint": effect["joints"][0] if effect["joints"] else "",
        "already": already,
        "named": _is_sure(in_class),
        "named_at_all": bool(in_class),
        "strict": _is_sure(strict),
        "covered": _covered(effect, strict[0]) if strict and not already else {},
    }


def _is_named(cause: Row, findings: Sequence[Finding]) -> bool:
    """Whether any of some names holds a cause."""
    return any(holds(finding, cause) for finding in findings)


def _is_sure(findings: Iterable[Finding]) -> bool:
    """Whether any of some names is likely enough."""
    return max(map(class_probability, findings), default=0.0) >= CONFIDENT


def _covered(effect: Row, finding: Finding) -> dict[str, bool]:
    """Whether the intervals of a name hold what was planted, by parameter."""
    covered = {}
    for key, true in effect["parameters"].items():
        interval = finding.get("parameters", {}).get(key)
        if not isinstance(interval, dict) or interval.get("low") is None:
            continue
        if key != "order" and not isinstance(true, str):
            low = float(interval["low"])
            high = float(interval["high"])
            covered[key] = is_inside(key, true, low, high)
    return covered


def _name_row(finding: Finding, planted: Sequence[Row], known: Sequence[Finding]) -> Row:
    """What became of a name.

    Args:
        finding: The name.
        planted: The effects that were planted.
        known: What the control names, and what others measured.
    """
    right = any(holds(finding, effect) for effect in planted)
    return {
        "name": f"{finding['effect']}:{'+'.join(finding['joints'])}",
        "p": class_probability(finding),
        "right": right,
        "old": not right and any(_are_alike(finding, other) for other in known),
    }


def _are_alike(finding: Finding, other: Finding) -> bool:
    """Whether two names share an effect and a joint where both may stand."""
    return bool(_class(finding) & _class(other) and _places(finding) & _places(other))


def _set_f1(planted: Sequence[Row], new: Sequence[Row]) -> float | None:
    """Harmonic mean of precision and recall of a case's sure names; None where nothing was put."""
    if not planted:
        return None
    hits = sum(effect["named"] for effect in planted)
    if not hits:
        return 0.0
    said = sum(name["p"] >= CONFIDENT for name in new)
    return 2.0 * hits / (said + len(planted))


def _record(result: JsonTable) -> JsonTable:
    """The diagnosis or the comparison of a case."""
    return result.get("diagnosis") or result.get("comparison") or {}


def findings_of(result: JsonTable) -> list[Finding]:
    """Names that a diagnosis or a comparison gives."""
    record = _record(result)
    return list(record.get("findings", record.get("changes", ())))


def _class(finding: Finding) -> set[str]:
    """The effects that a name may stand for."""
    return {finding["effect"], *finding.get("class", ())}


def _places(finding: Finding) -> set[str]:
    """Joints of a name, and those where it may stand as well."""
    elsewhere = {place["joint"] for place in finding.get("elsewhere", ()) if place["joint"]}
    return {*finding["joints"], *elsewhere}


def class_probability(finding: Finding) -> float:
    """That one of a name's class is the cause."""
    return float(finding.get("class_probability", finding.get("probability", 1.0)))


def holds(finding: Finding, effect: Row) -> bool:
    """Whether a name's class has the effect, or what is the same torque, where it may stand."""
    allowed = {None, *effect["may_stand_at"]}
    wanted = {effect["effect"], *effect.get("also", ())}
    for place in finding.get("elsewhere", ()):
        if place["effect"] in wanted and place["joint"] in allowed:
            return True
    if finding["effect"] in OF_THE_ARM and finding["effect"] in effect.get("also", ()):
        return True  # the same torque, of an effect that has no joint of its own
    return bool(wanted & _class(finding)) and bool(allowed & set(finding["joints"]))
