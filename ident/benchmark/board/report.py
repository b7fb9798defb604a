"""A board's scores together: entrants side by side, in words, as a picture and as a page."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ident.benchmark.board.case import TIERS
from ident.benchmark.board.files import Board, Kept
from ident.benchmark.board.score import EntryScore, score_entry, written
from ident.benchmark.scores import Score, mean
from ident.errors import InputError
from ident.records import JsonRecord, JsonTable
from ident.results import Provenance, Result
from ident.show.palette import FLEXIBLE
from ident.show.report.page import Section, facts_section, provenance_facts, render_page
from ident.show.results import draw_bars

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SCORE_SCHEMA = "ident.board_score/1"
Row = JsonRecord


@dataclass(frozen=True, eq=False)
class BoardReport(Result):
    """What came of a job on a board: a record, and the same in words."""

    record: Row
    lines: tuple[str, ...]

    def to_dict(self) -> Row:
        return {**self.record, "provenance": self.provenance.to_dict()}

    def summary(self) -> str:
        return "\n".join(self.lines)

    def plot(self) -> Figure:
        entries = [entry for entry in self.record.get("entries", ()) if "attribution" in entry]
        names = [str(entry["name"]) for entry in entries]
        shares = [float(entry["attribution"]["strict"]["value"]) for entry in entries]
        return draw_bars(names, {"first name true": (FLEXIBLE, shares)}, "share", "sessions")


def score_board(folder: Path, answers: Path, kept_folder: Path) -> BoardReport:
    """Opens a board, checks its seals, and scores one entrant or several.

    Args:
        folder: Of the board.
        answers: Of one entrant's files, or of a folder for each.
        kept_folder: What the board's maker kept.

    Raises:
        InputError: No board, an answer that was changed after it was sealed, or a bad entry.
    """
    board = Board.load(folder)
    opened = Kept.load(kept_folder, board)
    entries = [score_entry(place, board, opened) for place in entry_folders(answers, board)]
    entries.sort(key=_place)
    tiers = [session["tier"] for session in board.sessions.values()]
    record: Row = {
        "schema": SCORE_SCHEMA,
        "arms": board.arms(),
        "sessions": len(board.sessions),
        "tiers": {tier: tiers.count(tier) for tier in TIERS if tier in tiers},
        "seals": len(board.sealed),
        "undecided_log_score": round(float(np.log(len(board.effects) + 2)), 3),
        "oracle": oracle_bound(opened),
        "entries": list(records_of(entries)),
    }
    made_by = Provenance("ident board score", settings={"board": folder.name})
    return BoardReport(record, tuple(lines_of(record)), provenance=made_by)


def entry_folders(answers: Path, board: Board) -> list[Path]:
    """An entrant's folder, or those of several below a folder.

    Raises:
        InputError: No such folder, or nothing in it.
    """
    if not answers.is_dir():
        raise InputError(answers, "there is no such folder", "give the folder of your answers")
    for name in board.sessions:
        if (answers / f"{name}.json").is_file() or (answers / f"{name}.parquet").is_file():
            return [answers]
    places = sorted(place for place in answers.iterdir() if place.is_dir())
    if not places:
        remedy = "give a folder with s001.json and so on, or one of such folders"
        raise InputError(answers, "it holds no answer", remedy)
    return places


def records_of(entries: Sequence[EntryScore]) -> Iterator[Row]:
    """Records of all entrants, the best first; of the others how far behind they are, session by
    session.
    """
    first = entries[0]
    for entry in entries:
        record = entry.to_dict()
        if entry is not first and entry.sessions:
            record["behind the first"] = written(behind(entry, first))
        yield record


def behind(entry: EntryScore, first: EntryScore) -> Score:
    """By how much an entrant's log score is larger than the first one's [nats].

    Both are of the entrant's sessions, which all have to be among the first one's.
    """
    rows = entry.sessions.items()
    return mean([row.log_score - first.sessions[name].log_score for name, row in rows])


def oracle_bound(opened: Kept) -> Row | None:
    """How often an oracle names single effects of drawn worlds; None where not worked out."""
    if not opened.oracle:
        return None
    values = list(opened.oracle.values())
    return {"sessions": len(values), "strict": round(float(np.mean(values)), 3)}


def _place(entry: EntryScore) -> tuple[bool, float, str]:
    """The least log score first; who foretells alone comes after."""
    rows = list(entry.sessions.values())
    score = float(np.mean([row.log_score for row in rows])) if rows else 0.0
    return not rows, score, entry.name


# In words


def lines_of(record: JsonTable) -> Iterator[str]:
    """Scores as lines of a terminal."""
    tiers = ", ".join(f"{count} {tier}" for tier, count in record["tiers"].items())
    yield f"{record['sessions']} sessions ({tiers}); all {record['seals']} seals hold"
    yield f"log score where all answers are equally probable: {record['undecided_log_score']:.3f}"
    if record["oracle"]:
        bound = record["oracle"]
        yield f"oracle: {bound['strict']:.2f} of {bound['sessions']} single effects in drawn worlds"
    entries: Sequence[Row] = record["entries"]
    width = max(len(entry["name"]) for entry in entries)
    for entry in entries:
        name = f"{entry['name']:<{width}}"
        if "attribution" in entry:
            yield f"{name}  {' '.join(_attribution_words(entry['attribution']))}"
        if "prediction" in entry:
            score = entry["prediction"]
            words = (
                f"median {score['median_Nm']:.3f} N m, {score['share_of_spread']:.3f} of the spread"
            )
            yield f"{name}  foretold {entry['foretold']} motions: {words}"


def _attribution_words(score: JsonTable) -> Iterator[str]:
    yield f"log score {in_words(score['log_score'])},"
    yield f"strict {in_words(score['strict'])},"
    size = "–" if score["class_size"] is None else score["class_size"]
    yield f"in class {in_words(score['class_aware'])} (size {size}),"
    yield f"joint {in_words(score['joint'])},"
    yield f"coverage {in_words(score['coverage'])}"


def in_words(score: JsonTable) -> str:
    """A score with its interval."""
    if score["value"] is None:
        return "–"
    return f"{score['value']:.2f} [{score['low']:.2f}, {score['high']:.2f}]"


# The page


def render_board(record: JsonTable) -> str:
    """The scores as a page of their own."""
    named = [entry for entry in record["entries"] if "attribution" in entry]
    foretold = [entry for entry in record["entries"] if "prediction" in entry]
    foretold.sort(key=lambda entry: entry["prediction"]["share_of_spread"])
    values = {"record": record, "named": named, "foretold": foretold, "in_words": in_words}
    kinds = sorted({kind for entry in named for kind in entry["attribution by kind"]})
    sections: list[Section | None] = [
        Section("first", "At a glance", "board_first.html", values),
    ]
    if named:
        amplitudes = list(named[0]["attribution by amplitude"])
        with_intervals = [entry for entry in named if entry["attribution"]["coverage"]["count"]]
        groups = {"tiers": list(record["tiers"]), "kinds": kinds, "amplitudes": amplitudes}
        some_left_out = any(entry["answered"] < record["sessions"] for entry in named)
        words = {"with_intervals": with_intervals, "some_left_out": some_left_out}
        shown = values | groups | words
        sections.append(Section("attribution", "Attribution", "board_attribution.html", shown))
    if foretold:
        sections.append(Section("prediction", "Prediction", "board_prediction.html", values))
    sections.append(facts_section({**provenance_facts(record), **_digests(record["entries"])}))
    subtitle = ", ".join(f"{count} {tier}" for tier, count in record["tiers"].items())
    title = f"Board of {record['sessions']} sessions"
    return render_page(title, sections, f"{subtitle}; all {record['seals']} seals hold")


def _digests(entries: Iterable[JsonTable]) -> dict[str, str]:
    return {f"SHA-256 of {entry['name']}": entry["sha256"] for entry in entries}
