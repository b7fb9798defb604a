"""Laws of a zero that moves once in a session: a few degrees are told; loads, warmth and sound sessions are no step."""

import itertools
from pathlib import Path

import numpy as np
import pytest
from conftest import make_run
from faults import spoil
from real_arms import load_real
from test_odd_runs import move_zero, warmed

from ident.checks.odd_runs import check_odd_runs
from ident.checks.parting import ComparedRuns
from ident.checks.zero_steps import find_zero_step
from ident.recordings.recording import Payload, Session
from ident.robot.arm import ArmModel

RUNS = 10


def session(arm: ArmModel, seed: int, runs: int = RUNS) -> Session:
    """Sound runs of 6 s."""
    rng = np.random.default_rng(seed)
    return Session("sound", tuple(make_run(arm, rng, f"run{k}", 20.0 * k, 6.0) for k in range(runs)))


@pytest.mark.parametrize(("joint", "angle", "first"), [(1, 0.1, 5), (2, -0.1, 4), (1, -0.12, 7)])
def test_a_zero_that_moves_by_a_few_degrees_is_named(joint: int, angle: float, first: int, arm: ArmModel) -> None:
    """Law: with its joint, its size and the fewer runs, counted as read by the others."""
    moved = session(arm, 3)
    for number in range(first, RUNS):
        moved = spoil(moved, move_zero(joint, angle), number)
    _, (issue,) = check_odd_runs(moved, arm)
    assert (issue.issue, issue.severity) == ("zero_shifted", "fatal")
    assert issue.joints == (arm.joint_names[joint],)
    are_early_odd = first < RUNS - first
    odd = range(first) if are_early_odd else range(first, RUNS)
    assert ", ".join(f"run{number}" for number in odd) + ": the zero" in issue.evidence
    told = float(issue.evidence.partition("moved by ")[2].partition(" rad")[0])
    assert told == pytest.approx(-angle if are_early_odd else angle, abs=0.04)


@pytest.mark.parametrize("mass", [0.5, 2.0])
def test_a_load_that_is_taken_up_is_no_zero(mass: float, arm: ArmModel) -> None:
    """Law: a load of the hand from some run on pulls at several joints; no zero is said to have moved."""
    loaded = arm.with_payload(Payload(mass, (0.0, 0.02, 0.1)))
    rng = np.random.default_rng(5)
    arms = [arm] * 5 + [loaded] * 5
    runs = [make_run(one, rng, f"run{k}", 20.0 * k, 6.0) for k, one in enumerate(arms)]
    assert find_zero_step(ComparedRuns(Session("loaded", tuple(runs)), arm)) is None


@pytest.mark.parametrize("seed", range(5))
def test_sound_sessions_hold_no_step(seed: int, arm: ArmModel) -> None:
    assert find_zero_step(ComparedRuns(session(arm, seed), arm)) is None


def test_friction_that_steps_is_no_zero(arm: ArmModel) -> None:
    """Law: each run has losses of its own."""
    cold = session(arm, 7)
    for number in range(3, RUNS):
        cold = spoil(cold, warmed(0.7), number)
    assert find_zero_step(ComparedRuns(cold, arm)) is None


def test_of_three_runs_no_step_is_told(arm: ArmModel) -> None:
    """Law: two of them have no scatter to hold a step against."""
    three = spoil(session(arm, 3, runs=3), move_zero(1, 0.3), 2)
    assert find_zero_step(ComparedRuns(three, arm)) is None


@pytest.mark.real
def test_pieces_of_another_motion_are_no_zero_that_moved(real_data: Path) -> None:
    """Law: runs that are foretold far worse at other joints have something else, which a zero may imitate at one.

    Every second piece of three recordings: those of the last, a faster motion, are odd at joints 1 and 2 above all.
    """
    recorded, arm = load_real("dual arm", real_data)
    runs = [
        run.at(rows, f"{run.name}_{piece}")
        for run in recorded.runs
        for piece, rows in enumerate(pieces_of(len(run)))
        if piece % 2 == 0
    ]
    compared = ComparedRuns(recorded.replace(runs=runs), arm)
    assert len(compared.runs) == 9
    assert find_zero_step(compared) is None


def pieces_of(rows: int) -> list[slice]:
    """Six pieces of equally many rows."""
    ends = np.linspace(0, rows, 7).astype(int)
    return [slice(first, last) for first, last in itertools.pairwise(ends)]
