"""Semi-real cases as a check: made, sealed, diagnosed or compared, scored.

A real arm has effects of its own: a name that its untouched recordings (the control) have already,
or that others measured on this arm, is neither right nor wrong. A probability is that of the class,
where one is given.
"""

from __future__ import annotations

import argparse
import fnmatch
import itertools
import json
import os
import time
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ident.benchmark.run import BlindOptions, Progress, Say, begin_check
from ident.benchmark.scoring import (
    Score,
    calibration_curve,
    calibration_error,
    is_inside,
    mean,
    share,
)
from ident.benchmark.summary import group_by, in_columns
from ident.diagnosis.change.from_reports import compare_reports
from ident.diagnosis.from_reports import diagnose_reports
from ident.effects.catalogue import CATALOGUE
from ident.errors import InputError
from ident.files import atomic_write
from ident.records import as_json
from ident.results import Provenance, Result
from ident.safe_read import read_json
from ident.sessions import Given, inspect_sources
from ident.show.palette import FLEXIBLE
from ident.show.results import draw_bars
from ident.simulation.real.cases import make_cases
from ident.simulation.real.sources import load_sources, measured_causes
from ident.workers import run_tasks

if TYPE_CHECKING:
    from matplotlib.figure import Figure


CONFIDENT = 0.5
BINS = 5
Row = dict[str, Any]
Finding = Mapping[str, Any]


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
        record = _record(results[case])
        findings = _findings(results[case])
        control = _findings(results.get(answer["control"], {}))
        base = {"case": case, "arm": answer["arm"], "kind": answer["kind"]}
        measured: list[Row] = [
            {"effect": effect, "joints": [joint], "may_stand_at": [joint]}
            for effect, joints in measured_causes(answer["arm"]).items()
            for joint in joints
        ]
        owned = [*control, *measured]
        planted = []
        for effect in answer["effects"]:
            found = [finding for finding in findings if holds(finding, effect)]
            strict = [one for one in found if one["effect"] == effect["effect"]]
            already = any(holds(one, effect) for one in control)
            covered = {}  # whether the intervals of a name hold what was planted
            for key, true in effect["parameters"].items() if strict and not already else ():
                one = strict[0].get("parameters", {}).get(key)
                given = isinstance(one, dict) and one.get("low") is not None
                if given and key != "order" and not isinstance(true, str):
                    low = float(one["low"])
                    high = float(one["high"])
                    covered[key] = is_inside(key, true, low, high)
            row = {
                **{key: effect[key] for key in ("effect", "asked", "in_catalogue")},
                "joint": effect["joints"][0] if effect["joints"] else "",
                "already": already,
                "named": max(map(_probability, found), default=0.0) >= CONFIDENT,
                "named_at_all": bool(found),
                "strict": max(map(_probability, strict), default=0.0) >= CONFIDENT,
                "covered": covered,
            }
            planted.append({**base, **row})
        new = []
        for one in findings if answer["kind"] != "control" else ():
            true = any(holds(one, effect) for effect in answer["effects"])
            old = not true and any(
                _class(one) & _class(other) and _places(one) & _places(other) for other in owned
            )
            name = f"{one['effect']}:{'+'.join(one['joints'])}"
            row = {**base, "name": name, "p": _probability(one), "right": true, "old": old}
            names.append(row)
            new += [] if old else [row]
        hits = sum(one["named"] for one in planted)
        said = sum(one["p"] >= CONFIDENT for one in new)
        f1 = 2.0 * hits / (said + len(planted)) if planted and hits else 0.0 if planted else None
        wrong = [one for one in new if not one["right"]]
        seconds = results[case].get("processor_seconds")
        verdict = record.get("verdict", "error")
        row = {**base, "verdict": verdict, "new": new, "wrong": wrong, "f1": f1, "seconds": seconds}
        sure = [finding for finding in findings if _probability(finding) >= CONFIDENT]
        seen = [any(holds(one, it) for one in sure) for it in measured]
        cases.append({**row, "measured": seen if answer["kind"] == "control" else []})
        effects += planted
    return effects, names, cases


def score(effects: Sequence[Row], names: Sequence[Row], cases: Sequence[Row]) -> Row:
    """Scores with intervals, and the rows that they are of."""
    single = [effect for effect in effects if effect["kind"] == "single"]
    said = [name for name in names if not name["old"]]
    found = {
        "strict": share(one["strict"] for one in single),
        "class_aware": share(one["named"] for one in single),
        "false_alarm": share(case["wrong"] for case in cases if case["kind"] == "untouched"),
        "set_f1": mean([case["f1"] for case in cases if case["kind"] == "pair"]),
        "interval_coverage": share(hit for one in effects for hit in one["covered"].values()),
        "calibration_error": calibration_error(
            [one["p"] for one in said], [one["right"] for one in said]
        ),
    }
    outcomes = [
        {key: x for key, x in case.items() if key not in ("new", "wrong", "measured")}
        for case in cases
    ]
    return {
        "cases": len(cases),
        **in_columns(found),
        "effects": list(effects),
        "outcomes": outcomes,
    }


def _record(result: Mapping[str, Any]) -> Mapping[str, Any]:
    return result.get("diagnosis") or result.get("comparison") or {}


def _findings(result: Mapping[str, Any]) -> list[Finding]:
    """Names that a diagnosis or a comparison gives."""
    record = _record(result)
    return list(record.get("findings", record.get("changes", ())))


def _class(finding: Finding) -> set[str]:
    return {finding["effect"], *finding.get("class", ())}


def _places(finding: Finding) -> set[str]:
    """Joints of a name, and those where it may stand as well."""
    return {
        *finding["joints"],
        *(one["joint"] for one in finding.get("elsewhere", ()) if one["joint"]),
    }


def _probability(finding: Finding) -> float:
    return float(finding.get("class_probability", finding.get("probability", 1.0)))


def holds(finding: Finding, effect: Row) -> bool:
    """Whether a name's class has the effect, at a joint where it may stand."""
    allowed = {None, *effect["may_stand_at"]}
    if any(
        o["effect"] == effect["effect"] and o["joint"] in allowed
        for o in finding.get("elsewhere", ())
    ):
        return True
    return effect["effect"] in _class(finding) and bool(allowed & set(finding["joints"]))


# Tables


def tables(effects: Sequence[Row], names: Sequence[Row], cases: Sequence[Row]) -> Iterable[str]:
    """Lines of all tables."""
    listed = [effect for effect in effects if effect["in_catalogue"]]
    single = [one for one in listed if one["kind"] == "single"]
    fresh = [name for name in names if not name["old"]]
    yield f"{len(cases)} cases; verdicts: " + _count(case["verdict"] for case in cases)
    yield "controls: " + _count(case["verdict"] for case in cases if case["kind"] == "control")
    measured = [seen for one in cases for seen in one["measured"]]
    yield f"measured by others on the untouched arms, named with p >= 0.5: {_share(measured)}"
    yield from _grouped(
        "planted singles in the class with p >= 0.5, by size", single, "asked", "named"
    )
    yield from _grouped("  at any p", single, "asked", "named_at_all")
    yield from _grouped("  as the first name", single, "asked", "strict")
    yield from _grouped("  by arm", single, "arm", "named")
    yield from _grouped("  by effect", single, "effect", "named")
    pairs = [case["f1"] for case in cases if case["kind"] == "pair"]
    yield f"pairs: F1 {np.mean(pairs):.2f} of {len(pairs)}" if pairs else "pairs: none"
    for kind in ("untouched", "outside", "single"):
        own = [case for case in cases if case["kind"] == kind]
        sure = [any(n["p"] >= CONFIDENT for n in one["wrong"]) for one in own]
        newly_wrong = _share(case["wrong"] for case in own)
        yield f"{kind}: a new wrong name {newly_wrong}; with p >= 0.5 {_share(sure)}"
    outside = [case for case in cases if case["kind"] == "outside"]
    yield "outside: verdicts " + _count(one["verdict"] for one in outside)
    inside = [
        (f"{one['effect']}.{key}", hit) for one in listed for key, hit in one["covered"].items()
    ]
    yield f"intervals that hold what was planted: {_share(hit for _, hit in inside)}"
    yield "  missed: " + _count(key for key, hit in inside if not hit)
    # A name that was not planted and is given to another case of the arm, too, may be the arm's
    # own.
    wrong = Counter((name["arm"], name["name"]) for name in names if not name["right"])
    once = [one for one in fresh if one["right"] or wrong[one["arm"], one["name"]] < 2]
    for title, rows in (("", fresh), (", names of one case of the arm alone", once)):
        yield f"calibration (probability, right){title}:"
        for _, _, said, right in calibration_curve(
            [row["p"] for row in rows], [row["right"] for row in rows], BINS
        ):
            yield f"  {said:.2f}: {_written(right)}"
    yield "wrong names: " + _count(one["name"].split(":")[0] for one in fresh if not one["right"])
    spent = [case["seconds"] for case in cases if case["seconds"] is not None]
    yield (
        f"processor seconds a case: median {np.median(spent):.1f}, most {max(spent):.1f}"
        if spent
        else ""
    )


def _grouped(title: str, rows: Sequence[Row], key: str, hit: str) -> Iterable[str]:
    yield f"{title}: {_share(row[hit] for row in rows)}"
    for value, own in group_by(rows, lambda one: one[key]).items():
        yield f"    {value}: {_share(one[hit] for one in own)}"


def _share(hits: Iterable[bool]) -> str:
    return _written(share(hits))


def _written(one: Score) -> str:
    if one.value is None:
        return "0 of 0"
    share = f"{one.value:.0%} [{one.low:.0%}, {one.high:.0%}]"
    return f"{round(one.value * one.count)} of {one.count} ({share})"


def _count(words: Iterable[str]) -> str:
    return ", ".join(f"{word} {count}" for word, count in Counter(words).most_common()) or "none"


#    python -m ident.benchmark.real_check make OUT --cases 150 --seed 1 [--real DIR] [--compare]
#                                              [--arms ARM,…] [--kept-back]
#    python -m ident.benchmark.real_check diagnose OUT [--results DIR] [--only 'case_00*']
#    python -m ident.benchmark.real_check score OUT [--results DIR]
# `OUT/cases` holds a session folder a case (`before` and `after` of a comparison), and the
# untouched recordings as `control_…`; what was planted lies in `OUT/answers`.


@dataclass(frozen=True, eq=False)
class RealReport(Result):
    """The outcome on semi-real cases.

    Seed, SHA-256 of each case's answer, scores with their rows, tables in words.
    """

    seed: int
    seals: dict[str, str]
    record: dict[str, Any]
    lines: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """`ident.blind/1`, as far as real arms know it."""
        origin = {"provenance": self.provenance.to_dict()}
        return {
            "schema": "ident.blind/1",
            "seed": self.seed,
            "seals": self.seals,
            **self.record,
            **origin,
        }

    def summary(self) -> str:
        return "\n".join(self.lines)

    def plot(self) -> Figure:
        shares = {name: value for name, value in self.record["scores"].items() if value is not None}
        return draw_bars(
            list(shares),
            {"semi-real": (FLEXIBLE, list(shares.values()))},
            "share",
            "semi-real cases",
        )


def read_rows(out: Path, results: Path) -> tuple[list[Row], list[Row], list[Row]]:
    """Rows of all cases of a folder that have a result; see `rows_of`."""
    answers = {
        path.stem: json.loads(path.read_text()) for path in sorted((out / "answers").glob("*.json"))
    }
    files = {name: results / f"{name}.json" for name in answers}
    return rows_of(
        answers,
        {name: json.loads(path.read_text()) for name, path in files.items() if path.is_file()},
    )


def check_on_real(folder: Path, options: BlindOptions, say: Say, progress: Progress) -> RealReport:
    """Plants effects onto the real recordings below a folder, diagnoses and scores.

    Goes on where it was stopped.

    Raises:
        InputError: No recordings there, or another check in the folder.
    """
    seed = begin_check(options, {"semi_real": str(folder)})
    out = options.out
    sealed = out / "seals.json"
    if not sealed.is_file():
        make_cases(load_sources(folder), out, options.cases, seed, paired=False)
    seals: dict[str, str] = read_json(sealed, "remove it, or choose another --out")
    for name, seal in seals.items():
        say(f"{name} sealed: sha256 {seal}")
    tasks = {name: (out / "cases" / name, out / "results" / f"{name}.json") for name in seals}
    waiting = {name: task for name, task in tasks.items() if not task[1].is_file()}
    done = itertools.count(len(seals) - len(waiting) + 1)

    def count(name: str) -> None:
        progress("diagnosing", next(done), len(seals))

    run_tasks(diagnose_case, list(waiting.values()), options.workers, options.scheduler, count)
    rows = read_rows(out, out / "results")
    origin = Provenance(
        "ident blind", settings={"cases": options.cases, "seed": seed, "semi_real": str(folder)}
    )
    report = RealReport(seed, seals, score(*rows), tuple(tables(*rows)), provenance=origin)
    report.save(out / "blind.json")
    return report


def diagnose_case(task: tuple[Path, Path]) -> str:
    """Diagnoses a case, or compares its before and after, and writes what was found.

    Returns its name.
    """
    folder, path = task
    start = time.perf_counter()
    used = time.process_time()
    record: dict[str, Any] = {}
    try:
        if (folder / "before").is_dir():
            sides = [folder / "before", folder / "after"]
            arm, reports = inspect_sources(Given(sides, sides[1] / "robot.urdf")).whole
            record["comparison"] = compare_reports(reports[:1], reports[1:], arm).to_dict()
        else:
            arm, reports = inspect_sources(Given([folder], folder / "robot.urdf")).whole
            record["diagnosis"] = diagnose_reports(reports, arm, CATALOGUE)[0].to_dict()
    except InputError as error:
        record["error"] = str(error)
    record["seconds"] = time.perf_counter() - start
    record["processor_seconds"] = time.process_time() - used
    with atomic_write(path) as part:
        part.write_text(as_json(record, None) + "\n", encoding="utf-8")
    return folder.name


def main() -> None:
    """The command; what it takes stands in the module's docstring."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("job", choices=("make", "diagnose", "score"))
    parser.add_argument("out", type=Path)
    parser.add_argument(
        "--real", type=Path, default=Path(os.environ.get("IDENT_REAL_DATA", "../shared/real"))
    )
    parser.add_argument("--cases", type=int, default=150)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--compare", action="store_true")
    parser.add_argument(
        "--arms", default="", help="physical arms, separated by commas; all if none is given"
    )
    parser.add_argument(
        "--kept-back", action="store_true", help="the arms that stay closed until a release"
    )
    parser.add_argument("--results", type=Path)
    parser.add_argument("--only", default="*")
    given = parser.parse_args()
    results = given.results or given.out / "results"
    if given.job == "make":
        arms = tuple(filter(None, given.arms.split(",")))
        sources = load_sources(given.real, given.kept_back, arms)
        make_cases(sources, given.out, given.cases, given.seed, given.compare, print)
    elif given.job == "score":
        print("\n".join(tables(*read_rows(given.out, results))))
    else:
        for folder in sorted((given.out / "cases").iterdir()):
            path = results / f"{folder.name}.json"
            if fnmatch.fnmatch(folder.name, given.only) and not path.is_file():
                print(diagnose_case((folder, path)), flush=True)


if __name__ == "__main__":
    main()
