"""Second and third tier: known effects on real recordings, and real recordings of a measured cause.

What is wrong with a real arm itself nobody knows in full: against its URDF alone no answer could be
called false. So a session with a known effect comes with the same arm before, in other motions, and
what is asked is what came to it: that is known of every session, for it was put in, or nothing was.

Of each recording the last part is kept for the motion that is to be foretold; no session holds any
of it. A session is a window of the rest, whose place hangs on nothing that is wrong; it is cut into
pieces, which are before and after in turn.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ident.arrays import Array, Float
from ident.benchmark.board.case import MEASURED, PLANTED, BoardCase
from ident.errors import InputError
from ident.recordings.recording import Recording
from ident.simulation.real.cases import Effects, plan_slots, plant_effects, turns_of
from ident.simulation.real.moved_arm import MovedArm, model_of, rigid_torque
from ident.simulation.real.sources import Source, cut, known_recordings, load_known

TABLE_FILE = Path(__file__).with_name("sources.toml")
TABLES: dict[str, dict[str, Any]] = tomllib.loads(TABLE_FILE.read_text(encoding="utf-8"))
UNSEEN_SHARE = 0.125  # of a recording's rows, at its end
WINDOW_SHARE = 0.96  # of the rest that a session holds
SHORTEST_PIECE_S = 1.0  # of a run that a window's edge cuts
LEAST_PIECES = 6  # of a window
# Left out between pieces: the torque of two instants in a row would tell what came [s].
GUARD_S = 0.2
# Turns of the arms before an effect is given up that no recording can show, and others of its kind
# that are tried in its place.
MOST_TURNS = 3
SUBSTITUTES = 4
OTHER_PLACES = 50  # of a plan from which those are taken
# Quantile of the steps between the values of a torque that is taken for its rounding.
ROUNDING_QUANTILE = 0.1


@dataclass(frozen=True)
class PlantedSlot:
    """A place of the tier: what is to be planted."""

    number: int
    kind: str
    effects: Effects


def plan_planted(cases: int, seed: int) -> list[PlantedSlot]:
    """All places of a tier of planted effects."""
    slots = plan_slots(cases, seed)
    return [PlantedSlot(number, kind, effects) for number, (kind, effects) in enumerate(slots)]


def load_board_sources(folder: Path) -> dict[str, Source]:
    """Recordings below a folder that may be passed on, by name.

    Raises:
        InputError: There are none.
    """
    known = known_recordings()
    sources: dict[str, Source] = {}
    for name in TABLES["recordings"]:
        if (folder / known[name]["folder"]).is_dir():
            sources[name] = load_known(name, known[name], folder)
    if not sources:
        wanted = ", ".join(known[name]["folder"] for name in TABLES["recordings"])
        raise InputError(folder, f"none of {wanted} is below it", "give the folder that holds them")
    return sources


def may_be_planted(recording: str) -> bool:
    """Whether the table of recordings lets effects be planted into one of them.

    Raises:
        KeyError: The table has no such recording.
    """
    return bool(TABLES["recordings"][recording].get("planted", True))


def part_of(source: Source, first: int, last: int) -> Source:
    """Rows of a source, counted over all its runs; the clock starts anew, scraps are left out."""
    runs: list[Recording] = []
    start = 0
    for run in source.runs:
        low = max(first - start, 0)
        high = min(last - start, len(run))
        start += len(run)
        if high <= low:
            continue
        piece = run.at(slice(low, high))
        if piece.duration >= SHORTEST_PIECE_S:
            runs.append(piece)
    return _of_pieces(source, runs)


def split_of(source: Source) -> int:
    """Row from which the motion begins that is to be foretold."""
    rows = sum(len(run) for run in source.runs)
    return int((1.0 - UNSEEN_SHARE) * rows)


def window_of(source: Source, rng: np.random.Generator) -> Source:
    """What a session holds of a recording."""
    rows = split_of(source)
    length = int(WINDOW_SHARE * rows)
    start = int(rng.integers(rows - length + 1))
    return part_of(source, start, start + length)


def sides_of(window: Source, rng: np.random.Generator) -> tuple[Source, Source]:
    """The window's pieces in turn, before and after; which of the two is first is drawn.

    One of several runs is cut into an odd number of pieces: so runs of one motion give each side
    every part of it.
    """
    per_run = -(-LEAST_PIECES // len(window.runs))
    if len(window.runs) > 1:
        per_run += 1 - per_run % 2
    pieces: list[Recording] = []
    for run in window.runs:
        pieces += [_unguarded(piece) for piece in cut(run, per_run)]
    first = int(rng.integers(2))
    return _of_pieces(window, pieces[first::2]), _of_pieces(window, pieces[1 - first :: 2])


def _unguarded(piece: Recording) -> Recording:
    """A piece without its last instants."""
    end = piece.time[-1] - GUARD_S
    return piece.at(slice(0, int(np.searchsorted(piece.time, end, side="right"))))


def _of_pieces(source: Source, pieces: Sequence[Recording]) -> Source:
    """The source with these runs, the clock started anew."""
    begin = pieces[0].time[0]
    return replace(source, runs=tuple(run.replace(time=run.time - begin) for run in pieces))


def unrounded(source: Source, rng: np.random.Generator) -> Source:
    """The source with its torque spread evenly within its rounding (dither).

    What a recorder rounded stays on its steps where nothing was added to it, and leaves them where
    something was: how many values differ would tell the joint.
    """
    torque = np.concatenate([run.effort for run in source.runs])
    rounding = np.array([rounding_of(values) for values in torque.T])
    runs: list[Recording] = []
    for run in source.runs:
        dither = rounding * rng.uniform(-0.5, 0.5, run.effort.shape)
        runs.append(run.replace(effort=run.effort + dither))
    return replace(source, runs=tuple(runs))


def rounding_of(values: Float[Array, " T"]) -> float:
    """Least steps between values, tiny where nothing is rounded; zero where all are the same."""
    steps = np.diff(np.unique(values))
    return float(np.quantile(steps, ROUNDING_QUANTILE)) if len(steps) else 0.0


def unseen_of(source: Source) -> Recording:
    """The motion that is to be foretold, with the torque that was recorded."""
    rows = sum(len(run) for run in source.runs)
    return part_of(source, split_of(source), rows).runs[-1]


def deal_sources(sources: Sequence[Source], seed: int) -> Iterator[Source]:
    """Sources without end, every arm as often as any other."""
    return turns_of(sources, seed)


def make_planted(
    slot: PlantedSlot,
    turns: Iterator[Source],
    sources: int,
    seed: int,
) -> BoardCase | None:
    """A case on the first recording in turn that can show the effect, or another of its kind; None
    if none can.
    """
    window_rng = np.random.default_rng([seed, 31, slot.number])
    tried = [slot.effects, *substitutes(slot, seed)]
    turns_of_each = MOST_TURNS * sources
    for attempt in range(turns_of_each * len(tried)):
        whole = next(turns)
        window = unrounded(window_of(whole, window_rng), window_rng)
        before, after = sides_of(window, window_rng)
        arm = MovedArm.of(after)
        rng = np.random.default_rng([seed, 1, slot.number, attempt])
        made = plant_effects(arm, slot.kind, tried[attempt // turns_of_each], rng)
        if made is None:
            continue
        runs, urdf, answer = made
        felt = missing_torque(arm, urdf)
        parts = zip(runs, arm.runs, strict=True)
        return BoardCase(
            tier=PLANTED,
            kind=slot.kind,
            arm=whole.arm,
            urdf=arm.source.urdf,
            runs=tuple(run.replace(effort=run.effort + felt[rows]) for run, rows in parts),
            effects=tuple(answer["effects"]),
            before=before.runs,
            unseen=unseen_of(whole),
        )
    return None


def substitutes(slot: PlantedSlot, seed: int) -> list[Effects]:
    """What may take a place whose own effect no recording can show."""
    other_seed = int(np.random.default_rng([seed, 33, slot.number]).integers(2**31))
    others = [
        effects for kind, effects in plan_slots(OTHER_PLACES, other_seed) if kind == slot.kind
    ]
    return others[:SUBSTITUTES]


def missing_torque(arm: MovedArm, urdf: str) -> Array:
    """Torque that makes up for a URDF that was changed in place of the recordings [N m].

    All sessions of an arm get the same URDF: one that differs would tell where to look.
    """
    if urdf == arm.source.urdf:
        return np.zeros_like(arm.tau)
    changed = rigid_torque(model_of(urdf), arm.q, arm.v, arm.a)
    return arm.rigid - changed


def make_measured(folder: Path, sources: Mapping[str, Source]) -> list[BoardCase]:
    """Recordings whose cause is known from a measurement; those that are not there are left out."""
    known = known_recordings()
    cases: list[BoardCase] = []
    for name, entry in TABLES["measured"].items():
        recording = entry["recording"]
        if recording not in sources:
            continue
        row = known[recording]
        robot = entry.get("robot", row.get("robot", ""))
        source = load_known(name, {**row, "robot": robot}, folder)
        runs = source.runs
        if may_be_planted(recording):  # the end of it is some session's unseen motion
            runs = part_of(source, 0, split_of(source)).runs
        truths = tuple(_measured_truth(effect) for effect in entry["effects"])
        cases.append(BoardCase(MEASURED, "measured", source.arm, source.urdf, runs, truths))
    return cases


def _measured_truth(effect: Mapping[str, Any]) -> dict[str, Any]:
    joints = list(effect["joints"])
    return {
        "effect": effect["effect"],
        "in_catalogue": True,
        "joints": joints,
        "may_stand_at": joints,
        "parameters": dict(effect.get("parameters", {})),
        "asked": None,
        "visible": {},
    }
