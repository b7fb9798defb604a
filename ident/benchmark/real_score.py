"""What was told of semi-real cases against what was planted, relative to what the untouched recordings are told.

A real arm has effects of its own: a name that its untouched recordings (the control) have already is neither right nor
wrong. A probability is that of the class, where one is given.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ident.benchmark.statistics import calibration_error, mean, share

CONFIDENT, BINS = 0.5, 5
Row = dict[str, Any]
Finding = Mapping[str, Any]


def read_rows(out: Path, results: Path) -> tuple[list[Row], list[Row], list[Row]]:
    """Rows of all cases of a folder that have a result; see `rows_of`."""
    answers = {path.stem: json.loads(path.read_text()) for path in sorted((out / "answers").glob("*.json"))}
    files = {name: results / f"{name}.json" for name in answers}
    return rows_of(answers, {name: json.loads(path.read_text()) for name, path in files.items() if path.is_file()})


def score(effects: Sequence[Row], names: Sequence[Row], cases: Sequence[Row]) -> Row:
    """Scores with intervals, and the rows that they are of."""
    single = [one for one in effects if one["kind"] == "single"]
    untouched = [bool(one["wrong"]) for one in cases if one["kind"] == "untouched"]
    said = [one for one in names if not one["old"]]
    found = {
        "strict": share([one["strict"] for one in single]),
        "class_aware": share([one["named"] for one in single]),
        "false_alarm": share(untouched),
        "set_f1": mean([one["f1"] for one in cases if one["kind"] == "pair"]),
        "interval_coverage": share([hit for one in effects for hit in one["covered"].values()]),
        "calibration_error": calibration_error([one["p"] for one in said], [one["right"] for one in said]),
    }
    return {
        "cases": len(cases),
        "scores": {name: one.value for name, one in found.items()},
        "intervals": {name: [one.low, one.high] for name, one in found.items()},
        "counts": {name: one.count for name, one in found.items()},
        "effects": list(effects),
        "outcomes": [{key: x for key, x in one.items() if key not in ("new", "wrong")} for one in cases],
    }


def rows_of(answers: Mapping[str, Row], told: Mapping[str, Row]) -> tuple[list[Row], list[Row], list[Row]]:
    """One row an effect that was planted, one a name that was told, one a case."""
    effects: list[Row] = []
    names: list[Row] = []
    cases: list[Row] = []
    for case, answer in answers.items():
        if case not in told:
            continue
        findings = findings_of(told[case])
        control = findings_of(told.get(answer["control"], {}))
        base = {"case": case, "arm": answer["arm"], "kind": answer["kind"]}
        effects.extend({**base, **_effect_row(effect, findings, control)} for effect in answer["effects"])
        for one in findings if answer["kind"] != "control" else ():
            true = any(holds(one, effect) for effect in answer["effects"])
            old = any(_same(one, other) for other in control)
            name = f"{one['effect']}:{'+'.join(one['joints'])}"
            names.append({**base, "name": name, "p": probability(one), "right": true, "old": old and not true})
        record = told[case].get("diagnosis") or told[case].get("comparison") or {"verdict": "error"}
        new = [n for n in names if n["case"] == case and not n["old"]]
        f1 = _f1(sum(n["p"] >= CONFIDENT for n in new), [e for e in effects if e["case"] == case])
        seconds = told[case].get("processor_seconds")
        wrong = [n for n in new if not n["right"]]
        cases.append({**base, "verdict": record["verdict"], "new": new, "wrong": wrong, "f1": f1, "seconds": seconds})
    return effects, names, cases


def findings_of(record: Mapping[str, Any]) -> list[Finding]:
    """Names that a diagnosis or a comparison gives."""
    told = record.get("diagnosis") or record.get("comparison") or {}
    return list(told.get("findings", told.get("changes", ())))


def class_of(finding: Finding) -> set[str]:
    return {finding["effect"], *finding.get("class", ())}


def probability(finding: Finding) -> float:
    return float(finding.get("class_probability", finding.get("probability", 1.0)))


def holds(finding: Finding, effect: Row) -> bool:
    """Whether a name's class has the effect, at a joint where it may stand."""
    allowed = {None, *effect["may_stand_at"]}
    if any(o["effect"] == effect["effect"] and o["joint"] in allowed for o in finding.get("elsewhere", ())):
        return True
    return effect["effect"] in class_of(finding) and bool(allowed & set(finding["joints"]))


def _same(one: Finding, other: Finding) -> bool:
    return bool(class_of(one) & class_of(other)) and bool(set(one["joints"]) & set(other["joints"]))


def _effect_row(effect: Row, findings: Sequence[Finding], control: Sequence[Finding]) -> Row:
    found = [one for one in findings if holds(one, effect)]
    strict = [one for one in found if one["effect"] == effect["effect"]]
    already = any(holds(one, effect) for one in control)
    best = max((probability(one) for one in found), default=0.0)
    covered = {} if already else _covered(effect, strict[0]) if strict else {}
    return {
        "effect": effect["effect"],
        "asked": effect["asked"],
        "in_catalogue": effect["in_catalogue"],
        "joint": effect["joints"][0] if effect["joints"] else "",
        "already": already,
        "named": best >= CONFIDENT,
        "named_at_all": bool(found),
        "strict": bool(strict) and max(probability(one) for one in strict) >= CONFIDENT,
        "covered": covered,
    }


def _covered(effect: Row, finding: Finding) -> dict[str, bool]:
    """Whether the intervals of a name hold what was planted."""
    found = {}
    for key, true in effect["parameters"].items():
        told = finding.get("parameters", {}).get(key)
        if isinstance(true, str) or not isinstance(told, dict) or told.get("low") is None or key == "order":
            continue
        low, high = float(told["low"]), float(told["high"])
        if key == "phase_rad":
            middle = 0.5 * (low + high)
            true = middle + float(np.angle(np.exp(1j * (true - middle))))
        found[key] = low - 1e-9 <= true <= high + 1e-9
    return found


def _f1(named: int, effects: Sequence[Row]) -> float | None:
    if not effects:
        return None
    hits = sum(one["named"] for one in effects)
    return 2.0 * hits / (named + len(effects)) if hits else 0.0


# Tables


def tables(effects: Sequence[Row], names: Sequence[Row], cases: Sequence[Row]) -> Iterable[str]:
    """Lines of all tables."""
    listed = [one for one in effects if one["in_catalogue"]]
    single = [one for one in listed if one["kind"] == "single"]
    fresh = [one for one in names if not one["old"]]
    yield f"{len(cases)} cases; verdicts: " + _count(one["verdict"] for one in cases)
    yield "controls: " + _count(one["verdict"] for one in cases if one["kind"] == "control")
    yield from _grouped("planted singles in the class with p >= 0.5, by size", single, "asked", "named")
    yield from _grouped("  at any p", single, "asked", "named_at_all")
    yield from _grouped("  as the first name", single, "asked", "strict")
    yield from _grouped("  by arm", single, "arm", "named")
    yield from _grouped("  by effect", single, "effect", "named")
    pairs = [one["f1"] for one in cases if one["kind"] == "pair"]
    yield f"pairs: F1 {np.mean(pairs):.2f} of {len(pairs)}" if pairs else "pairs: none"
    for kind in ("untouched", "outside", "single"):
        own = [one for one in cases if one["kind"] == kind]
        sure = [any(n["p"] >= CONFIDENT for n in one["wrong"]) for one in own]
        yield f"{kind}: a new wrong name {_share(bool(one['wrong']) for one in own)}; with p >= 0.5 {_share(sure)}"
    outside = [one for one in cases if one["kind"] == "outside"]
    yield "outside: verdicts " + _count(one["verdict"] for one in outside)
    inside = [(f"{one['effect']}.{key}", hit) for one in listed for key, hit in one["covered"].items()]
    yield f"intervals that hold what was planted: {_share(hit for _, hit in inside)}"
    yield "  missed: " + _count(key for key, hit in inside if not hit)
    yield "calibration (probability, right):"
    for k in range(BINS):
        own = [one for one in fresh if k == min(int(one["p"] * BINS), BINS - 1)]
        if own:
            yield f"  {np.mean([one['p'] for one in own]):.2f}: {_share(one['right'] for one in own)}"
    yield "wrong names: " + _count(one["name"].split(":")[0] for one in fresh if not one["right"])
    spent = [one["seconds"] for one in cases if one["seconds"] is not None]
    yield f"processor seconds a case: median {np.median(spent):.1f}, most {max(spent):.1f}" if spent else ""


def _grouped(title: str, rows: Sequence[Row], key: str, hit: str) -> Iterable[str]:
    yield f"{title}: {_share(one[hit] for one in rows)}"
    for value in sorted({one[key] for one in rows}):
        yield f"    {value}: {_share(one[hit] for one in rows if one[key] == value)}"


def _share(hits: Iterable[bool]) -> str:
    found = list(hits)
    one = share(found)
    return f"{sum(found)} of {len(found)}" + (f" ({one.value:.0%} [{one.low:.0%}, {one.high:.0%}])" if found else "")


def _count(words: Iterable[str]) -> str:
    return ", ".join(f"{word} {count}" for word, count in Counter(words).most_common()) or "none"
