"""Makes a board: sessions in three tiers, their truths sealed, and what opens them."""

from __future__ import annotations

import os
import secrets
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from ident.benchmark.board.case import DRAWN, MEASURED, PLANTED, TIERS, BoardCase
from ident.benchmark.board.drawn import make_drawn, plan_drawn
from ident.benchmark.board.files import (
    ANSWERS_FILE,
    BEFORE,
    BOARD_FILE,
    EFFECTS_FILE,
    EFFECTS_SCHEMA,
    KEPT_SCHEMA,
    SCHEMA,
    SESSION_FILE,
    SESSION_TEXT,
    SESSIONS,
    TRUTHS_FILE,
    TRUTHS_SCHEMA,
    UNSEEN,
    URDF_FILE,
    write_columns,
    write_run,
    write_runs,
)
from ident.benchmark.board.leaks import find_words
from ident.benchmark.board.published import published_effects
from ident.benchmark.board.recorded import (
    TABLES,
    load_board_sources,
    make_measured,
    make_planted,
    plan_planted,
)
from ident.benchmark.board.sealing import salt_of, seal_of
from ident.benchmark.corpus_worlds import MIX
from ident.command_options import LARGEST_SEED
from ident.errors import InputError
from ident.files import atomic_folder, write_record
from ident.outputs import real_path
from ident.simulation.real.cases import KINDS

BOARD_KIND = "board"
KEPT_KIND = "board answers"
README = Path(__file__).with_name("board_readme.md")
# Least share of the cases that are of drawn worlds; more are, where recordings have too few rows
# for the others.
DRAWN_SHARE = 0.6
FILE_TIME_S = 1_577_836_800  # of all files of a board: 2020-01-01
Maker = Callable[[], BoardCase | None]


@dataclass(frozen=True)
class MadeBoard:
    """What was made."""

    folder: Path
    aside: Path
    seed: int
    counts: dict[str, int]  # sessions of each tier
    left_out: int  # effects that no recording could show


def make_board(
    folder: Path,
    aside: Path,
    cases: int,
    seed: int | None,
    recordings: Path | None,
    worlds: str = "all",
    oracle: bool = False,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> MadeBoard:
    """Makes a board and what its maker keeps; each folder is there whole or not at all.

    Args:
        folder: Of the board, for everybody.
        aside: Of seed, salts and answers; not below `folder`.
        cases: Sessions of the first two tiers together.
        seed: Of everything; drawn from the system's entropy if None.
        recordings: Folder of real recordings; only drawn worlds without.
        worlds: Which worlds are drawn from.
        oracle: Whether the bound of single effects in drawn worlds is worked out, for the scores.
        progress: Is told how many sessions are done, of how many.

    Raises:
        InputError: No usable recordings, unknown worlds, folders that can't be written, or a board
            in which a file tells a truth.
    """
    if real_path(aside).is_relative_to(real_path(folder)):
        raise InputError(aside, "it lies in the board's folder", "keep the answers somewhere else")
    chosen = secrets.randbelow(LARGEST_SEED) if seed is None else seed
    makers = _makers(cases, chosen, recordings, worlds, oracle)
    with atomic_folder(folder, BOARD_KIND) as out, atomic_folder(aside, KEPT_KIND) as hidden:
        writer = BoardWriter(out, hidden, chosen, len(makers))
        for done, maker in enumerate(makers):
            progress(done, len(makers))
            case = maker()
            if case is not None:
                writer.write(case)
        writer.finish()
        for path, word in find_words(out, writer.answers):
            what = f"it holds {word!r}, which tells a truth"
            raise InputError(path.relative_to(out), what, "report this: no board was written")
    left_out = len(makers) - len(writer.answers)
    return MadeBoard(folder, aside, chosen, writer.counts, left_out)


def _makers(
    cases: int,
    seed: int,
    recordings: Path | None,
    worlds: str,
    oracle: bool,
) -> list[Maker]:
    """What makes each session, in an order that goes with no tier."""
    if recordings is None:
        return [partial(make_drawn, task, oracle) for task in plan_drawn(cases, seed, worlds)]
    sources = load_board_sources(recordings, seed)
    places = plan_planted(sources, cases - round(DRAWN_SHARE * cases), seed)
    tasks = plan_drawn(cases - len(places), seed, worlds)
    makers: list[Maker] = [partial(make_drawn, task, oracle) for task in tasks]
    makers += [partial(make_planted, *place, seed) for place in places]
    makers += [partial(_given, case) for case in make_measured(sources)]
    order = np.random.default_rng([seed, 20]).permutation(len(makers))
    return [makers[int(k)] for k in order]


def _given(case: BoardCase) -> BoardCase:
    return case


class BoardWriter:
    """Writes sessions as they are made, and at the end what is said of all of them."""

    def __init__(self, folder: Path, aside: Path, seed: int, sessions: int) -> None:
        self.folder = folder
        self.kept = aside
        self.seed = seed
        self.width = max(3, len(str(sessions)))
        self.sessions: dict[str, dict[str, Any]] = {}
        self.answers: dict[str, dict[str, Any]] = {}
        self.oracle: dict[str, float] = {}

    @property
    def counts(self) -> dict[str, int]:
        """How many sessions are written, by the tier; 0 for one without any."""
        tiers = [session["tier"] for session in self.sessions.values()]
        return {tier: tiers.count(tier) for tier in TIERS}

    def write(self, case: BoardCase) -> None:
        """Writes a session under the next name, and remembers its answer."""
        name = f"s{len(self.sessions) + 1:0{self.width}d}"
        place = self.folder / SESSIONS / name
        place.mkdir(parents=True)
        write_runs(case.runs, place)
        write_runs(case.before, self.folder / BEFORE / name)
        (place / URDF_FILE).write_text(case.urdf, encoding="utf-8")
        (place / SESSION_FILE).write_text(SESSION_TEXT, encoding="utf-8")
        self.sessions[name] = {
            "tier": case.tier,
            "arm": case.arm,
            "joints": list(case.runs[0].joints),
            "before": bool(case.before),
            "unseen": case.unseen is not None,
        }
        self.answers[name] = {
            "session": name,
            "kind": case.kind,
            "effects": [dict(effect) for effect in case.effects],
            "unseen_sha256": self._write_unseen(name, case),
        }
        if case.oracle is not None:
            self.oracle[name] = case.oracle

    def _write_unseen(self, name: str, case: BoardCase) -> str:
        """Writes the motion to be foretold, and apart its torque; returns that file's hash."""
        run = case.unseen
        if run is None:
            return ""
        write_run(run, self.folder / UNSEEN / f"{name}.parquet", without=("effort", "temperature"))
        place = self.kept / UNSEEN / f"{name}.parquet"
        columns = {f"{joint}/effort": run.effort[:, k] for k, joint in enumerate(run.joints)}
        write_columns({"time": run.time, **columns}, place)
        return sha256(place.read_bytes()).hexdigest()

    def finish(self) -> None:
        """Writes lists, seals, the README, and what is kept."""
        salts = {name: salt_of(self.seed, name) for name in self.answers}
        sealed = {name: seal_of(salts[name], answer) for name, answer in self.answers.items()}
        arms = sorted({str(session["arm"]) for session in self.sessions.values()})
        board = {"schema": SCHEMA, "sources": TABLES["recordings"] if self._real else {}}
        write_record(self.folder / BOARD_FILE, {**board, "arms": arms, "sessions": self.sessions})
        listed = {"schema": EFFECTS_SCHEMA, "effects": published_effects()}
        write_record(self.folder / EFFECTS_FILE, listed)
        write_record(self.folder / TRUTHS_FILE, {"schema": TRUTHS_SCHEMA, "sealed": sealed})
        text = README.read_text(encoding="utf-8")
        for word, value in self._figures().items():
            text = text.replace(f"@{word}@", value)
        (self.folder / "README.md").write_text(text, encoding="utf-8")
        record = {"schema": KEPT_SCHEMA, "seed": self.seed, "salts": salts, "answers": self.answers}
        write_record(self.kept / ANSWERS_FILE, {**record, "oracle": self.oracle})
        # What took longer to make, as a cause that is hard to show, would be younger by more.
        for path in self.folder.rglob("*"):
            os.utime(path, (FILE_TIME_S, FILE_TIME_S))

    @property
    def _real(self) -> bool:
        return bool(self.counts[PLANTED] or self.counts[MEASURED])

    def _figures(self) -> Mapping[str, str]:
        """What the README's placeholders stand for."""
        counts = self.counts
        return {
            "SESSIONS": str(len(self.sessions)),
            "DRAWN": str(counts[DRAWN]),
            "PLANTED": str(counts[PLANTED]),
            "MEASURED": str(counts[MEASURED]),
            "EFFECTS": str(len(published_effects())),
            "ANSWERS": str(len(published_effects()) + 2),
            "OFTEN": "\n".join(how_often(counts)),
            "SOURCES": "\n".join(self._sources()),
        }

    def _sources(self) -> Iterator[str]:
        if not self._real:
            yield "None: this board holds drawn worlds alone."
            return
        for name, row in TABLES["recordings"].items():
            yield f"- `{name}`: {row['origin']}, {row['licence']}"


def how_often(counts: Mapping[str, int]) -> Iterator[str]:
    """Rows of the README's table: how often which kind of session comes, by tier."""
    nothing = MIX["healthy"] + MIX["decoy"]
    drawn = (MIX["single"], MIX["pair"], MIX["outside"], nothing)
    planted = tuple(KINDS[kind] for kind in ("single", "pair", "outside", "untouched"))
    for tier, shares in ((DRAWN, drawn), (PLANTED, planted)):
        if counts[tier]:
            cells = [f"{100.0 * share / sum(shares):.0f} %" for share in shares]
            yield f"| {tier} | {' | '.join(cells)} |"
