"""Entries of our own: diagnosis or comparison, and plain methods, answer the sessions of a board.

Each answers a session from its own files alone.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from ident.benchmark.board.baselines import (
    Residual,
    name_by_bic,
    name_by_correlation,
    name_by_dense_fit,
    name_by_lasso,
    plain_answer,
    spread_unnamed,
    undecided_record,
)
from ident.benchmark.board.files import Board, write_columns
from ident.benchmark.board.foretelling import (
    Torque,
    at_rows,
    edited_torque,
    fitted_torque,
    plain_torque,
    prepared,
    read_unseen,
    urdf_torque,
)
from ident.benchmark.board.ours import as_diagnosis, our_answer
from ident.benchmark.board.unnamed import COMPARISON, DIAGNOSIS, load_shares
from ident.checks.report import TelemetryReport
from ident.diagnosis.change.from_reports import compare_reports
from ident.diagnosis.from_reports import diagnose_reports
from ident.effects.catalogue import CATALOGUE
from ident.errors import InputError
from ident.files import write_record
from ident.motion.motion import Motion, prepare
from ident.motion.settings import FOR_DIAGNOSIS
from ident.outputs import begin_folder
from ident.recordings.recording import Recording
from ident.records import JsonRecord
from ident.regression.gram import Evidence
from ident.regression.least_squares import Prior
from ident.robot.arm import ArmModel
from ident.sessions import Given, inspect_sources

OURS = "armgap"
ANSWERS_KIND = "board entries"
NOTHING = "nothing_named"
DENSE = "least_squares"
CORRELATION = "largest_correlation"
BIC = "bic_forward"
LASSO = "lasso"
BASELINES = (NOTHING, DENSE, CORRELATION, BIC, LASSO)


@dataclass
class Attempt:
    """What all methods say of a session."""

    verdict: str = "refused"
    answers: dict[str, JsonRecord] = field(default_factory=dict)  # by method
    foretold: dict[str, Torque] = field(default_factory=dict)  # by method, at the unseen rows


def answer_board(
    board: Board,
    out: Path,
    limit: int | None = None,
    say: Callable[[str], None] = lambda line: None,
) -> int:
    """Answers all sessions that have no answer yet, by our own and all plain methods.

    Args:
        board: What is to be answered.
        out: Gets a folder for each method.
        limit: Sessions at most; all if None.
        say: Is told each session as it is done.

    Returns:
        How many sessions were answered now.

    Raises:
        InputError: The folder holds something else.
    """
    begin_folder(out, ANSWERS_KIND)
    waiting = [name for name in board.sessions if not (out / OURS / f"{name}.json").is_file()]
    for name in waiting[:limit]:
        say(f"{name} {answer_session(board, name, out)}")
    return len(waiting[:limit])


def answer_session(board: Board, name: str, out: Path) -> str:
    """Answers a session by all methods and writes the files; returns our verdict."""
    attempt = Attempt()
    attempt.answers[NOTHING] = plain_answer(name, [], list(board.effects))
    try:
        if board.before_folder(name) is None:
            _answer_alone(board, name, attempt)
        else:
            _answer_with_before(board, name, attempt)
    except InputError as error:
        attempt.verdict = str(error)
    joints = board.sessions[name]["joints"]
    for method, torque in attempt.foretold.items():
        _write_torque(out / method / f"{name}.parquet", joints, torque)
    # Ours comes last: where it is, the session is done.
    for method in (*BASELINES, OURS):
        answer = attempt.answers.get(method) or undecided_record(name, board)
        write_record(out / method / f"{name}.json", spread_unnamed(answer, board, joints))
    return attempt.verdict


def _answer_alone(board: Board, name: str, attempt: Attempt) -> None:
    """By a diagnosis against the URDF; what is named is taken out of what is foretold."""
    folder = board.session_folder(name)
    arm, reports = inspect_sources(Given([folder], folder / "robot.urdf")).whole
    diagnosis, analysis, motions = diagnose_reports(reports, arm, CATALOGUE)
    attempt.verdict = diagnosis.verdict
    record = diagnosis.to_dict()
    attempt.answers[OURS] = our_answer(name, record, board, load_shares(DIAGNOSIS))
    unseen = read_unseen(board, name)
    if unseen is not None:
        foretold = _by_all(arm, motions, unseen)
        if len(motions):
            motion = prepared(unseen)
            edited = edited_torque(record, arm.keeping(motions[0].joints), motion)
            foretold[OURS] = at_rows(edited, motion, unseen)
        attempt.foretold = foretold
    if analysis is not None:
        evidence = analysis.conclusion.inference.best.model.sums.evidence
        prior = Prior.of(evidence, analysis.baseline.prior)
        said = _named_plainly(name, evidence, prior, diagnosis.joints, list(board.effects))
        attempt.answers |= said


def _answer_with_before(board: Board, name: str, attempt: Attempt) -> None:
    """By a comparison with the arm before; what is foretold is fitted on that."""
    folder = board.session_folder(name)
    before = board.before_folder(name)
    assert before is not None
    arm, reports = inspect_sources(Given([before, folder], folder / "robot.urdf")).whole
    unseen = read_unseen(board, name)
    if unseen is not None:
        attempt.foretold = _foretell_from(reports[0], arm, unseen)
    comparison = compare_reports(reports[:1], reports[1:], arm)
    attempt.verdict = comparison.verdict
    record = as_diagnosis(comparison.to_dict())
    attempt.answers[OURS] = our_answer(name, record, board, load_shares(COMPARISON))
    if comparison.told is not None:
        design = comparison.told.likely.design
        evidence = design.sums.evidence
        joints = comparison.joints
        said = _named_plainly(name, evidence, design.prior, joints, list(board.effects))
        attempt.answers |= said


def _foretell_from(
    report: TelemetryReport,
    arm: ArmModel,
    unseen: Recording,
) -> dict[str, Torque]:
    """By all methods, each fitted on the arm before."""
    motions = prepare(report.session, settings=FOR_DIAGNOSIS)
    foretold = _by_all(arm, motions, unseen)
    motion = prepared(unseen)
    fitted = fitted_torque(arm.keeping(unseen.joints), motions, motion)
    foretold[OURS] = at_rows(fitted, motion, unseen)
    return foretold


def _by_all(
    arm: ArmModel,
    motions: Sequence[Motion],
    unseen: Recording,
) -> dict[str, Torque]:
    """By the URDF alone, and by plain least squares where something could be fitted."""
    arm = arm.keeping(unseen.joints)
    motion = prepared(unseen)
    foretold = {NOTHING: at_rows(urdf_torque(arm, motion), motion, unseen)}
    if len(motions):
        fitted = plain_torque(arm.keeping(motions[0].joints), motions, motion)
        foretold[DENSE] = at_rows(fitted, motion, unseen)
    return foretold


def _named_plainly(
    name: str,
    evidence: Evidence,
    prior: Prior,
    joints: Sequence[str],
    effects: Sequence[str],
) -> Mapping[str, JsonRecord]:
    """Answers of the plain methods that name something."""
    left = Residual.of(evidence, prior, joints, effects)
    names = {
        DENSE: name_by_dense_fit(left),
        CORRELATION: name_by_correlation(left),
        LASSO: name_by_lasso(left),
        BIC: name_by_bic(evidence, prior, left),
    }
    return {method: plain_answer(name, said, effects) for method, said in names.items()}


def _write_torque(path: Path, joints: Sequence[str], torque: Torque) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    columns = {f"{joint}/effort": torque[:, k] for k, joint in enumerate(joints)}
    write_columns(columns, path)
