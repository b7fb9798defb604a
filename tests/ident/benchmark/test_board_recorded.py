"""Sessions on recordings: no two hold a row to which something may have come, and no run begins with what a filter
leaves where it is started.
"""

from collections.abc import Callable
from dataclasses import replace
from itertools import combinations, pairwise
from pathlib import Path

import numpy as np
import pytest

from ident.arrays import Array
from ident.benchmark.board.case import PLANTED, BoardCase
from ident.benchmark.board.files import Board, Kept
from ident.benchmark.board.leaks import LEVEL, find_leaks
from ident.benchmark.board.make import BoardWriter
from ident.benchmark.board.recorded import (
    GUARD_S,
    LEAST_PIECE_S,
    GivenRows,
    part_recording,
    split_of,
    unseen_of,
)
from ident.benchmark.board.run_starts import start_roughness
from ident.benchmark.board.shared_rows import find_shared_rows
from ident.recordings.recording import Recording
from ident.robot.arm import ArmModel
from ident.simulation.hardware import without_geometry
from ident.simulation.real.cases import plant_effects
from ident.simulation.real.moved_arm import MovedArm
from ident.simulation.real.sources import Source

RATE_HZ, RECORDED_S = 25.0, 100.0


@pytest.fixture(scope="module")
def recorded() -> Source:
    """A scara that turns round every few seconds, with friction, and a wave that no model has."""
    model = ArmModel.load("scara")
    rng = np.random.default_rng(0)
    time = np.arange(0.0, RECORDED_S, 1.0 / RATE_HZ)
    pace, phase = rng.uniform(0.5, 1.1, model.n), rng.uniform(0.0, 6.0, model.n)
    reach = np.array([0.6, 0.6, 0.05, 0.6])
    angle = np.outer(time, pace) + phase
    q, dq, ddq = reach * np.sin(angle), reach * pace * np.cos(angle), -reach * pace**2 * np.sin(angle)
    wave = 0.2 * np.sin(np.outer(time, [3.0, 3.3, 3.6, 3.9]))
    tau = model.inverse_dynamics(q, dq, ddq) + 0.4 * dq + wave + 1e-4 * rng.standard_normal(q.shape)
    run = Recording("run", model.joint_names, time, q, tau, dq)
    return Source("made", "made", without_geometry(model.urdf), (run,))


def from_the_beginning(stretch: GivenRows) -> MovedArm:
    """What remembers runs over the recording up to the rows of the session."""
    return MovedArm.of(stretch.source, (stretch.rows,))


def in_mid_motion(stretch: GivenRows) -> MovedArm:
    """What remembers begins with the rows of the session, as it once did."""
    return MovedArm.of(replace(stretch.source, runs=(stretch.source.runs[0].at(stretch.rows),)))


def board_of(cases: list[BoardCase], folder: Path) -> tuple[Board, Kept]:
    (folder / "board").mkdir(parents=True)
    (folder / "kept").mkdir()
    writer = BoardWriter(folder / "board", folder / "kept", 3, len(cases))
    for case in cases:
        writer.write(case)
    writer.finish()
    board = Board.load(folder / "board")
    return board, Kept.load(folder / "kept", board)


def cases_of(recorded: Source, arm_of: Callable[[GivenRows], MovedArm]) -> list[BoardCase]:
    """A session for each stretch: the friction of a motor that its neighbour turns, too."""
    parted = part_recording(recorded)
    cases: list[BoardCase] = []
    for number, stretch in enumerate(parted.stretches):
        rng = np.random.default_rng([5, number])
        made = plant_effects(arm_of(stretch), "single", (("joint_coupling", 3.0),), rng)
        if made is None:
            continue
        runs, urdf, answer = made
        effects = tuple(answer["effects"])
        case = BoardCase(PLANTED, "single", "made", urdf, tuple(runs), effects, parted.plain.runs)
        cases.append(case)
    return cases


def test_each_row_is_plain_or_of_one_session(recorded: Source) -> None:
    """Law: plain pieces, stretches and the unseen motion have no row in common, and an instant between each two."""
    parted = part_recording(recorded)
    positions = [run.position for run in parted.plain.runs]
    positions += [stretch.source.runs[0].position[stretch.rows] for stretch in parted.stretches]
    positions.append(unseen_of(recorded).position)
    lines = recorded.runs[0].position.tolist()
    spans = sorted((lines.index(piece[0].tolist()), lines.index(piece[-1].tolist())) for piece in positions)
    for (_, end), (start, _) in pairwise(spans):
        assert start - end > GUARD_S * RATE_HZ - 1.0
    assert spans[-1][0] == split_of(recorded)
    assert len(parted.stretches) >= 8


@pytest.mark.parametrize(("lasts_s", "given", "plain"), [(17.0, 2, 1), (28.5, 3, 2), (22.5, 2, 2)])
def test_a_piece_too_many_goes_to_a_session(recorded: Source, lasts_s: float, given: int, plain: int) -> None:
    """Law: of an odd number of pieces sessions have one more than what all of them know; no side lacks seconds."""
    run = recorded.runs[0].at(slice(0, int(lasts_s * RATE_HZ)))
    parted = part_recording(replace(recorded, runs=(run,)))
    assert len(parted.stretches) == given
    assert len(parted.plain.runs) == plain
    lengths = [stretch.rows.stop - stretch.rows.start for stretch in parted.stretches]
    lengths += [len(piece) for piece in parted.plain.runs]
    assert min(lengths) >= RATE_HZ * (LEAST_PIECE_S - GUARD_S) - 1


def test_runs_of_one_motion_give_each_half_every_part(recorded: Source) -> None:
    """Law: where a motion is recorded again and again, each part of it is plain in one run, and given in another."""
    once = recorded.runs[0].at(slice(0, 500))
    runs = tuple(once.replace(time=once.time + 20.0 * number) for number in range(4))
    parted = part_recording(replace(recorded, runs=runs))
    rows = np.concatenate([run.position for run in parted.plain.runs]).tolist()
    plain = {once.position.tolist().index(row) for row in rows}
    assert len(plain) > 0.85 * len(once)
    for stretch in parted.stretches:
        time = np.concatenate([run.time for run in stretch.source.runs])
        assert time[stretch.rows.start] == 0.0
        given = {row % len(once) for row in range(stretch.rows.start, stretch.rows.stop)}
        assert len(given & plain) > 0.8 * len(given)


def test_no_start_and_no_shared_row_tells_what_was_planted(recorded: Source, tmp_path: Path) -> None:
    """Law: friction started in mid-motion is found at its joint; run from the recording's beginning it is not."""
    starts: dict[str, float] = {}
    for arm_of in (in_mid_motion, from_the_beginning):
        board, kept = board_of(cases_of(recorded, arm_of), tmp_path / arm_of.__name__)
        leaks = find_leaks(board, kept)
        where = [leak.p_value for leak in leaks if leak.figure == "start of runs" and "where" in leak.question]
        starts[arm_of.__name__] = min(where)
        assert find_shared_rows(board) == []
    assert starts["in_mid_motion"] < LEVEL
    assert starts["from_the_beginning"] > LEVEL


def test_rows_that_two_sessions_share_are_found(recorded: Source, tmp_path: Path) -> None:
    """Law: every pair of sessions made of the same rows is told, whatever came to torques or to a joint's zero."""
    after = recorded.runs[0].at(slice(0, 200))
    shift = np.array([0.0, 0.1, 0.0, 0.0])
    changes = ({}, {"effort": after.effort + 1.0}, {"position": after.position + shift})
    cases = [BoardCase(PLANTED, "single", "made", recorded.urdf, (after.replace(**change),), ()) for change in changes]
    board, _ = board_of(cases, tmp_path)
    shared = {(pair.session, pair.other): pair.rows for pair in find_shared_rows(board)}
    names = list(board.sessions)
    assert set(shared) == set(combinations(names, 2)) | {pair[::-1] for pair in combinations(names, 2)}
    assert min(shared.values()) == len(after) - 1


def rough(start: Array) -> float:
    time = np.arange(0.0, 3.0, 0.01)
    torque = np.sin(3.0 * time)
    torque[: len(start)] += start
    return float(start_roughness(torque[:, None], time)[0])


def test_a_start_is_rough_where_it_jumps() -> None:
    """Law: a torque that goes on as it began is not rough, one that begins with a step is, in any unit."""
    calm = rough(np.zeros(1))
    assert calm < 0.1
    assert rough(np.array([1.0, 0.5])) > calm + 3.0
    time = np.arange(0.0, 3.0, 0.01)
    torque = np.sin(3.0 * time)[:, None]
    assert start_roughness(1000.0 * torque, time) == pytest.approx(start_roughness(torque, time))
    assert start_roughness(torque[:5], time[:5]) == pytest.approx(0.0)
