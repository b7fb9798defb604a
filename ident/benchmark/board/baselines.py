"""Plain methods on the same columns as the diagnosis: what each names, and what plain least squares
foretell. None of them is tuned to a board.

A name of a plain method gets half of the probability, and all other answers share the rest evenly.
"""

from __future__ import annotations

from collections.abc import Container, Sequence
from dataclasses import dataclass
from warnings import catch_warnings

import numpy as np
from sklearn.linear_model import lars_path_gram

from ident.arrays import Array, Float
from ident.benchmark.board.case import NONE, OTHER
from ident.benchmark.board.entry import SCHEMA
from ident.benchmark.board.files import Board
from ident.benchmark.examining import forward_by_bic
from ident.motion.motion import Motion
from ident.records import JsonRecord
from ident.regression.design import Group
from ident.regression.gram import Evidence
from ident.regression.least_squares import Prior, project
from ident.robot.arm import ArmModel

NAMED_SHARE = 0.5
MOST_STEPS = 40  # of the lasso's path
# Columns of which the ordinary model leaves less than this share are taken for absorbed.
LEAST_LEFT = 1e-6
# Ridge of the dense fit as a share of each column's power: only keeps it solvable.
DENSE_RIDGE = 1e-6
# Singular values of a regressor below this share of the largest count as none.
LEAST_SINGULAR = 1e-6
UNNAMED = "unnamed"
"""Key of an answer in the making: the probability of each effect without a row."""
Name = tuple[str, str]
"""Effect and joint; no joint for an effect of the whole arm."""


def plain_answer(session: str, names: Sequence[Name], effects: Sequence[str]) -> JsonRecord:
    """An answer that gives half to its names, or to `none` without any, the rest to all others.

    Args:
        session: Its name.
        names: Pairs of effect and joint.
        effects: Ids of all effects of the board.

    Returns:
        The record of an answer file.
    """
    said = list(dict.fromkeys(names))
    labels = [NONE, OTHER, *effects]
    chosen = {effect for effect, _ in said} or {NONE}
    rest = (1.0 - NAMED_SHARE) / (len(labels) - len(chosen))
    share = NAMED_SHARE / max(len(said), 1)
    rows = [{"effect": effect, "joint": joint, "probability": share} for effect, joint in said]
    record: JsonRecord = {"schema": SCHEMA, "session": session, "effects": rows}
    record[UNNAMED] = rest
    record[NONE] = rest if said else NAMED_SHARE
    record[OTHER] = rest
    return record


def spread_unnamed(record: JsonRecord, board: Board, joints: Sequence[str]) -> JsonRecord:
    """The answer with a row for each effect that has none, at the first joint or the whole arm."""
    share = record.pop(UNNAMED, None)
    if share is None:  # all effects have a row
        return record
    named = {row["effect"] for row in record["effects"]}
    for effect, facts in board.effects.items():
        if effect not in named:
            joint = "" if facts["scope"] == "arm" else joints[0]
            record["effects"].append({"effect": effect, "joint": joint, "probability": share})
    return record


def undecided_record(name: str, board: Board) -> JsonRecord:
    """The record of an answer that holds everything equally probable, `none` and `other` too."""
    share = 1.0 / (len(board.effects) + 2)
    head = {"schema": SCHEMA, "session": name, "effects": []}
    record = {**head, NONE: share, OTHER: share, UNNAMED: share}
    return spread_unnamed(record, board, board.sessions[name]["joints"])


def plain_gram(evidence: Evidence) -> Float[Array, "P P"]:
    """Unwhitened sums of all columns, each joint in units of its noise."""
    size = evidence.layout.size + 1
    gram = np.zeros((size, size))
    sums = zip(evidence.layout.local, evidence.plain, evidence.whitening.level, strict=True)
    for local, joint_sums, level in sums:
        gram[np.ix_(local, local)] += joint_sums.over() / max(float(level), 1e-9) ** 2
    return gram


@dataclass(frozen=True, eq=False)
class Residual:
    """What an ordinary model (bodies, rotor, viscous and Coulomb friction, offset) leaves of the
    torque and of every candidate's columns.
    """

    groups: tuple[Group, ...]
    columns: Float[Array, " K"]  # numbers of the candidates' columns that are not absorbed
    gram: Float[Array, "K K"]  # their sums, each column of power one
    target: Float[Array, " K"]  # their sums with the torque
    power: float  # sum of the torque's squares
    samples: int
    joints: tuple[str, ...]

    @classmethod
    def of(
        cls,
        evidence: Evidence,
        prior: Prior,
        joints: Sequence[str],
        effects: Container[str],
    ) -> Residual:
        """What is left for those candidates that are listed."""
        gram = plain_gram(evidence)
        projection = project(gram, evidence, prior)
        groups = tuple(group for group in evidence.layout.groups if group.effect.id in effects)
        listed = np.unique(np.concatenate([group.columns for group in groups]))
        both = np.append(listed, evidence.layout.size)
        rest = projection.rest(both)
        left = np.diag(rest)[:-1]
        seen = left > LEAST_LEFT * np.diag(gram)[listed]
        scale = np.sqrt(left[seen])
        inner = rest[:-1, :-1][np.ix_(seen, seen)] / np.outer(scale, scale)
        target = rest[:-1, -1][seen] / scale
        samples = int(sum(evidence.weights.sum(axis=0)))
        power = float(rest[-1, -1])
        return cls(groups, listed[seen], inner, target, power, samples, tuple(joints))

    def name_of(self, group: Group) -> Name:
        """A group's effect, and its joint; "" in place of a joint for one of the whole arm."""
        joint = self.joints[group.joint] if group.effect.scope == "joint" else ""
        return group.effect.id, joint

    def places(self, group: Group) -> Array:
        """Where a candidate's columns stand among those that are left."""
        return np.flatnonzero(np.isin(self.columns, group.columns))

    def strongest(self, sizes: Float[Array, " K"]) -> list[Name]:
        """The candidate whose columns, at some coefficients, make the most torque; none of none."""
        best: list[Name] = []
        most = 0.0
        for group in self.groups:
            places = self.places(group)
            made = float(sizes[places] @ self.gram[np.ix_(places, places)] @ sizes[places])
            if made > most:
                best = [self.name_of(group)]
                most = made
        return best


def name_by_correlation(left: Residual) -> list[Name]:
    """The candidate with the column that goes best with what is left of the torque."""
    correlation = np.abs(left.target) / np.sqrt(max(left.power, 1e-12))
    column = left.columns[int(np.argmax(correlation))] if len(correlation) else -1
    return [left.name_of(group) for group in left.groups if column in group.columns][:1]


def name_by_dense_fit(left: Residual) -> list[Name]:
    """The candidate that makes the most torque where all columns are fitted at once."""
    count = len(left.target)
    matrix = left.gram + DENSE_RIDGE * np.eye(count)
    return left.strongest(np.linalg.solve(matrix, left.target)) if count else []


def name_by_lasso(left: Residual) -> list[Name]:
    """The candidate that makes the most torque at the step of the lasso's path of least BIC."""
    if not len(left.target):
        return []
    with catch_warnings(action="ignore"):  # columns that say the same are dropped, as they should
        _, _, path = lars_path_gram(
            left.target,
            left.gram,
            n_samples=left.samples,
            method="lasso",
            max_iter=MOST_STEPS,
        )
    best = np.zeros(len(left.target))
    least = left.samples * np.log(max(left.power, 1e-12))
    for sizes in path.T:
        squares = left.power - 2.0 * left.target @ sizes + sizes @ left.gram @ sizes
        count = np.count_nonzero(sizes)
        bic = left.samples * np.log(max(squares, 1e-12)) + count * np.log(left.samples)
        if bic < least:
            best = sizes
            least = bic
    return left.strongest(best)


def name_by_bic(evidence: Evidence, prior: Prior, left: Residual) -> list[Name]:
    """Candidates by forward selection, each lowering BIC most; those that are listed."""
    chosen = forward_by_bic(evidence, prior)
    listed = {group.key for group in left.groups}
    return [left.name_of(group) for group in chosen if group.key in listed]


# Prediction


def plain_columns(arm: ArmModel, motion: Motion) -> Float[Array, "T n p"]:
    """Bodies, rotor, viscous and Coulomb friction, and offset of each joint."""
    bodies = arm.regressor(motion.q, motion.dq, motion.ddq)
    slip = np.tanh(motion.dq / np.maximum(motion.rest_speed, 1e-6))
    losses = (motion.ddq, motion.dq, slip, np.ones_like(motion.dq))
    by_joint = [values[:, :, None] * np.eye(motion.n) for values in losses]
    return np.concatenate([bodies, *by_joint], axis=2)


def fit_plain(arm: ArmModel, motions: Sequence[Motion]) -> Float[Array, " p"]:
    """Weighted least squares of all columns; what no motion shows stays zero."""
    rows: list[Array] = []
    torques: list[Array] = []
    for motion in motions:
        rows.append(motion.filtered(plain_columns(arm, motion)))
        torques.append(motion.tau_filtered)
    columns = np.concatenate(rows)
    torque = np.concatenate(torques)
    noise = np.ones(torque.shape[1])
    for _ in range(2):  # once plain, once weighted by what each joint leaves
        weighted = (columns / noise[:, None]).reshape(-1, columns.shape[2])
        estimate = np.linalg.lstsq(weighted, (torque / noise).ravel(), rcond=LEAST_SINGULAR)[0]
        noise = np.sqrt(np.mean((torque - columns @ estimate) ** 2, axis=0)) + 1e-9
    return np.asarray(estimate)
