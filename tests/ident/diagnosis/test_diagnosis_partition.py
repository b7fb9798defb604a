"""How time is cut into blocks and folds, and how fast logs come to a slower grid."""

from dataclasses import replace

import numpy as np
import pytest

from ident.diagnosis.diagnose import Analysis
from ident.effects.base import SessionContext
from ident.motion.filter import Lowpass
from ident.motion.motion import prepare
from ident.motion.settings import FOR_DIAGNOSIS
from ident.regression.decimation import prepare_slower
from ident.regression.partition import build_partition
from ident.regression.settings import USUAL_REGRESSION, RegressionSettings
from ident.robot.arm import ArmModel
from tests.ident.diagnosis.planted import analyse, healthy_torque, stribeck_on_1
from tests.ident.made_up import made_session


@pytest.fixture(scope="module")
def held(short_arm: ArmModel) -> Analysis:
    return analyse(short_arm, stribeck_on_1)


def in_pieces(session: SessionContext, pieces: list[int]) -> SessionContext:
    """The first runs of a session, each as if cut into so many pieces; their length is that of the whole."""
    runs = [
        replace(run, motion=replace(run.motion, continues=k > 0))
        for run, count in zip(session.runs, pieces, strict=False)
        for k in range(count)
    ]
    return replace(session, runs=tuple(runs))


def folds_of_pieces(session: SessionContext, settings: RegressionSettings = USUAL_REGRESSION) -> list[set[int]]:
    """The folds that each run's, or piece's, blocks lie in."""
    partition = build_partition(session, settings)
    lengths = [run.motion.filtered_length for run in session.runs]
    return [{int(f) for f in partition.folds[partition.blocks_of(k, length)]} for k, length in enumerate(lengths)]


@pytest.mark.parametrize("lone", [256, 10, 5])
def test_pieces_of_a_run_share_its_fold(held: Analysis, lone: int) -> None:
    """Law: what one recorded run was cut into is held out together, whether pieces have blocks of their own or share
    them, and whether recorded runs do; otherwise what the next piece shows would be known from its neighbour.
    """
    settings = replace(USUAL_REGRESSION, most_lone_runs=lone)
    if lone < 256:
        settings = replace(settings, most_blocks=lone - 2)
    pieces = [4, 1, 3, 5, 2, 1]
    folds = folds_of_pieces(in_pieces(held.session, pieces), settings)
    of_run = [set.union(*folds[end - count : end]) for count, end in zip(pieces, np.cumsum(pieces), strict=True)]
    assert all(len(each) == 1 for each in of_run)
    assert len(set.union(*of_run)) >= 3


def test_a_long_run_alone_is_held_out_in_stretches(held: Analysis) -> None:
    """Law: of fewer than five recorded runs, folds are stretches of time, however many pieces these lie in."""
    folds = folds_of_pieces(in_pieces(held.session, [6, 6]))
    assert set.union(*folds) == set(range(10))
    assert [min(each) for each in folds] == sorted(min(each) for each in folds)


def test_a_long_run_alone_has_folds_where_pieces_share_blocks(held: Analysis) -> None:
    """Law: hours recorded as one run are held out in stretches too; in one fold nothing would be left to learn from."""
    settings = replace(USUAL_REGRESSION, most_lone_runs=5, most_blocks=4)
    for pieces in ([6], [6, 6]):
        assert set.union(*folds_of_pieces(in_pieces(held.session, pieces), settings)) == set(range(4))


def test_a_run_that_alone_shows_a_joint_is_not_left_out_whole(held: Analysis) -> None:
    """Law: where a joint moves in one run more than in all others together, every fold has some of every run."""
    runs = list(held.session.runs)
    for k, run in enumerate(runs[1:], start=1):
        dq = run.motion.dq.copy()
        dq[:, 0] *= 1e-3
        runs[k] = replace(run, motion=replace(run.motion, dq=dq))
    assert all(len(each) == 1 for each in folds_of_pieces(held.session))
    assert all(len(each) > 1 for each in folds_of_pieces(replace(held.session, runs=tuple(runs))))


CUTOFF = 25.0


def test_filtered_signals_are_those_of_the_fast_log(short_arm: ArmModel) -> None:
    """Law: torque and states pass the common filter as they would have at 1 kHz, within 2 %."""
    session = made_session(short_arm, lambda *x: healthy_torque(short_arm, *x), (1,), 6.0, 1000.0)
    (fast,) = prepare(session, CUTOFF, settings=FOR_DIAGNOSIS)
    (slow,) = prepare_slower(session, CUTOFF)
    assert (fast.lowpass.rate, slow.lowpass.rate) == pytest.approx((1000.0, 125.0))
    assert slow.lowpass.cutoff == pytest.approx(fast.lowpass.cutoff)
    inner, whole = slice(20, -20), Lowpass(fast.lowpass.rate, CUTOFF, 1)
    for name in ("tau", "dq", "ddq"):
        exact = np.stack(
            [np.interp(slow.time[slow.coarse], fast.time, v) for v in whole(getattr(fast, name)).T], axis=1
        )
        found = slow.filtered(getattr(slow, name))
        assert np.abs(found - exact)[inner].max() < 0.02 * np.abs(exact).max()
