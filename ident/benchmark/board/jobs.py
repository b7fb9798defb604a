"""The jobs of `ident board`: make a board, answer one, seal answers, score them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from ident.benchmark.board.files import Board, kept_folder
from ident.benchmark.board.make import make_board
from ident.benchmark.board.methods import answer_board
from ident.benchmark.board.report import BoardReport, entry_folders, score_board
from ident.benchmark.board.sealing import digest_of
from ident.command_options import BoardOptions
from ident.errors import InputError, plural
from ident.outputs import real_path
from ident.results import Provenance

JOBS = ("make", "answer", "seal", "score")
LARGEST_MB = 30.0  # of a board that can be sent by mail
Say = Callable[[str], None]
Progress = Callable[[int, int], None]


def run_job(
    job: str,
    folder: Path,
    answers: Path | None,
    options: BoardOptions,
    say: Say = lambda line: None,
    progress: Progress = lambda done, total: None,
) -> BoardReport:
    """Does one job on a board's folder.

    Raises:
        InputError: There is no such job, it lacks the folder of answers, or what it reads or writes
            can't be used.
    """
    if job not in JOBS:
        raise InputError("JOB", f"there is no {job!r}", f"choose from: {', '.join(JOBS)}")
    aside = options.kept or kept_folder(folder)
    if job == "make":
        return _make(folder, aside, options, progress)
    if answers is None:
        raise InputError(f"ident board {job}", "no folder of answers", "give it after the board's")
    if job == "answer":
        return _answer(folder, answers, options, say)
    if job == "seal":
        return _seal(folder, answers)
    return score_board(folder, answers, aside)


def _make(folder: Path, aside: Path, options: BoardOptions, progress: Progress) -> BoardReport:
    made = make_board(
        folder,
        aside,
        options.cases,
        options.seed,
        options.real,
        options.worlds,
        options.oracle,
        progress,
    )
    tiers = ", ".join(f"{count} {tier}" for tier, count in made.counts.items() if count)
    sizes = [path.stat().st_size for path in folder.rglob("*") if path.is_file()]
    megabytes = sum(sizes) / 1e6
    count = plural(sum(made.counts.values()), "session")
    lines = [
        f"{folder}: {count} ({tiers}), {megabytes:.1f} MB",
        f"{aside}: seed, salts and answers; keep it until the board is opened",
    ]
    if megabytes > LARGEST_MB:
        lines.append(f"more than {LARGEST_MB:.0f} MB: fewer --cases make a board for the mail")
    if made.left_out:
        left_out = plural(made.left_out, "effect")
        lines.append(f"{left_out} left out: no recording shows so much of it")
    record = {
        "schema": "ident.board_made/1",
        "arms": Board.load(folder).arms(),
        "tiers": made.counts,
        "left_out": made.left_out,
    }
    settings = {"cases": options.cases, "worlds": options.worlds, "oracle": options.oracle}
    made_by = Provenance("ident board make", settings=settings)
    return BoardReport(record, tuple(lines), provenance=made_by)


def _answer(folder: Path, out: Path, options: BoardOptions, say: Say) -> BoardReport:
    board = Board.load(folder)
    if real_path(out).is_relative_to(real_path(folder)):
        raise InputError(out, "it lies in the board's folder", "choose another folder for answers")
    count = answer_board(board, out, options.limit, say)
    lines = (f"{plural(count, 'session')} answered, in {out}",)
    record = {"schema": "ident.board_answered/1", "arms": board.arms(), "answered": count}
    return BoardReport(record, lines, provenance=Provenance("ident board answer"))


def _seal(folder: Path, answers: Path) -> BoardReport:
    board = Board.load(folder)
    places = entry_folders(answers, board)
    digests = {place.name: digest_of(place, "s*.*") for place in places}
    lines = tuple(f"{name}: sha256 {digest}" for name, digest in digests.items())
    record = {"schema": "ident.board_sealed/1", "arms": board.arms(), "sha256": digests}
    return BoardReport(record, lines, provenance=Provenance("ident board seal"))
