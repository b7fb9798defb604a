"""Second and third tier: known effects on real recordings, and real recordings of a measured cause.

What is wrong with a real arm itself nobody knows in full: against its URDF alone no answer could be
called false. So a session with a known effect comes with the same arm before, in other motions, and
what is asked is what came to it: that is known of every session, for it was put in, or nothing was.

Of each recording the last part is kept for the motion that is to be foretold; no session holds any
of it. The rest is cut into pieces, of which every second one stays plain: all sessions of the arm
have those as what was before. Each of the others is given to one session alone, whether anything
comes to it or not. So no two sessions hold the same row unless nothing comes to it in any, and
nobody learns by comparing them what was added.

What remembers (friction that turns round, a gear that twists, a delay) runs over the recording from
its beginning: at the first row that is given it stands as it would have stood.
"""

from __future__ import annotations

import itertools
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ident.arrays import Array, Float
from ident.benchmark.board.case import MEASURED, PLANTED, BoardCase
from ident.errors import InputError
from ident.recordings.recording import Recording
from ident.records import JsonRecord, JsonTable
from ident.simulation.real.cases import Effects, plan_slots, plant_effects
from ident.simulation.real.moved_arm import MovedArm, model_of, rigid_torque
from ident.simulation.real.sources import Source, known_recordings, load_known

TABLE_FILE = Path(__file__).with_name("sources.toml")
TABLES: dict[str, JsonRecord] = tomllib.loads(TABLE_FILE.read_text(encoding="utf-8"))
UNSEEN_SHARE = 0.125  # of a recording's rows, at its end
# Of the rest, plain and given to a session in turn [s]: with less than 4.5 s on one side a
# comparison says that nothing can be tested.
LEAST_PIECE_S = 4.7
# Left out between pieces: the torque of two instants in a row would tell what came [s].
GUARD_S = 0.2
# Of a run that begins with a piece given to a session, left out: what remembers begins there [s].
LEAD_S = 2.0 * GUARD_S
# Draws before an effect is given up that a stretch can't show, and others of its kind that are
# tried in its place.
MOST_DRAWS = 3
SUBSTITUTES = 16
OTHER_PLACES = 200  # of a plan from which those, and few places, are taken
# Quantile of the steps between the values of a torque that is taken for its rounding.
ROUNDING_QUANTILE = 0.1


@dataclass(frozen=True)
class PlantedSlot:
    """A place of the tier: what is to be planted."""

    number: int
    kind: str
    effects: Effects


def plan_planted(
    sources: Mapping[str, Source],
    cases: int,
    seed: int,
) -> list[tuple[PlantedSlot, GivenRows, Source]]:
    """Places of the tier, each with a stretch of a recording and that recording: as many as asked
    for, if there are as many stretches.

    The stretches are dealt at random: on which arm a session is hangs on nothing that is wrong.
    """
    dealt: list[tuple[GivenRows, Source]] = []
    for name, source in sources.items():
        if may_be_planted(name):
            dealt += [(stretch, source) for stretch in part_recording(source).stretches]
    rng = np.random.default_rng([seed, 3])
    order = rng.permutation(len(dealt))
    chosen = [dealt[int(place)] for place in order[:cases]]
    places: list[tuple[PlantedSlot, GivenRows, Source]] = []
    # Few places can't hold each kind by its share: they are drawn from more.
    planned = plan_slots(max(OTHER_PLACES, len(chosen)), seed)
    drawn = rng.permutation(len(planned))
    for number, given in enumerate(chosen):
        kind, effects = planned[int(drawn[number])]
        places.append((PlantedSlot(number, kind, effects), *given))
    return places


def load_board_sources(folder: Path, seed: int) -> dict[str, Source]:
    """Recordings below a folder that may be passed on, by name, their rounding spread.

    Raises:
        InputError: There are none.
    """
    known = known_recordings()
    sources: dict[str, Source] = {}
    for number, name in enumerate(TABLES["recordings"]):
        if (folder / known[name]["folder"]).is_dir():
            rng = np.random.default_rng([seed, 31, number])
            sources[name] = unrounded(load_known(name, known[name], folder), rng)
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


def split_of(source: Source) -> int:
    """Row from which the motion begins that is to be foretold."""
    rows = sum(len(run) for run in source.runs)
    return int((1.0 - UNSEEN_SHARE) * rows)


@dataclass(frozen=True, eq=False)
class GivenRows:
    """Rows of a recording that one session gets."""

    source: Source  # the recording without its end; the clock is zero at the first row given
    rows: slice  # counted over all runs


@dataclass(frozen=True, eq=False)
class Parted:
    """A recording without its end: what nothing comes to, and what single sessions get."""

    plain: Source
    stretches: tuple[GivenRows, ...]


def part_recording(source: Source) -> Parted:
    """Cuts a recording into pieces, plain and given to a session in turn.

    Runs begin with either in turn: of runs of one motion each half has every part of it. The first
    begins with a piece that is given: where pieces are odd in number, sessions get one more.
    """
    rest = replace(source, runs=tuple(rest_of(source)))
    plain: list[Recording] = []
    stretches: list[GivenRows] = []
    first = 0
    for number, run in enumerate(rest.runs):
        begins_plain = number % 2 == 1
        lead = 0 if begins_plain else int(np.searchsorted(run.time, run.time[0] + LEAD_S))
        count = max(int((run.time[-1] - run.time[lead]) // LEAST_PIECE_S), 1)
        edges = np.linspace(lead, len(run), count + 1).astype(int).tolist()
        for index, (start, stop) in enumerate(itertools.pairwise(edges)):
            end = int(np.searchsorted(run.time, run.time[stop - 1] - GUARD_S, side="right"))
            if (index % 2 == 0) == begins_plain:
                plain.append(run.at(slice(start, end), f"{run.name}_{index}"))
                continue
            since = _clock_from(rest.runs, run.time[start])
            rows = slice(first + start, first + end)
            stretches.append(GivenRows(replace(rest, runs=since), rows))
        first += len(run)
    plain_runs = _clock_from(plain, plain[0].time[0])
    return Parted(replace(source, runs=plain_runs), tuple(stretches))


def rest_of(source: Source) -> Iterator[Recording]:
    """Runs of a recording up to the motion that is to be foretold."""
    start = 0
    for run in source.runs:
        count = min(split_of(source) - start, len(run))
        start += len(run)
        if count > 0:
            yield run.at(slice(0, count))


def _clock_from(runs: Sequence[Recording], begin: float) -> tuple[Recording, ...]:
    """The same runs, the clock zero at an instant of it."""
    return tuple(run.replace(time=run.time - begin) for run in runs)


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
    """The motion that is to be foretold, with the torque that was recorded: the end
    of the last run, its time from zero.
    """
    last = source.runs[-1]
    others = sum(len(run) for run in source.runs[:-1])
    unseen = last.at(slice(max(split_of(source) - others, 0), len(last)))
    return unseen.replace(time=unseen.time - unseen.time[0])


def make_planted(
    slot: PlantedSlot, stretch: GivenRows, whole: Source, seed: int
) -> BoardCase | None:
    """A case on a stretch of a recording, with its effects or others of their kind; None if the
    stretch can show none of them.

    Args:
        slot: What is to come to it.
        stretch: Rows that no other session gets.
        whole: The recording.
        seed: Of the board.
    """
    before = part_recording(whole).plain
    arm = MovedArm.of(stretch.source, (stretch.rows,))
    for number, effects in enumerate([slot.effects, *substitutes(slot, seed)]):
        for attempt in range(MOST_DRAWS):
            rng = np.random.default_rng([seed, 1, slot.number, number, attempt])
            made = plant_effects(arm, slot.kind, effects, rng)
            if made is not None:
                break
        else:
            continue
        runs, urdf, answer = made
        felt = missing_torque(arm, urdf)
        parts = zip(runs, arm.given, strict=True)
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


def make_measured(sources: Mapping[str, Source]) -> list[BoardCase]:
    """Recordings whose cause is known from a measurement; those that are not there are left out."""
    cases: list[BoardCase] = []
    for entry in TABLES["measured"].values():
        recording = entry["recording"]
        if recording not in sources:
            continue
        source = sources[recording]
        runs = source.runs
        if may_be_planted(recording):
            runs = part_recording(source).plain.runs
        truths = tuple(_measured_truth(effect) for effect in entry["effects"])
        cases.append(BoardCase(MEASURED, "measured", source.arm, source.urdf, runs, truths))
    return cases


def _measured_truth(effect: JsonTable) -> JsonRecord:
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
