"""Looks for truths that leak: words in any file of a board, and figures of a session (rows, times,
columns, sizes) that go with what is wrong in it.

    python -m ident.benchmark.board.leaks BOARD [--kept FOLDER]

A figure leaks where its ranks differ between sessions of different truths by more than chance: the
spread of the classes' mean ranks, within each tier, against random exchanges of the truths. Its
p-value is Holm's over all figures and questions.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
from scipy.stats import rankdata

from ident.arrays import Array, Float
from ident.benchmark.board.case import MEASURED
from ident.benchmark.board.files import SESSIONS, URDF_FILE, Board, Kept, kept_folder

EXCHANGES = 2000
LEVEL = 0.01  # of any false alarm over all figures
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
    """What anybody sees of a session without looking at a number in its tables."""
    folder = board.session_folder(name)
    tables = sorted(folder.glob("*.parquet"))
    files = [pq.ParquetFile(path) for path in tables]
    rows = [file.metadata.num_rows for file in files]
    times = [file.read(["time"])["time"].to_numpy() for file in files]
    steps = np.concatenate([np.diff(time) for time in times])
    unseen = board.unseen_file(name)
    return {
        "runs": float(len(tables)),
        "rows": float(sum(rows)),
        "columns": float(files[0].metadata.num_columns),
        "first time": float(times[0][0]),
        "duration": float(times[-1][-1] - times[0][0]),
        "interval": float(np.median(steps)),
        "jitter": float(np.std(steps) / np.median(steps)),
        "bytes of a number": sum(path.stat().st_size for path in tables) / sum(rows),
        "bytes of the URDF": float((folder / URDF_FILE).stat().st_size),
        "bytes of the unseen": float(unseen.stat().st_size) if unseen.is_file() else 0.0,
    }


@dataclass(frozen=True)
class Leak:
    """How a figure goes with what is wrong."""

    figure: str
    question: str  # `whether` anything is wrong, or `which` effect
    p_value: float  # of chance, Holm's


def find_leaks(board: Board, opened: Kept, seed: int = 0) -> list[Leak]:
    """Every figure against every question, the least p-value first."""
    names = list(board.sessions)
    figures = {name: figures_of(board, name) for name in names}
    tiers = np.array([board.sessions[name]["tier"] for name in names])
    effects = [[effect["effect"] for effect in opened.answers[name]["effects"]] for name in names]
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
    return holm(leaks)


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
    real = _spread(ranks, codes, tiers)
    if real == 0.0:
        return 1.0
    count = 0
    for _ in range(EXCHANGES):
        drawn = codes.copy()
        for rows in groups:
            drawn[rows] = codes[rng.permutation(rows)]
        count += _spread(ranks, drawn, tiers) >= real * (1.0 - 1e-12)
    return (count + 1.0) / (EXCHANGES + 1.0)


def _spread(ranks: Array, codes: Array, tiers: Array) -> float:
    total = 0.0
    for tier in np.unique(tiers):
        rows = tiers == tier
        sums = np.bincount(codes[rows], ranks[rows])
        counts = np.bincount(codes[rows])
        total += float(np.sum(sums**2 / np.maximum(counts, 1)))
    return total


def holm(leaks: Sequence[Leak]) -> list[Leak]:
    """The same with Holm's p-values over all of them, the least first."""
    ordered = sorted(leaks, key=lambda leak: leak.p_value)
    largest = 0.0
    adjusted: list[Leak] = []
    for rank, leak in enumerate(ordered):
        largest = max(largest, min((len(ordered) - rank) * leak.p_value, 1.0))
        adjusted.append(Leak(leak.figure, leak.question, largest))
    return adjusted


def different_urdfs(board: Board) -> list[str]:
    """Arms of which not all sessions of a tier have the same URDF, where causes were put in."""
    texts: dict[tuple[str, str], set[str]] = {}
    for name, session in board.sessions.items():
        if session["tier"] == MEASURED:
            continue
        text = (board.folder / SESSIONS / name / URDF_FILE).read_text(encoding="utf-8")
        texts.setdefault((session["tier"], session["arm"]), set()).add(text)
    return [f"{arm} ({tier})" for (tier, arm), different in texts.items() if len(different) > 1]


def main() -> None:
    """The command; what it takes stands in the module's docstring."""
    form = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=form)
    parser.add_argument("board", type=Path)
    parser.add_argument("--kept", type=Path)
    given = parser.parse_args()
    board = Board.load(given.board)
    opened = Kept.load(given.kept or kept_folder(given.board), board)
    words = list(find_words(board.folder, opened.answers))
    lines = [f"{path}: holds {word!r}" for path, word in words]
    lines += [f"URDFs of {arm} differ" for arm in different_urdfs(board)]
    leaks = find_leaks(board, opened)
    lines += [f"{leak.figure}, {leak.question}: p = {leak.p_value:.3f}" for leak in leaks[:5]]
    count = len(words) + sum(leak.p_value < LEVEL for leak in leaks)
    lines.append(f"{len(board.sessions)} sessions, {len(leaks)} questions: {count} leaks")
    sys.stdout.write("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
