"""Looks for truths that leak: words in any file of a board, rows that two sessions share, and
figures of a session (rows, times, columns, sizes, how its runs begin) that go with what is wrong in
it.

    python -m ident.benchmark.board.leaks BOARD [--kept FOLDER]

A figure leaks where its ranks differ between sessions of different truths by more than chance: the
spread of the classes' mean ranks, within each tier, against random exchanges of the truths. All
figures together leak where a classifier of them foretells more of the sessions that were left out
than it does of exchanged truths. Where something is wrong leaks where the true joints rank higher
in a figure than drawn ones, or, by size, where the figure is larger there: a few sessions that tell
their joint plainly move few ranks. P-values are Holm's over all figures and questions.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from scipy.stats import rankdata

from ident.arrays import Array, Bool, Float
from ident.benchmark.board.case import DRAWN
from ident.benchmark.board.files import SESSIONS, URDF_FILE, Board, Kept, kept_folder
from ident.benchmark.board.run_starts import start_roughness
from ident.benchmark.board.shared_rows import find_shared_rows

# So many that chance alone gives Holm's p-value of some forty questions room below the level.
EXCHANGES = 10_000
LEVEL = 0.01  # of any false alarm over all figures
ROUNDING = 1e-9  # of sums that are the same but for their order
TOGETHER = "all together"
# Words of answers that no file below `sessions` or `unseen` may hold.
TELLING = ("in_catalogue", "may_stand_at", "planted", "healthy", "untouched", "withheld")


def find_words(
    folder: Path,
    answers: Mapping[str, Mapping[str, Any]],
) -> Iterator[tuple[Path, str]]:
    """Files of sessions and motions that hold a word of an answer, each with the word."""
    effects = {effect["effect"] for answer in answers.values() for effect in answer["effects"]}
    words = [word.encode() for word in sorted({*effects, *TELLING})]
    for path in sorted(folder.rglob("*")):
        if not path.is_file() or path.parent == folder:
            continue
        content = path.read_bytes()
        for word in words:
            if word in content or word in path.name.encode():
                yield path, word.decode()


def figures_of(board: Board, name: str) -> dict[str, float]:
    """What anybody sees of a session without a model of the arm."""
    folder = board.session_folder(name)
    joints = board.sessions[name]["joints"]
    after = Seen.of(folder, joints)
    before_folder = board.before_folder(name)
    before = None if before_folder is None else Seen.of(before_folder, joints)
    unseen = board.unseen_file(name)
    return {
        "place in the list": float(list(board.sessions).index(name)),
        "runs": float(after.runs),
        "rows": float(after.rows),
        "columns": float(after.columns),
        "first time": after.first_time,
        "duration": after.duration,
        "interval": after.interval,
        "jitter": after.jitter,
        "bytes of a number": after.bytes_of_row,
        "bytes of the URDF": float((folder / URDF_FILE).stat().st_size),
        "bytes of the unseen": float(unseen.stat().st_size) if unseen.is_file() else 0.0,
        "values that differ": most_apart(after.distinct, before.distinct if before else None),
        "values repeated": most_apart(after.repeated, before.repeated if before else None),
        "rows before": float(before.rows) if before else 0.0,
        "start of runs": most_apart(after.starts, before.starts if before else None),
        "bytes before": before.bytes_of_row if before else 0.0,
    }


@dataclass(frozen=True, eq=False)
class Seen:
    """What is seen of a folder of runs."""

    runs: int
    rows: int
    columns: int
    first_time: float
    duration: float
    interval: float
    jitter: float
    bytes_of_row: float
    distinct: Float[Array, " n"]  # share of a joint's torques that are unlike all others
    repeated: Float[Array, " n"]  # share of them that are as the one before
    starts: Float[Array, " n"]  # how much rougher they begin than they go on, mean over runs

    @classmethod
    def of(cls, folder: Path, joints: Sequence[str]) -> Seen:
        """Reads a folder of runs."""
        paths = sorted(folder.glob("*.parquet"))
        tables = [pq.read_table(path) for path in paths]
        rows = sum(table.num_rows for table in tables)
        times = [table["time"].to_numpy() for table in tables]
        steps = np.concatenate([np.diff(time) for time in times])
        torques = [_torque_of(table, joints) for table in tables]
        distinct = [len(np.unique(values)) / rows for values in np.concatenate(torques).T]
        changes = np.concatenate([np.diff(torque, axis=0) for torque in torques])
        starts = [start_roughness(*run) for run in zip(torques, times, strict=True)]
        return cls(
            runs=len(paths),
            rows=rows,
            columns=tables[0].num_columns,
            first_time=float(times[0][0]),
            duration=float(times[-1][-1] - times[0][0]),
            interval=float(np.median(steps)),
            jitter=float(np.std(steps) / np.median(steps)),
            bytes_of_row=sum(path.stat().st_size for path in paths) / rows,
            distinct=np.array(distinct),
            repeated=np.mean(changes == 0.0, axis=0),
            starts=np.mean(starts, axis=0),
        )


def _torque_of(table: pa.Table, joints: Sequence[str]) -> Float[Array, "T n"]:
    return np.column_stack([table[f"{joint}/effort"].to_numpy() for joint in joints])


def most_apart(after: Float[Array, " n"], before: Float[Array, " n"] | None) -> float:
    """The joint's share that is farthest from that before; the mean share without a before."""
    if before is None:
        return float(np.mean(after))
    apart = after - before
    return float(apart[np.argmax(np.abs(apart))])


@dataclass(frozen=True)
class Leak:
    """How a figure goes with what is wrong."""

    figure: str
    question: str  # `whether` anything is wrong, `which` effect, or `where`, by rank and by size
    p_value: float  # of chance, Holm's


def find_leaks(board: Board, opened: Kept, seed: int = 0) -> list[Leak]:
    """How well figures that need no method foretell the answers of a board.

    Each figure of a session is held against each question (whether something is wrong, which
    effect, at which joint), and all figures together by a classifier.

    Args:
        board: The public sessions.
        opened: Their answers.
        seed: Of the exchanges of answers between sessions of one tier.

    Returns:
        A p-value for each pair, corrected for their number by Holm's rule, the least first.

    Source: Holm 1979.
    """
    names = list(board.sessions)
    figures = {name: figures_of(board, name) for name in names}
    tiers = np.array([board.sessions[name]["tier"] for name in names])
    effects = []
    for name in names:
        causes = opened.answers[name]["effects"]
        effects.append([cause["effect"] for cause in causes])
    questions = {
        "whether": np.array([bool(causes) for causes in effects], dtype=object),
        "which": np.array(["+".join(causes) for causes in effects], dtype=object),
    }
    rng = np.random.default_rng(seed)
    leaks: list[Leak] = []
    for figure in figures[names[0]]:
        values = np.array([figures[name][figure] for name in names])
        for question, truths in questions.items():
            leaks.append(Leak(figure, question, exchange_p_value(values, truths, tiers, rng)))
    table = np.array([list(figures[name].values()) for name in names])
    for question, truths in questions.items():
        p_value = classifier_p_value(table, truths, tiers, rng)
        leaks.append(Leak(TOGETHER, question, p_value))
    for figure, apart in joints_apart(board).items():
        ranks = {name: rankdata(values) / len(values) for name, values in apart.items()}
        for question, scores in (("where", ranks), ("where, by size", apart)):
            p_value = place_p_value(scores, true_joints(board, opened), rng)
            leaks.append(Leak(figure, question, p_value))
    return holm(leaks)


def joints_apart(board: Board) -> dict[str, dict[str, Float[Array, " n"]]]:
    """How much less rounded each joint's torques are than before, and how much rougher they begin,
    by figure and session.
    """
    differ: dict[str, Float[Array, " n"]] = {}
    repeated: dict[str, Float[Array, " n"]] = {}
    starts: dict[str, Float[Array, " n"]] = {}
    for name, session in board.sessions.items():
        folder = board.before_folder(name)
        if folder is None:
            continue
        after = Seen.of(board.session_folder(name), session["joints"])
        before = Seen.of(folder, session["joints"])
        differ[name] = after.distinct / before.distinct
        repeated[name] = before.repeated - after.repeated
        starts[name] = after.starts - before.starts
    return {"values that differ": differ, "values repeated": repeated, "start of runs": starts}


def true_joints(board: Board, opened: Kept) -> dict[str, Bool[Array, " n"]]:
    """Joints at which something is wrong, of sessions in which that is not all of them."""
    true: dict[str, Bool[Array, " n"]] = {}
    for name, session in board.sessions.items():
        effects = opened.answers[name]["effects"]
        named = {joint for effect in effects for joint in effect["joints"]}
        is_true = np.array([joint in named for joint in session["joints"]])
        if 0 < is_true.sum() < len(is_true):
            true[name] = is_true
    return true


def place_p_value(
    scores: Mapping[str, Float[Array, " n"]],
    true: Mapping[str, Bool[Array, " n"]],
    rng: np.random.Generator,
) -> float:
    """Chance that as many drawn joints of each session have as high a mean score as the true ones.

    Args:
        scores: Of each joint, by session: a figure, or its ranks.
        true: Which joints are true, by session; what either lacks is left out.
        rng: Draws the joints.
    """
    real = 0.0
    drawn = np.zeros(EXCHANGES)
    for name in sorted(scores.keys() & true.keys()):
        count = int(true[name].sum())
        real += float(scores[name][true[name]].mean())
        orders = rng.permuted(np.tile(scores[name], (EXCHANGES, 1)), axis=1)
        drawn += orders[:, :count].mean(axis=1)
    return (float(np.sum(drawn >= real - ROUNDING)) + 1.0) / (EXCHANGES + 1.0)


def classifier_p_value(
    table: Float[Array, "N F"],
    truths: Array,
    tiers: Array,
    rng: np.random.Generator,
) -> float:
    """Chance that of exchanged truths as many are foretold from all figures as of the real ones.

    A ridge regression of the truths on the figures' ranks within their tier and their squares
    foretells each session from the others (left out one by one); the largest value is its answer.
    Truths are exchanged within a tier.

    Args:
        table: Figures of each session.
        truths: What is wrong in each.
        tiers: Of each.
        rng: Draws the exchanges.
    """
    groups = [np.flatnonzero(tiers == tier) for tier in np.unique(tiers)]
    features = classifier_features(table, groups)
    power = features @ features.T
    ridge = np.trace(power) / len(power)
    hat = power @ np.linalg.inv(power + ridge * np.eye(len(power)))
    hat_alone = hat - np.diag(np.diag(hat))  # what a session says of itself does not count
    codes = np.unique(truths.astype(str), return_inverse=True)[1]
    real = _foretold(hat_alone, codes)
    count = 0
    for _ in range(EXCHANGES):
        drawn = codes.copy()
        for rows in groups:
            drawn[rows] = codes[rng.permutation(rows)]
        count += _foretold(hat_alone, drawn) >= real
    return (count + 1.0) / (EXCHANGES + 1.0)


def classifier_features(
    table: Float[Array, "N F"],
    groups: Sequence[Array],
) -> Float[Array, "N K"]:
    """Ranks of the figures within each tier, from -1 to 1, their squares, and the tiers."""
    columns: list[Array] = []
    for rows in groups:
        for values in table.T:
            ranks = rankdata(values[rows])
            column = np.zeros(len(table))
            column[rows] = 2.0 * (ranks - 0.5) / len(rows) - 1.0
            columns += [column, column**2]
        of_tier = np.zeros(len(table))
        of_tier[rows] = 1.0
        columns.append(of_tier)
    return np.column_stack(columns)


def _foretold(hat: Float[Array, "N N"], codes: Array) -> float:
    """Sessions whose truth has the largest value, where others foretell it."""
    values = hat @ np.eye(codes.max() + 1)[codes]
    return float(np.sum(np.argmax(values, axis=1) == codes))


def exchange_p_value(
    values: Float[Array, " N"],
    truths: Array,
    tiers: Array,
    rng: np.random.Generator,
) -> float:
    """Chance that exchanged truths part a figure's ranks as much as the real ones do.

    Truths are exchanged within a tier; what is compared is the sum over classes of the squared mean
    rank, counted by the class's size.
    """
    groups = [np.flatnonzero(tiers == tier) for tier in np.unique(tiers)]
    ranks = np.zeros(len(values))
    for rows in groups:
        tier_ranks = rankdata(values[rows])
        ranks[rows] = tier_ranks - tier_ranks.mean()
    codes = np.unique(truths.astype(str), return_inverse=True)[1]
    real = 0.0
    drawn = np.zeros(EXCHANGES)
    for rows in groups:
        real += float(_spread(ranks[rows], codes[rows][None])[0])
        drawn += _spread(ranks[rows], rng.permuted(np.tile(codes[rows], (EXCHANGES, 1)), axis=1))
    if real == 0.0:
        return 1.0
    count = np.count_nonzero(drawn >= real * (1.0 - ROUNDING))
    return (count + 1.0) / (EXCHANGES + 1.0)


def _spread(ranks: Float[Array, " N"], codes: Array) -> Float[Array, " E"]:
    """Sum over classes of the squared mean rank, counted by the class's size.

    Args:
        ranks: Of each session.
        codes: Of the classes of the sessions, in each of E draws, shape (E, N).
    """
    classes = int(codes.max()) + 1
    numbered = (codes + classes * np.arange(len(codes))[:, None]).ravel()
    size = classes * len(codes)
    sums = np.bincount(numbered, np.tile(ranks, len(codes)), minlength=size)
    counts = np.bincount(numbered, minlength=size)
    spread = sums**2 / np.maximum(counts, 1)
    return np.asarray(spread.reshape(len(codes), classes).sum(axis=1))


def holm(leaks: Sequence[Leak]) -> list[Leak]:
    """Leaks with Holm's p-values over all of them, the least first."""
    ordered = sorted(leaks, key=lambda leak: leak.p_value)
    largest = 0.0
    adjusted: list[Leak] = []
    for rank, leak in enumerate(ordered):
        largest = max(largest, min((len(ordered) - rank) * leak.p_value, 1.0))
        adjusted.append(Leak(leak.figure, leak.question, largest))
    return adjusted


def different_urdfs(board: Board) -> list[str]:
    """Arms of which not all sessions have one URDF, as "ARM (drawn)" or "ARM (recorded)"."""
    texts: dict[tuple[str, str], set[str]] = {}
    for name, session in board.sessions.items():
        kind = "drawn" if session["tier"] == DRAWN else "recorded"
        text = (board.folder / SESSIONS / name / URDF_FILE).read_text(encoding="utf-8")
        texts.setdefault((kind, session["arm"]), set()).add(text)
    return [f"{arm} ({kind})" for (kind, arm), different in texts.items() if len(different) > 1]


def main() -> None:
    """The command; what it takes stands in the module's docstring."""
    form = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=form)
    parser.add_argument("board", type=Path)
    parser.add_argument("--kept", type=Path)
    given = parser.parse_args()
    board = Board.load(given.board)
    opened = Kept.load(given.kept or kept_folder(given.board), board)
    words = find_words(board.folder, opened.answers)
    lines = [f"{path}: holds {word!r}" for path, word in words]
    lines += [f"URDFs of {arm} differ" for arm in different_urdfs(board)]
    shared = find_shared_rows(board)
    lines += [f"{pair.session} shares {pair.rows} rows with {pair.other}" for pair in shared]
    plain = len(lines)
    leaks = find_leaks(board, opened)
    lines += [f"{leak.figure}, {leak.question}: p = {leak.p_value:.3f}" for leak in leaks[:5]]
    count = plain + sum(leak.p_value < LEVEL for leak in leaks)
    lines.append(f"{len(board.sessions)} sessions, {len(leaks)} questions: {count} leaks")
    sys.stdout.write("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
