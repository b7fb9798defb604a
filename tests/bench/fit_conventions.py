"""Fits what a joint's torque is worth in the search of conventions, and how its size scatters, to drawn conventions.

Of each case the readings that the search looked at closely are kept, with what each leaves, the sizes of its torques,
its joints out of limits and the length of its description; those that mean what was changed are marked. The odds of a
reading are the exponential of

    - observations Σ log left - ½ Σ (log size / size_spread)² - limit · beyond - description,

and the three numbers are those under which the marked readings of all cases are likeliest. They are judged on arms
that were left out, by turns.

    python -m tests.bench.fit_conventions draw FOLDER CASES SEED FILE.npz   # FOLDER: recordings of real arms
    python -m tests.bench.fit_conventions fit FILE.npz
"""

from __future__ import annotations

import sys
from collections import Counter
from pathlib import Path

import numpy as np
from scipy.optimize import minimize

from ident.arrays import Array
from ident.checks.conventions.closely import Scored
from ident.checks.conventions.description import description_length, size_price
from ident.checks.conventions.search import Search
from ident.checks.conventions.settings import DESCRIPTION, SEARCH
from tests.bench.bench_conventions import Drawn, drawn_cases
from tests.bench.conventions.arms import load_cases

# Readings of each case that are kept.
KEPT = 25
# Parts that arms are left out in.
FOLDS = 5
STARTS = (DESCRIPTION.observations, DESCRIPTION.size_spread, DESCRIPTION.observations * SEARCH.limit_cost)


def features(drawn: Drawn, scored: Scored) -> tuple[float, float, float, float]:
    """Logarithms of what is left, half the squares of those of sizes, joints out of limits, description: sums."""
    hypothesis = scored.hypothesis
    scaled = {joint for joint, _ in hypothesis.effort_scale}
    usual = [j for j in range(len(scored.costs)) if j not in scaled]
    logs = np.log(np.array(scored.sizes))[usual]
    left = float(np.sum(scored.costs)) - float(size_price(logs).sum())
    q = hypothesis.angles(drawn.thin.q, drawn.model.sliding)
    beyond = float(drawn.model.beyond_limits(q[None])[0])
    length = description_length(hypothesis, drawn.model.usual_orders)
    return left, 0.5 * float(logs @ logs), beyond, length


def draw_table(folder: Path, count: int, seed: int, file: Path) -> None:
    """Draws cases, and stores the readings that were looked at."""
    rng = np.random.default_rng(seed)
    rows, marks, cases, groups = [], [], [], []
    for number, drawn in enumerate(drawn_cases(load_cases(folder, rng), rng, Counter[str]())):
        if number == count:
            break
        ranked = Search(drawn.log, drawn.model).run()[:KEPT]
        rows += [features(drawn, scored) for scored in ranked]
        marks += [drawn.is_right(scored.hypothesis) for scored in ranked]
        cases += [number] * len(ranked)
        groups += [drawn.case.group] * len(ranked)
    np.savez_compressed(file, rows=rows, marks=marks, cases=cases, groups=groups)


def logits(numbers: Array, rows: Array) -> Array:
    """Logarithm of the odds of readings, but for what they share."""
    observations, spread, limit = numbers
    left, sizes, beyond, length = rows.T
    return np.asarray(-observations * left - sizes / spread**2 - limit * beyond - length)


def misfit(numbers: Array, rows: Array, marks: Array, cases: Array) -> float:
    """Negative logarithm of the probability of the marked readings, a case; cases without one say nothing."""
    total, count = 0.0, 0
    scores = logits(numbers, rows)
    for case in np.unique(cases[marks]):
        own = cases == case
        top = scores[own].max()
        total += top + np.log(np.exp(scores[own] - top).sum())
        total -= top + np.log(np.exp(scores[own & marks] - top).sum())
        count += 1
    return float(total / max(count, 1))


def fit_numbers(rows: Array, marks: Array, cases: Array) -> Array:
    """Observations, spread of sizes and what a joint out of its limits costs [nats], positive."""
    result = minimize(
        lambda logs: misfit(np.exp(logs), rows, marks, cases), np.log(np.array(STARTS)), method="Nelder-Mead"
    )
    return np.exp(result.x)


def share_first(numbers: Array, rows: Array, marks: Array, cases: Array) -> float:
    """Share of the cases whose likeliest reading is marked, of those that have one."""
    scores = logits(numbers, rows)
    hits = []
    for case in np.unique(cases[marks]):
        own = np.flatnonzero(cases == case)
        hits.append(bool(marks[own[np.argmax(scores[own])]]))
    return float(np.mean(hits))


def fit(file: Path) -> None:
    """Fits to all cases, and to those of other arms, and prints both."""
    with np.load(file) as stored:
        rows, marks, cases, groups = (stored[name] for name in ("rows", "marks", "cases", "groups"))
    print(f"{len(np.unique(cases))} cases, {len(np.unique(cases[marks]))} of them with a right reading among {KEPT}")
    print("now", np.array(STARTS), f"misfit {misfit(np.array(STARTS), rows, marks, cases):.3f}")
    numbers = fit_numbers(rows, marks, cases)
    print("fitted", numbers, f"misfit {misfit(numbers, rows, marks, cases):.3f}")
    arms = np.unique(groups)
    shares = []
    for k in range(FOLDS):
        out = np.isin(groups, arms[k::FOLDS])
        others = fit_numbers(rows[~out], marks[~out], cases[~out])
        held = (rows[out], marks[out], cases[out])
        shares.append((misfit(others, *held), misfit(np.array(STARTS), *held), share_first(others, *held)))
        print(
            f"without {', '.join(arms[k::FOLDS])}: {others}, misfit there {shares[-1][0]:.3f}, now {shares[-1][1]:.3f}"
        )
    mean = np.mean(shares, axis=0)
    print(f"arms left out: misfit {mean[0]:.3f}, with today's numbers {mean[1]:.3f}; first {mean[2]:.3f}")


def main() -> None:
    """Draws or fits."""
    if sys.argv[1] == "draw":
        draw_table(Path(sys.argv[2]), int(sys.argv[3]), int(sys.argv[4]), Path(sys.argv[5]))
    else:
        fit(Path(sys.argv[2]))


if __name__ == "__main__":
    main()
