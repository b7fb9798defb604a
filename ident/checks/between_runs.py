"""Each run of a session held against the others.

Signs, zeros, scales, columns, clock, and whether it is this arm's.

The runs are parted, one against the rest or an earlier part against a later one. What a parting may
gain is told by foretelling: each run by a model of all others, and so again with a convention of
the odd runs undone, or with a model of their own. Evidence is the sum over runs and joints of the
logarithm by which errors shrink: a run counts once at each joint, however many samples it has, for
runs differ more than their samples tell. It must exceed the logarithm of the number of alternatives
over the chance of a false alarm. Runs that only move otherwise are foretold badly, too, and no
change mends that.

Source: Bonferroni's bound on likelihood ratios of many alternatives.
"""

from __future__ import annotations

import numpy as np

from ident.checks.parting import ComparedRuns, Parting, RunDifference
from ident.checks.settings import BETWEEN_RUNS as LIMIT

FEWEST_RUNS = 3  # of two runs nobody knows the odd one


def partings(count: int) -> list[tuple[int, ...]]:
    """Parts of a session that may differ from the rest, as tuples of the runs' numbers.

    Each run alone; and the smaller of an earlier and a later part, both of more than one run.
    """
    alone = [(number,) for number in range(count)]
    parts = []
    for cut in range(2, count - 1):
        early = tuple(range(cut))
        late = tuple(range(cut, count))
        parts.append(early if len(early) < len(late) else late)
    return alone + parts


def find_difference(compared: ComparedRuns) -> RunDifference | None:
    """What some runs of a session have otherwise than the rest.

    None where they are alike, or too few.

    It is the difference by which most is gained. Only partings whose odd runs the rest foretell
    worst are looked into.
    """
    if len(compared.runs) < FEWEST_RUNS:
        return None
    all_odd = partings(len(compared.runs))
    least = float(np.log(len(all_odd) / LIMIT.chance))
    suspects = sorted(all_odd, key=lambda odd: Parting(compared, odd).excess(), reverse=True)
    differences: list[RunDifference] = []
    for odd in suspects[: LIMIT.suspects]:
        parting = Parting(compared, odd)
        if parting.possible() < least:
            continue
        other = parting.another_arm(least)
        if other is not None:
            differences.append(other)
        differences += parting.conventions(least)
    return max(differences, key=lambda difference: difference.gain, default=None)
