"""Each run of a session held against the others: signs, zeros, scales, columns, clock, and whether it is this arm's.

The runs are parted, one against the rest or an earlier part against a later one. What a parting may gain is told by
foretelling: each run by a model of all others, and so again with a convention of the odd runs undone, or with a model
of their own. Evidence is the sum over runs and joints of the logarithm by which errors shrink: a run counts once at
each joint, however many samples it has, for runs differ more than their samples tell. It must exceed the logarithm of
the number of alternatives over the chance of a false alarm. Runs that only move otherwise are foretold badly, too, and
no change mends that.

Source: Bonferroni's bound on likelihood ratios of many alternatives.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ident.checks.filtered_run import BETWEEN_RUNS as LIMIT
from ident.checks.foretold import RunStates, states_of
from ident.checks.parting import ComparedRuns, Parting, RunDifference
from ident.recordings.recording import Session
from ident.robot.arm import ArmModel

FEWEST_RUNS = 3  # of two runs nobody knows the odd one


def partings(count: int) -> list[tuple[int, ...]]:
    """Each run alone; and the smaller of an earlier and a later part, both of more than one run."""
    alone = [(number,) for number in range(count)]
    parts = []
    for cut in range(2, count - 1):
        early, late = tuple(range(cut)), tuple(range(cut, count))
        parts.append(early if len(early) < len(late) else late)
    return alone + parts


def likeliest_difference(runs: Sequence[RunStates], arm: ArmModel) -> RunDifference | None:
    """The difference by which most is gained; None where there is none.

    Only partings whose odd runs the rest foretell worst are looked into.
    """
    session = ComparedRuns(runs, arm)
    all_partings = [Parting(session, odd) for odd in partings(len(session.runs))]
    least = float(np.log(len(all_partings) / LIMIT.chance))
    suspects = sorted(all_partings, key=lambda parting: parting.excess(), reverse=True)
    told: list[RunDifference] = []
    for parting in suspects[: LIMIT.suspects]:
        if parting.possible() < least:
            continue
        other = parting.another_arm(least)
        if other is not None:
            told.append(other)
        told += parting.conventions(least)
    return max(told, key=lambda difference: difference.gain, default=None)


def find_difference(session: Session, arm: ArmModel) -> RunDifference | None:
    """What some runs of a session have otherwise than the rest; None where they are alike, or too few."""
    states = [run for run in map(states_of, session.runs) if run is not None]
    if len(states) < FEWEST_RUNS:
        return None
    return likeliest_difference(states, arm)
