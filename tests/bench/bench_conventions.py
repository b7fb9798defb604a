"""Random conventions of logs and URDFs: how often the search finds what was changed, and what it costs.

Of each log one to three conventions are changed, in the log or in the URDF. Two readings that explain the same torque
as well are the same: a turn of joint 1 of an upright arm, the direction of a joint whose links look alike both ways.
Changes that an oracle, which knows them, does not see in the log are drawn anew, and counted by kind. Of a miss the
oracle is asked whether the log tells the truth from what was found; where it does not, the miss counts as one all the
same, and is counted apart beside. The search says itself which two readings it can't tell apart: these are a class of
their own, in which neither is sure, and are counted in all shares as they were.

    python -m tests.bench.bench_conventions FOLDER CASES SEED     # FOLDER: recordings of real arms
    python -m tests.bench.bench_conventions untouched FOLDER SEED # stretches of the same, as they are
"""

from __future__ import annotations

import sys
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ident.checks.conventions.find import Conventions, is_changed, search_conventions
from ident.checks.conventions.hypothesis import Hypothesis
from ident.checks.conventions.model import Model
from ident.checks.conventions.readings import Log
from ident.checks.settings import USUAL_EFFORT
from tests.bench.conventions.arms import MOST_STATES, Case, load_cases, stretches
from tests.bench.conventions.changes import KINDS, draw, draw_kinds, spoil
from tests.bench.conventions.oracle import is_same, is_told_apart, is_visible

# Cases between two lines that say how far it is.
TOLD_EVERY = 50


@dataclass(frozen=True, eq=False)
class Drawn:
    """A log with some of its conventions changed."""

    case: Case
    kinds: tuple[str, ...]
    truth: Hypothesis
    log: Log
    model: Model

    @property
    def thin(self) -> Log:
        """Its states, thinned out."""
        return self.log.thinned(MOST_STATES)

    def is_right(self, guess: Hypothesis) -> bool:
        """Whether a guess means what was changed."""
        return is_same(self.thin, self.model, guess, self.truth, self.case.is_sound)

    def is_told_from(self, guess: Hypothesis) -> bool:
        """Whether the log tells the truth from a guess, by the oracle."""
        return is_told_apart(self.thin, self.model, self.truth, guess)


def drawn_cases(cases: list[Case], rng: np.random.Generator, hidden: Counter[str]) -> Iterator[Drawn]:
    """Cases without end, of changes that are seen; those that are not are counted."""
    while True:
        case = cases[int(rng.integers(len(cases)))]
        kinds = draw_kinds(case, rng)
        truth = draw(case, kinds, rng)
        log, arm = spoil(case, truth, rng)
        drawn = Drawn(case, kinds, truth, log, Model(arm))
        if is_visible(drawn.thin, drawn.model, truth):
            yield drawn
        else:
            hidden.update(kinds)


class Tally:
    """How often the truth was first, and among the two."""

    def __init__(self) -> None:
        self.counts: dict[str, Counter[str]] = {}
        self.seconds: list[float] = []
        self.read_otherwise: Counter[bool] = Counter()  # by whether the truth is first
        self.sure: Counter[bool] = Counter()
        self.two: Counter[str] = Counter()  # cases whose two readings are said not to be told apart

    def take(self, drawn: Drawn, found: Conventions) -> tuple[bool, bool]:
        """One more case; whether the truth is first, and whether it is among the two."""
        first = drawn.is_right(found.best.hypothesis)
        among = first or (found.second is not None and drawn.is_right(found.second.hypothesis))
        self.read_otherwise[first] += is_changed(found)
        self.sure[first] += is_changed(found) and found.is_told_apart
        if not found.is_told_apart:
            self.two.update(cases=1, first=first, among=among, read=is_changed(found))
        untold = not first and not drawn.is_told_from(found.best.hypothesis)
        for name in ("all", f"{len(drawn.kinds)} changes", f"arm {drawn.case.group}", *drawn.kinds):
            counts = self.counts.setdefault(name, Counter())
            counts.update(cases=1, first=first, among=among, untold=untold, untold_missed=untold and not among)
        return first, among

    def lines(self) -> Iterator[str]:
        """Shares by number of changes, by kind and by arm."""
        names = ["all", *(f"{count} changes" for count in (1, 2, 3)), *KINDS]
        names += sorted(name for name in self.counts if name.startswith("arm "))
        for name in names:
            counts = self.counts.get(name)
            if counts is not None:
                shares = [counts[key] / counts["cases"] for key in ("first", "among")]
                untold = f"not told apart {counts['untold']}, of these not among {counts['untold_missed']}"
                yield (
                    f"{name:24s} cases {counts['cases']:5d}  first {shares[0]:.3f}  "
                    f"among the two {shares[1]:.3f}  {untold}"
                )
        yield f"processor seconds of a search: median {np.median(self.seconds):.2f}, most {max(self.seconds):.2f}"
        yield f"read otherwise than they say: {self.read_otherwise[True]} rightly, {self.read_otherwise[False]} not"
        yield f"of these said to be sure: {self.sure[True]} rightly, {self.sure[False]} not"
        two = self.two
        yield (
            f"said that two readings can't be told apart: {two['cases']}, of these read otherwise {two['read']}; "
            f"the truth is first in {two['first']}, among the two in {two['among']}"
        )


def bench(folder: Path, count: int, seed: int) -> None:
    """Draws cases and prints what was found, one line a miss, and the shares."""
    rng = np.random.default_rng(seed)
    cases = load_cases(folder, rng)
    print(f"{len(cases)} logs of {len({case.group for case in cases})} arms", flush=True)
    tally, hidden = Tally(), Counter[str]()
    try:
        for number, drawn in enumerate(drawn_cases(cases, rng, hidden), start=1):
            start = time.process_time()
            found = search_conventions(drawn.log, drawn.model)
            tally.seconds.append(time.process_time() - start)
            first, among = tally.take(drawn, found)
            if not first:
                seen = found.best.hypothesis.changes
                place = "second" if among else "missed"
                figures = f"{found.best.cost:.1f}, as it is {found.as_it_is.cost:.1f}"
                print(f"  {place} {number} {drawn.case.name}: {drawn.truth.changes} -> {seen} ({figures})", flush=True)
            if number % TOLD_EVERY == 0:
                counts = tally.counts["all"]
                print(f"{number}: first {counts['first']}, among {counts['among']}", flush=True)
            if number == count:
                break
    except KeyboardInterrupt:  # what was counted until then is not lost
        print("stopped")
    print("\n".join(tally.lines()))
    print(f"not seen by the oracle, by kind: {dict(hidden)}")


def untouched(folder: Path, seed: int) -> None:
    """Stretches of recordings as they are: how many are read otherwise than they say."""
    rng = np.random.default_rng(seed)
    counts: Counter[str] = Counter()
    # A body at the end may truly be there, or missing: real arms' URDFs come with hands and without.
    gains: dict[str, list[float]] = {"body": [], "others": []}
    for case in load_cases(folder, rng):
        model = Model(case.arm)
        for begin, log in stretches(case):
            found = search_conventions(log, model)
            changed = is_changed(found)
            gain = found.gain
            is_body = set(found.best.hypothesis.changes) <= {"body"}
            counts.update(stretches=1, changed=changed and not is_body, body=changed and is_body)
            if found.best.explains >= USUAL_EFFORT.sign_explains:
                gains["body" if is_body else "others"].append(gain)
            if changed or gain > 0.0:
                names = f"{found.best.hypothesis.changes} gains {gain:.2f}"
                print(f"  {case.name} {begin}: {names}, {'sure' if changed else 'not sure'}", flush=True)
    for name, values in gains.items():
        print(f"largest gain, {name}: {max(values, default=0.0):.2f}")
    print(dict(counts))


def main() -> None:
    """Runs what is asked for."""
    if sys.argv[1] == "untouched":
        untouched(Path(sys.argv[2]), int(sys.argv[3]))
    else:
        bench(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]))


if __name__ == "__main__":
    main()
