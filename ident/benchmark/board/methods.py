"""Entries of our own: the diagnosis and plain methods answer the sessions of a board, each from its
own files alone.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ident.arrays import Array, Float
from ident.benchmark.board.baselines import (
    UNNAMED,
    Residual,
    fit_plain,
    name_by_bic,
    name_by_correlation,
    name_by_dense_fit,
    name_by_lasso,
    plain_answer,
    plain_columns,
    spread_unnamed,
)
from ident.benchmark.board.case import NONE, OTHER
from ident.benchmark.board.entry import SCHEMA
from ident.benchmark.board.files import Board, joint_columns, read_columns, write_columns
from ident.benchmark.run import edited_arm
from ident.diagnosis.diagnose import Analysis
from ident.diagnosis.from_reports import diagnose_reports
from ident.diagnosis.result import Diagnosis
from ident.effects.catalogue import CATALOGUE
from ident.errors import InputError
from ident.export.identified import IdentifiedArm
from ident.export.loaded import LawModel
from ident.files import write_record
from ident.motion.motion import Motion, prepare
from ident.motion.settings import FOR_DIAGNOSIS
from ident.recordings.recording import Recording, Session
from ident.robot.arm import ArmModel
from ident.sessions import Given, inspect_sources

OURS = "armgap"
NOTHING, DENSE = "nothing_named", "least_squares"
CORRELATION, BIC, LASSO = "largest_correlation", "bic_forward", "lasso"
BASELINES = (NOTHING, DENSE, CORRELATION, BIC, LASSO)
NOT_FITTED = ("refused", "not_testable")
"""Verdicts without a word on causes."""
Torque = Float[Array, "T n"]


def answer_board(
    board: Board,
    out: Path,
    limit: int | None = None,
    say: Callable[[str], None] = lambda line: None,
) -> int:
    """Answers all sessions that have no answer yet, by the diagnosis and all plain methods.

    Args:
        board: What is to be answered.
        out: Gets a folder for each method.
        limit: Sessions at most; all if None.
        say: Is told each session as it is done.

    Returns:
        How many sessions were answered now.
    """
    waiting = [name for name in board.sessions if not (out / OURS / f"{name}.json").is_file()]
    for name in waiting[:limit]:
        say(f"{name} {answer_session(board, name, out)}")
    return len(waiting[:limit])


def answer_session(board: Board, name: str, out: Path) -> str:
    """Answers a session by all methods and writes the files; returns the diagnosis' verdict."""
    folder = board.session_folder(name)
    unseen = read_unseen(board, name)
    foretold: dict[str, Torque] = {}
    answers = {NOTHING: plain_answer(name, [], list(board.effects))}
    verdict = "refused"
    try:
        arm, reports = inspect_sources(Given([folder], folder / "robot.urdf")).whole
        diagnosis, analysis, motions = diagnose_reports(reports, arm, CATALOGUE)
        verdict = diagnosis.verdict
        record = diagnosis.to_dict()
        answers[OURS] = our_answer(name, record, board)
        if unseen is not None:
            foretold = foretell(diagnosis, record, arm, motions, unseen)
        if analysis is not None:
            answers |= named_plainly(name, analysis, list(board.effects))
    except InputError as error:
        verdict = str(error)
    joints = board.sessions[name]["joints"]
    for method, torque in foretold.items():
        _write_torque(out / method / f"{name}.parquet", joints, torque)
    # Ours comes last: where it is, the session is done.
    for method in (*BASELINES, OURS):
        answer = answers.get(method) or undecided_record(name, board)
        write_record(out / method / f"{name}.json", spread_unnamed(answer, board, joints))
    return verdict


def named_plainly(name: str, analysis: Analysis, effects: Sequence[str]) -> dict[str, Any]:
    """Answers of the plain methods that name something."""
    left = Residual.of(analysis)
    names = {
        DENSE: name_by_dense_fit(left),
        CORRELATION: name_by_correlation(left),
        LASSO: name_by_lasso(left),
        BIC: name_by_bic(analysis, left),
    }
    return {method: plain_answer(name, said, effects) for method, said in names.items()}


def undecided_record(name: str, board: Board) -> dict[str, Any]:
    """An answer that holds everything equally probable."""
    share = 1.0 / (len(board.effects) + 2)
    head = {"schema": SCHEMA, "session": name, "effects": []}
    record = {**head, NONE: share, OTHER: share, UNNAMED: share}
    return spread_unnamed(record, board, board.sessions[name]["joints"])


# Ours


def our_answer(name: str, record: Mapping[str, Any], board: Board) -> dict[str, Any]:
    """A diagnosis as an answer.

    Causes are taken as independent: with the probability that any is there, one of them is the
    cause, in proportion to their own; a class shares its probability beyond that of its first
    evenly. What is left is none or other, as the score of a cause outside the catalogue says. A
    share of one in all answers and one more goes to all of them evenly: nothing is impossible.
    """
    if record["verdict"] in NOT_FITTED:
        return undecided_record(name, board)
    joints = board.sessions[name]["joints"]
    rows = _rows([*record["findings"], *record["reservations"]], board, joints)
    weights = [row.pop("weight") for row in rows]
    missing = float(np.prod([1.0 - row.pop("whole") for row in rows]))
    total = sum(weights)
    labels = len(board.effects) + 2
    smooth = 1.0 / (labels + 1)
    even = smooth / labels
    certain = (1.0 - smooth) * (1.0 - missing if total > 0.0 else 0.0)
    for row, weight in zip(rows, weights, strict=True):
        row["probability"] = certain * weight / total if total > 0.0 else 0.0
    outside = record.get("outside_score") or 0.0
    answer: dict[str, Any] = {"schema": SCHEMA, "session": name, "effects": rows}
    rest = 1.0 - smooth - certain
    answer[NONE] = rest * (1.0 - outside) + even
    answer[OTHER] = rest * outside + even
    for row in rows:  # every effect has its even share once
        first = next(other for other in rows if other["effect"] == row["effect"])
        row["probability"] += even if first is row else 0.0
    return spread_unnamed({**answer, UNNAMED: even}, board, joints)


def _rows(
    findings: Sequence[Mapping[str, Any]],
    board: Board,
    joints: Sequence[str],
) -> list[dict[str, Any]]:
    """Names with a probability, and others of their classes; `whole` stands at the first alone."""
    rows: list[dict[str, Any]] = []
    for finding in findings:
        effect = finding.get("effect")
        first = finding.get("probability")
        if not effect or first is None or effect not in board.effects:
            continue
        whole = float(finding.get("class_probability", first))
        members = [effect, *(member for member in finding.get("class", ()) if member != effect)]
        joint = _joint(effect, finding["joints"], board, joints)
        row: dict[str, Any] = {"effect": effect, "joint": joint, "class": members}
        row["parameters"] = _parameters(finding.get("parameters", {}))
        row["weight"] = float(first)
        row["whole"] = min(whole, 1.0)
        rows.append(row)
        for member in members[1:]:
            place = _joint(member, finding["joints"], board, joints)
            beside: dict[str, Any] = {"effect": member, "joint": place, "class": members}
            beside["weight"] = max(whole - float(first), 0.0) / (len(members) - 1)
            beside["whole"] = 0.0
            rows.append(beside)
    return rows


def _joint(effect: str, places: Sequence[str], board: Board, joints: Sequence[str]) -> str:
    if board.effects[effect]["scope"] == "arm":
        return ""
    return str(places[0]) if places else joints[0]


def _parameters(given: Mapping[str, Any]) -> dict[str, dict[str, float]]:
    parameters: dict[str, dict[str, float]] = {}
    for key, interval in given.items():
        if not isinstance(interval, Mapping):
            continue
        ends = {word: interval.get(word) for word in ("value", "low", "high")}
        if all(isinstance(end, int | float) for end in ends.values()):
            parameters[key] = {word: float(end) for word, end in ends.items() if end is not None}
    return parameters


# Prediction


def read_unseen(board: Board, name: str) -> Recording | None:
    """The motion of a session that is to be foretold; None where there is none."""
    if not board.sessions[name]["unseen"]:
        return None
    path = board.unseen_file(name)
    columns = read_columns(path, "get the board anew")
    joints = board.sessions[name]["joints"]
    position = joint_columns(columns, joints, "position", path)
    velocity = None
    if f"{joints[0]}/velocity" in columns:
        velocity = joint_columns(columns, joints, "velocity", path)
    still = np.zeros_like(position)
    return Recording(name, tuple(joints), columns["time"], position, still, velocity)


def foretell(
    diagnosis: Diagnosis,
    record: Mapping[str, Any],
    arm: ArmModel,
    motions: Sequence[Motion],
    unseen: Recording,
) -> dict[str, Torque]:
    """Torque of the unseen motion by the URDF alone, by plain least squares, and by the diagnosed
    arm with everything that was named taken out of it.
    """
    arm = arm.keeping(unseen.joints)
    motion = prepare(Session("unseen", (unseen,)), settings=FOR_DIAGNOSIS)[0]
    foretold = {NOTHING: _law_torque(IdentifiedArm.as_urdf(arm), motion)}
    if len(motions):
        arm = arm.keeping(motions[0].joints)
        foretold[DENSE] = plain_columns(arm, motion) @ fit_plain(arm, motions)
        every = range(len(diagnosis.findings))
        foretold[OURS] = _law_torque(edited_arm(record, arm, every), motion)
    return {method: _at_rows(torque, motion, unseen) for method, torque in foretold.items()}


def _law_torque(identified: IdentifiedArm, motion: Motion) -> Torque:
    model = LawModel.of(identified)
    torque = model.joint_torque(motion.q, motion.dq, motion.ddq, motion.interval)
    return np.asarray(model.read_log(torque, motion.interval))


def _at_rows(torque: Torque, motion: Motion, run: Recording) -> Torque:
    """Torque at the rows of the recording."""
    columns = [np.interp(run.time, motion.time, values) for values in torque.T]
    return np.column_stack(columns)


def _write_torque(path: Path, joints: Sequence[str], torque: Torque) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    columns = {f"{joint}/effort": torque[:, k] for k, joint in enumerate(joints)}
    write_columns(columns, path)
