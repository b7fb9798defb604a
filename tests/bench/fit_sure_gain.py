"""Fits from which gain on another reading of a log is surely right, to logs that are as they say.

Of each log the gain of the likeliest reading over log and URDF as they say is stored. In a log that is as it says any
gain is false, but for a body at the end of the arm: real arms' URDFs come with hands and without. False gains are rare
and fall off exponentially,

    P(gain > g) = share exp(-g / scale),

the share of logs with a false gain and the mean of those gains each the mean over the physical arms, as logs of one arm
err alike. The gain that is sure is that beyond which, with 95 %, not one of 300 logs lies:

    sure_gain = scale log(300 share / -log 0.95).

Its unit is a joint's logarithm of what a reading leaves: how many samples a log has does not enter. Arms are left out
whole, by turns, and counted with what the others say.

    python -m tests.bench.fit_sure_gain untouched FOLDER SEED FILE.jsonl         # FOLDER: recordings of real arms
    python -m tests.bench.fit_sure_gain corpus INDEX.json COUNT SEED FILE.jsonl  # sessions of a stored corpus
    python -m tests.bench.fit_sure_gain draw FOLDER CASES SEED FILE.jsonl        # drawn conventions
    python -m tests.bench.fit_sure_gain fit FILE.jsonl ...

Source: exceedances over a threshold as in Coles, An Introduction to Statistical Modeling of Extreme Values (2001),
chapter 4, of shape zero.
"""

from __future__ import annotations

import json
import math
import sys
import time
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ident.checks.conventions.find import Conventions, is_of_urdf, search_conventions
from ident.checks.conventions.model import Model
from ident.checks.conventions.settings import SEARCH
from ident.checks.settings import USUAL_EFFORT
from tests.bench.bench_conventions import drawn_cases
from tests.bench.conventions.arms import MOST_STATES, case_of_session, load_cases, stretches

# Of so many logs as they are none is to be changed, nor its URDF, with this probability.
LOGS, LEVEL = 300, 0.95
# Parts that arms are left out in.
FOLDS = 5


def row_of(name: str, group: str, found: Conventions, **more: Any) -> dict[str, Any]:
    """What is stored of a log."""
    return {
        "name": name,
        "group": group,
        "changes": list(found.best.hypothesis.changes),
        "gain": found.gain,
        "of_urdf": is_of_urdf(found.best),
        "part": [] if found.of_urdf is None else list(found.of_urdf.hypothesis.changes),
        "gain_of_part": 0.0 if found.of_urdf is None else found.led_by(found.of_urdf).gain,
        "explains": found.best.explains,
        "as_it_is": found.as_it_is.explains,
        "second": [] if found.second is None else list(found.second.hypothesis.changes),
        **more,
    }


def store(file: Path, row: dict[str, Any]) -> None:
    """Adds a row to a file, so that what is interrupted is not lost."""
    with file.open("a", encoding="utf-8") as stream:
        stream.write(json.dumps(row) + "\n")


def store_drawn(folder: Path, count: int, seed: int, file: Path) -> None:
    """Logs whose conventions were changed, and whether the reading that is found is right."""
    rng = np.random.default_rng(seed)
    for number, drawn in enumerate(drawn_cases(load_cases(folder, rng), rng, Counter[str]())):
        if number == count:
            return
        start = time.process_time()
        found = search_conventions(drawn.log, drawn.model)
        seconds = time.process_time() - start
        right = drawn.is_right(found.best.hypothesis)
        among = right or (found.second is not None and drawn.is_right(found.second.hypothesis))
        row = row_of(drawn.case.name, drawn.case.group, found, origin="drawn", right=right, among=among)
        row.update(truth=list(drawn.truth.changes), hypothesis=repr(drawn.truth), seconds=seconds)
        store(file, row)


def store_untouched(folder: Path, seed: int, file: Path) -> None:
    """Stretches of recordings as they are."""
    for case in load_cases(folder, np.random.default_rng(seed)):
        model = Model(case.arm)
        for begin, log in stretches(case):
            found = search_conventions(log, model)
            store(file, row_of(f"{case.name} {begin}", case.group, found, origin="untouched"))


def store_corpus(index: Path, count: int, seed: int, file: Path) -> None:
    """Sessions of a corpus: whatever effect is in them, their conventions are as they say."""
    entries = json.loads(index.read_text(encoding="utf-8"))["sessions"]
    rng = np.random.default_rng(seed)
    for k in rng.permutation(len(entries))[:count]:
        entry = entries[int(k)]
        case = case_of_session(entry["case"], entry["arm"], Path(entry["folder"]), Path(entry["urdf"]))
        if case is None:
            continue
        found = search_conventions(case.log.thinned(MOST_STATES), Model(case.arm))
        store(file, row_of(entry["case"], entry["arm"], found, origin="corpus", kind=entry["kind"]))


def false_gain(row: dict[str, Any]) -> float:
    """By how much another reading seems better of a log that is as it says [nats]; 0 where none does."""
    is_proposed = bool(row["changes"]) and set(row["changes"]) != {"body"}
    is_well_explained = row["explains"] >= USUAL_EFFORT.sign_explains
    return max(float(row["gain"]), 0.0) if is_proposed and is_well_explained else 0.0


def false_gain_of_urdf(row: dict[str, Any]) -> float:
    """The same of what leaves the log as it says: the likeliest reading, or a part of it [nats]."""
    if row["of_urdf"]:
        return false_gain(row)
    is_proposed = bool(row["part"]) and set(row["part"]) != {"body"}
    is_well_explained = row["explains"] >= USUAL_EFFORT.sign_explains
    return max(float(row["gain_of_part"]), 0.0) if is_proposed and is_well_explained else 0.0


def fit_tail(rows: Iterable[dict[str, Any]]) -> tuple[float, float]:
    """Share of logs with a false gain, and the mean of those gains [nats]; each arm counts alike."""
    by_arm: dict[str, list[float]] = {}
    for row in rows:
        by_arm.setdefault(row["group"], []).append(false_gain(row))
    shares, means = [], []
    for gains in by_arm.values():
        shares.append(float(np.mean(np.array(gains) > 0.0)))
        means.append(float(np.mean(gains)))
    return float(np.mean(shares)), float(np.sum(means) / np.sum(shares))


def sure_gain(rows: Iterable[dict[str, Any]]) -> float:
    """The gain beyond which, by the false gains of some logs, none of so many lies [nats]."""
    return gain_beyond(*fit_tail(rows))


def changed(rows: Iterable[dict[str, Any]], level: float) -> tuple[int, int]:
    """Logs that would be read otherwise from a gain on; and logs that stay, but whose URDF would be."""
    by_log = 0
    by_urdf = 0
    for row in rows:
        if not row["of_urdf"] and false_gain(row) > level:
            by_log += 1
        elif false_gain_of_urdf(row) > level:
            by_urdf += 1
    return by_log, by_urdf


def gain_beyond(share: float, scale: float) -> float:
    """The gain beyond which none of so many logs lies, with a probability."""
    return scale * math.log(share * LOGS / -math.log(LEVEL))


def fit(rows: Sequence[dict[str, Any]]) -> None:
    """Fits to all arms, and to others than those that are counted, and prints both."""
    untouched = [row for row in rows if row["origin"] != "drawn"]
    right = [row for row in rows if row["origin"] == "drawn" and row["right"]]
    arms = sorted({row["group"] for row in untouched})
    share, scale = fit_tail(untouched)
    needed = sure_gain(untouched)
    print(f"{len(untouched)} logs of {len(arms)} arms: {share:.4f} with a false gain, {scale:.3f} nats in the mean")
    print(f"largest false gain {max(map(false_gain, untouched)):.2f}, by the URDF alone ", end="")
    print(f"{max(map(false_gain_of_urdf, untouched)):.2f}")
    print(f"sure_gain = {needed:.2f}; now {SEARCH.sure_gain}")
    if right:
        share_sure = np.mean([row["gain"] > needed for row in right])
        print(f"of {len(right)} drawn changes rightly read {share_sure:.3f} sure")
    total = np.zeros(2, dtype=int)
    for k in range(FOLDS):
        out = arms[k::FOLDS]
        others = sure_gain(row for row in untouched if row["group"] not in out)
        held = [row for row in untouched if row["group"] in out]
        counts = changed(held, others)
        total += counts
        print(f"without {', '.join(out)}: {others:.2f}; ", end="")
        print(f"there {counts[0]} logs changed and {counts[1]} URDFs, of {len(held)}")
    print(f"arms left out: {total[0]} logs changed and {total[1]} URDFs, of {len(untouched)}")


def main() -> None:
    """Stores rows, or fits."""
    command, *rest = sys.argv[1:]
    if command == "draw":
        store_drawn(Path(rest[0]), int(rest[1]), int(rest[2]), Path(rest[3]))
    elif command == "untouched":
        store_untouched(Path(rest[0]), int(rest[1]), Path(rest[2]))
    elif command == "corpus":
        store_corpus(Path(rest[0]), int(rest[1]), int(rest[2]), Path(rest[3]))
    else:
        lines = [line for name in rest for line in Path(name).read_text(encoding="utf-8").splitlines()]
        fit([json.loads(line) for line in lines])


if __name__ == "__main__":
    main()
