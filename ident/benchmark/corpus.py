"""A corpus: sessions whose truth is known, in one index; what is fitted and judged on it is another
file's.

    python -m ident.benchmark.corpus real DIR --seed 1 [--cases 220] [--real RECORDINGS]
    [--kept-back]
    python -m ident.benchmark.corpus worlds DIR --seed 1 [--cases 120] [--worlds all]
    [--mix outside=1 healthy=1]
    python -m ident.benchmark.corpus index DIR [--other FOLDER …]

`DIR/real`, `DIR/kept` and `DIR/worlds` hold a session folder a case (`cases`), each with its
`robot.urdf`, and what was wrong apart from them (`answers`). Folders of sessions that other
simulators made (`robot.urdf`, `answers.json` and one folder a session) join by `--other`.
`DIR/index.json` lists all of them but those of arms that are kept back, whose index is
`DIR/kept.json`. `ident.benchmark.cuts` adds sessions of a few seconds.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import sys
import tomllib
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

from ident.benchmark.corpus_worlds import MIX, make_world_cases, plan_world_cases
from ident.benchmark.truth import KNOWN
from ident.errors import InputError
from ident.files import write_record
from ident.records import JsonRecord, JsonTable
from ident.safe_read import read_json
from ident.simulation.real.cases import make_cases, write_recorded
from ident.simulation.real.sources import load_sources

SCHEMA = "ident.corpus/1"
INDEX = "index.json"
KEPT_INDEX = "kept.json"
KINDS = {"null": "healthy"}
"""Kinds of session, where a simulator calls them otherwise."""
FIGURES: dict[str, JsonRecord] = tomllib.loads(
    Path(__file__).with_name("other_figures.toml").read_text(encoding="utf-8")
)
"""Figures of other simulators by effect: their name, ours, and the factor between them."""


@dataclass(frozen=True)
class Truth:
    """One thing that is wrong in a session."""

    effect: str  # id, of the catalogue or outside it
    in_catalogue: bool  # which of the two
    joints: tuple[str, ...]  # where it acts, or shows most
    may_stand_at: tuple[str, ...]  # where a name for it is right; anywhere if empty
    # True ones, in the catalogue's terms.
    parameters: dict[str, float | str] = field(default_factory=dict)
    asked: float | None = None  # visible size that was asked for [noise]
    visible: dict[str, float] = field(default_factory=dict)  # at each joint [noise]
    also: tuple[str, ...] = ()  # ids that say the same thing


@dataclass(frozen=True)
class Entry:
    """One session of the corpus."""

    case: str  # its name, unique in the corpus
    group: str  # real, worlds, other, otherworld
    kind: str  # control, untouched, measured, single, pair, outside, healthy
    folder: str  # of its recordings
    urdf: str  # of the arm that it is said to be
    arm: str  # unit that is left out whole
    world: str  # unit that is left out whole; the source's name where the recording is real
    truth: tuple[Truth, ...] = ()
    control: str = ""  # case of the same arm without the effect; empty where there is none
    excused: tuple[str, ...] = ()  # ids that are neither right nor wrong here
    seconds: float = 0.0  # length to which it was cut [s]; 0 where it is whole

    @classmethod
    def from_dict(cls, values: JsonTable) -> Entry:
        """An entry from its row of the stored corpus."""
        truth = tuple(_truth(effect) for effect in values["truth"])
        return cls(**{**values, "truth": truth, "excused": tuple(values["excused"])})


def _truth(values: JsonTable) -> Truth:
    """A truth from what an answer says of an effect."""
    return Truth(
        effect=str(values["effect"]),
        in_catalogue=bool(values.get("in_catalogue", values["effect"] in KNOWN)),
        joints=tuple(values["joints"]),
        may_stand_at=tuple(values["may_stand_at"]),
        parameters=dict(values.get("parameters", {})),
        asked=values.get("asked"),
        visible=dict(values.get("visible", {})),
        also=tuple(values.get("also", ())),
    )


# Indices


def index_of_cases(folder: Path, group: str) -> list[Entry]:
    """Entries of a folder of `cases` and `answers`."""
    entries: list[Entry] = []
    for path in sorted((folder / "answers").glob("*.json")):
        answer = read_json(path, "remove it, or make the corpus anew")
        session = folder / "cases" / path.stem
        if not session.is_dir():
            continue
        control = answer.get("control", "")
        entry = Entry(
            case=f"{group}/{path.stem}",
            group=group,
            kind=answer["kind"],
            folder=str(session),
            urdf=str(session / "robot.urdf"),
            arm=answer["arm"],
            world=answer.get("world", answer["source"]),
            truth=tuple(_truth(effect) for effect in answer["effects"]),
            control=f"{group}/{control}" if control and answer["kind"] != "control" else "",
            excused=tuple(answer.get("excused", ())),
        )
        entries.append(entry)
    return entries


def index_of_others(folder: Path, group: str) -> list[Entry]:
    """Entries of another simulator: `answers.json`, `robot.urdf`, and a folder a session."""
    entries: list[Entry] = []
    answers = read_json(folder / "answers.json", "give a folder of sessions with their answers")
    for name, answer in answers.items():
        truth = tuple(_truth_of_others(effect) for effect in answer["effects"])
        kind = KINDS.get(answer["kind"], answer["kind"])
        entry = Entry(
            case=f"{group}/{folder.name}_{name}",
            group=group,
            kind=kind,
            folder=str(folder / name),
            urdf=str(folder / "robot.urdf"),
            arm=folder.name,
            world=group,
            truth=truth,
        )
        entries.append(entry)
    return entries


def _truth_of_others(values: JsonTable) -> Truth:
    """A truth in another simulator's words; its figures count where they mean the catalogue's."""
    effect = str(values["effect"])
    joint = values.get("joint")
    known = KNOWN.get(effect)
    whole = known is not None and known.scope == "arm"
    parameters: dict[str, float | str] = {}
    figure = FIGURES.get(effect)
    if figure is not None and figure["theirs"] in values:
        parameters[figure["ours"]] = figure["factor"] * float(values[figure["theirs"]])
    visible = values.get("visible")
    shows_at = values.get("shows_at")
    return Truth(
        effect=effect,
        in_catalogue=known is not None,
        joints=tuple(str(name) for name in (joint or shows_at,) if name),
        may_stand_at=() if whole or not joint else (str(joint),),
        parameters=parameters,
        asked=visible,
        visible={str(shows_at): float(visible)} if visible is not None else {},
    )


def write_index(folder: Path, entries: Sequence[Entry], name: str = INDEX) -> None:
    """Writes the index of a corpus, with a seal over all answers."""
    sessions = [asdict(entry) for entry in entries]
    text = json.dumps(sessions, sort_keys=True)
    record = {
        "schema": SCHEMA,
        "sha256": hashlib.sha256(text.encode()).hexdigest(),
        "sessions": sessions,
    }
    write_record(folder / name, record)


def read_index(path: Path) -> list[Entry]:
    """All sessions of a corpus.

    Raises:
        InputError: No index, or another file.
    """
    record = read_json(path, "make the corpus's index: python -m ident.benchmark.corpus index DIR")
    if record.get("schema") != SCHEMA:
        raise InputError(
            path, f"its schema is {record.get('schema')!r}", f"give a file of {SCHEMA}"
        )
    return [Entry.from_dict(values) for values in record["sessions"]]


def interleaved(entries: Iterable[Entry]) -> list[Entry]:
    """Sessions in an order in which every beginning holds all groups and kinds.

    Controls come early.
    """
    queues: dict[tuple[str, str], list[Entry]] = {}
    for entry in entries:
        queues.setdefault((entry.group, entry.kind), []).append(entry)
    counts = {key: len(queue) for key, queue in queues.items()}
    placed: list[tuple[float, Entry]] = []
    for key, queue in queues.items():
        for number, entry in enumerate(_shuffled(queue)):
            share = (number + 0.5) / counts[key]
            placed.append((0.5 * share if entry.kind == "control" else share, entry))
    placed.sort(key=lambda pair: (pair[0], pair[1].case))
    return [entry for _, entry in placed]


def _shuffled(entries: Sequence[Entry]) -> list[Entry]:
    """In an order that goes with no name, the same each time."""
    return sorted(entries, key=lambda entry: hashlib.sha256(entry.case.encode()).hexdigest())


# Commands


def make_real(
    folder: Path,
    recordings: Path,
    cases: int,
    seed: int,
    kept_back: bool,
    say: Callable[[str], None] = lambda line: None,
) -> None:
    """Semi-real cases, controls and recordings of a measured cause; or cases of arms kept back."""
    out = folder / ("kept" if kept_back else "real")
    sources = load_sources(recordings, kept_back)
    make_cases(sources, out, cases, seed, False, say)
    if not kept_back:
        write_recorded(recordings, out)


def make_index(folder: Path, others: Sequence[Path]) -> list[Entry]:
    """Writes the index of all that lies in a corpus's folder, and of other simulators' sessions."""
    entries: list[Entry] = []
    for group in ("real", "worlds"):
        entries += index_of_cases(folder / group, group)
    for other in others:
        homes = [other]
        if not (other / "answers.json").is_file():
            homes = sorted(path.parent for path in other.glob("*/answers.json"))
        for home in homes:
            entries += index_of_others(home, "otherworld" if home == other else "other")
    write_index(folder, entries)
    closed = index_of_cases(folder / "kept", "kept")
    if closed:
        write_index(folder, closed, KEPT_INDEX)
    return entries


def _say(line: str) -> None:
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def _share_of_kind(text: str) -> tuple[str, float]:
    """A kind of case and its share, written `kind=share`."""
    kind, _, share = text.partition("=")
    if kind not in MIX:
        raise argparse.ArgumentTypeError(f"unknown kind {kind!r}; one of: {', '.join(MIX)}")
    return kind, float(share)


def count_kinds(entries: Iterable[Entry]) -> str:
    """How many sessions there are, by group and kind, in words."""
    counts = Counter((entry.group, entry.kind) for entry in entries)
    return ", ".join(f"{group} {kind} {count}" for (group, kind), count in sorted(counts.items()))


def main() -> None:
    """The command; what it takes stands in the module's docstring."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("job", choices=("real", "worlds", "index"))
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--cases", type=int)
    parser.add_argument(
        "--real", type=Path, default=Path(os.environ.get("IDENT_REAL_DATA", "../shared/real"))
    )
    parser.add_argument("--kept-back", action="store_true")
    parser.add_argument("--worlds", default="all")
    parser.add_argument("--mix", type=_share_of_kind, nargs="*", default=list(MIX.items()))
    parser.add_argument("--other", type=Path, nargs="*", default=[])
    given = parser.parse_args()
    if given.job == "real":
        cases = given.cases or (80 if given.kept_back else 220)
        make_real(given.folder, given.real, cases, given.seed, given.kept_back, _say)
    elif given.job == "worlds":
        tasks = plan_world_cases(
            given.folder / "worlds",
            given.cases or 120,
            given.seed,
            given.worlds,
            dict(given.mix),
        )
        make_world_cases(tasks, _say)
    else:
        _say(count_kinds(make_index(given.folder, given.other)))


if __name__ == "__main__":
    main()
