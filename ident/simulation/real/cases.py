"""Cases: which effect, on whose recordings, where and how large; written as sessions and answers
apart from them.
"""

from __future__ import annotations

import hashlib
import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ident.arrays import Array, Float
from ident.errors import InputError
from ident.files import atomic_folder, write_record
from ident.recordings.recording import Recording, Session
from ident.recordings.save import fill_session
from ident.records import as_json
from ident.simulation.real.moved_arm import MovedArm
from ident.simulation.real.outside import OUTSIDE
from ident.simulation.real.planted import EFFECTS
from ident.simulation.real.planting import Planted, PlantedChange
from ident.simulation.real.sources import Source, cut, kept_back_arms, load_known, recorded_causes

SIZES = (3.0, 1.0)
PAIR_SIZES = (3.0, 3.0)
# In which of five turns through all effects a single one is large.
LARGE_TURNS = (True, False, True, False, True)
# How near a size has to come to what was asked for, in how many tries; draws of joint and numbers a
# case.
NEAR = 0.1
TRIES = 12
DRAWS = 7
# Least and largest factor from one try to the next.
STEPS = (0.01, 5.0)
# An effect of the whole arm, or one that shows elsewhere, shows where it is this share of its
# largest.
SHOWN = 1.0 / 3.0
KINDS = {"single": 0.66, "outside": 0.1, "pair": 0.08, "untouched": 0.16}
LAST = (
    "torque_gain_error",
    "torque_delay",
    "torque_saturation",
    "encoder_offset",
    "link_inertial_error",
)
# Pieces of a run that is cut, and runs in which each joint has to move for none to be cut.
LEAST_PARTS = 6
FEWEST_RUNS = 4
# How far a joint goes that moves in a run [rad, m].
MOVES = 0.05


Effects = tuple[tuple[str, float], ...]
"""Effects that are requested: id and visible size [noise] of each."""

Answer = dict[str, Any]
"""What is true of a case, or of one effect in it, for a record."""


def plan_slots(cases: int, seed: int) -> list[tuple[str, Effects]]:
    """Kinds of case by their shares, each with its effects; singles in turn, every second or third
    of them small.
    """
    rng = np.random.default_rng([seed, 0])
    counts = {kind: round(share * cases) for kind, share in KINDS.items() if kind != "single"}
    singles = cases - sum(counts.values())
    large, small = SIZES
    slots: list[tuple[str, Effects]] = []
    order: list[str] = []
    while len(order) < singles:
        order += map(str, rng.permutation(list(EFFECTS)))
    for number, effect in enumerate(order[:singles]):
        turn = number // len(EFFECTS)
        is_large = LARGE_TURNS[turn % len(LARGE_TURNS)]
        slots.append(("single", ((effect, large if is_large else small),)))
    enough = list(OUTSIDE) * (1 + counts["outside"] // len(OUTSIDE))
    others = [str(effect) for effect in rng.permutation(enough)]
    slots += [("outside", ((effect, large),)) for effect in others[: counts["outside"]]]
    for _ in range(counts["pair"]):
        drawn = [str(effect) for effect in rng.choice(list(EFFECTS), 2, replace=False)]
        pair = zip(drawn, PAIR_SIZES, strict=True)
        slots.append(("pair", tuple(sorted(pair, key=lambda each: each[0] in LAST))))
    return slots + [("untouched", ())] * counts["untouched"]


def make_cases(
    sources: Sequence[Source],
    out: Path,
    cases: int,
    seed: int,
    paired: bool,
    say: Callable[[str], None] = lambda line: None,
) -> None:
    """Writes cases, controls (each source as it is), answers and their seals; says what was made,
    line by line.

    Each is one session, or of `paired` cases a `before` without and an `after` with the effect, for
    a comparison.

    Raises:
        InputError: The folder holds something already.
    """
    if (out / "cases").exists():
        raise InputError(out, "the folder holds cases", "choose another folder")
    arms = {source.name: MovedArm.of(source) for source in sources}
    seals: dict[str, str] = {}
    turn = turns_of(sources, seed)
    if not paired:
        for source in sources:
            answer = _answer("control", source, ())
            name = f"control_{source.name}"
            seals[name] = _write(out, name, {"": source.runs}, source.urdf, answer)
    for number, (kind, effects) in enumerate(plan_slots(cases, seed)):
        made = None
        name = f"case_{number:03d}"
        for attempt in range(len(sources)):
            source = next(turn)
            rng_of_case = np.random.default_rng([seed, 1, number, attempt])
            arm = arms[source.name]
            before: list[Recording] = []
            if paired:
                before, later = before_and_after(source, np.random.default_rng([seed, 2, number]))
                arm = replace(arm, given=later)
            made = plant_effects(arm, kind, effects, rng_of_case)
            if made is not None:
                break
        if made is None:
            say(f"{name} {kind} {effects}: no arm can show it, left out")
            continue
        runs, urdf, answer = made
        if paired:
            folders: dict[str, Sequence[Recording]] = {"before": before, "after": runs}
        else:
            rng = np.random.default_rng([seed, 2, number])
            folders = {"": runs if effects else _some(runs, rng)}
        seals[name] = _write(out, name, folders, urdf, answer)
        truth = ", ".join(f"{e['effect']}:{'+'.join(e['joints'])}" for e in answer["effects"])
        say(f"{name} {source.name} {kind} {truth}")
    write_record(out / "seals.json", seals)


def write_recorded(folder: Path, out: Path) -> list[str]:
    """Writes the recordings whose cause was measured as cases with answers; returns their names.

    Args:
        folder: Of all recordings of real arms; what is not there is left out, as are arms that are
            kept back.
        out: Folder of the cases.
    """
    seals: dict[str, str] = {}
    closed = kept_back_arms()
    for name, entry in recorded_causes().items():
        if not (folder / entry["folder"]).is_dir() or entry["arm"] in closed:
            continue
        source = load_known(name, entry, folder)
        truth = {
            "effect": entry["effect"],
            "also": entry.get("also", []),
            "in_catalogue": True,
            "joints": entry["stands_at"],
            "may_stand_at": entry["stands_at"],
            "parameters": entry.get("parameters", {}),
            "asked": None,
            "visible": {},
            "by": "recorder",
        }
        answer = _answer("measured", source, (truth,))
        answer["control"] = f"control_{entry['control']}"
        case = f"recorded_{name}"
        seals[case] = _write(out, case, {"": source.runs}, source.urdf, answer)
    return list(seals)


def turns_of(sources: Sequence[Source], seed: int) -> Iterator[Source]:
    """Sources without end, every arm as often as any other."""
    rng = np.random.default_rng([seed, 3])
    names = sorted({source.arm for source in sources})
    while True:
        for k in rng.permutation(len(names)):
            sessions = [source for source in sources if source.arm == names[k]]
            weights = np.array([source.weight for source in sessions])
            yield sessions[int(rng.choice(len(sessions), p=weights / weights.sum()))]


def _some(runs: Sequence[Recording], rng: np.random.Generator) -> Sequence[Recording]:
    """All runs but one, or four fifths of the only one: another recording of the same arm."""
    if len(runs) > 2:
        left_out = int(rng.integers(len(runs)))
        return [run for i, run in enumerate(runs) if i != left_out]
    start = int(rng.integers(len(runs[0]) // 5 + 1))
    return [run.at(slice(start, start + 4 * len(run) // 5)) for run in runs]


def before_and_after(
    source: Source, rng: np.random.Generator
) -> tuple[list[Recording], tuple[slice, ...]]:
    """Every second run as it was, and the rows of the others, to which an effect may come.

    Runs are cut where some joint moves in few of them. Which rows the later set has is known before
    an effect is drawn: what acts for a while only has to act there.

    Returns:
        The earlier runs, and the rows of the later ones, counted over all runs.
    """
    runs = list(source.runs)
    moves = sum(np.ptp(run.position, axis=0) > MOVES for run in runs)
    if min(moves[moves > 0], default=0) < FEWEST_RUNS:
        runs = [piece for run in runs for piece in cut(run, LEAST_PARTS)]
    ends = np.cumsum([0, *(len(run.time) for run in runs)]).tolist()
    rows = [slice(start, end) for start, end in itertools.pairwise(ends)]
    first = int(rng.integers(2))
    return runs[first::2], tuple(rows[1 - first :: 2])


def plant_effects(
    arm: MovedArm, kind: str, effects: Effects, rng: np.random.Generator
) -> tuple[list[Recording], str, Answer] | None:
    """Effects, one after the other, on an arm's recordings.

    Returns:
        Recordings of the rows that are given, URDF and answer of a case; None if nothing that was
        drawn can show so much.
    """
    truth: list[Answer] = []
    urdf = arm.source.urdf
    shift = np.zeros(arm.n)
    now = arm
    for effect, wanted in effects:
        taken: set[str] = set()
        for entry in truth:
            taken.update(entry["joints"])
        sized_change = sized(now, effect, wanted, rng, taken)
        if sized_change is None:
            return None
        change, entry = sized_change
        truth.append(entry)
        now = now.plus(change.torque)
        shift = shift + change.shift
        urdf = change.urdf or urdf
    runs: list[Recording] = []
    names = {run.name for run in arm.source.runs}
    for rows in arm.given:
        number = next(k for k, run in enumerate(arm.runs) if rows.start < run.stop)
        start = arm.runs[number].start
        given = arm.source.runs[number].at(slice(rows.start - start, rows.stop - start))
        # Several pieces of one run are told apart by their first rows.
        name = given.name if given.name in names else f"{given.name}_{rows.start - start}"
        names.discard(given.name)
        planted = replace(given, effort=now.tau[rows], position=given.position + shift)
        runs.append(replace(planted, name=name))
    return runs, urdf, _answer(kind, arm.source, truth, arm.noise)


def sized(
    arm: MovedArm, effect: str, wanted: float, rng: np.random.Generator, taken: set[str]
) -> tuple[PlantedChange, Answer] | None:
    """The effect at a joint where it can show as much as is wanted, and its entry in the answer."""
    law = {**EFFECTS, **OUTSIDE}[effect]
    joints = [int(j) for j in rng.permutation(arm.n) if arm.source.joints[j] not in taken]
    for j in (joints * DRAWS)[:DRAWS]:
        scaled = _scaled(arm, law, j, wanted, int(rng.integers(2**32)))
        if scaled is not None:
            break
    else:
        return None
    change, seen, size = scaled
    names = arm.source.joints
    visible = dict(zip(names, map(float, seen), strict=True))
    shown = [name for name, amplitude in visible.items() if amplitude >= SHOWN * seen.max()]
    planted_at = [] if law.whole_arm else [names[j]]
    may_stand_at = set(planted_at)
    if effect == "joint_coupling":
        may_stand_at.add(str(change.parameters.get("other_joint")))
    also = []
    if effect == "payload":
        may_stand_at.update(names[-1:])
    elif effect == "link_inertial_error" and planted_at == [names[-1]]:
        also = ["payload"]  # a load is one torque with what the last link has more of, exactly
    if law.whole_arm or effect == "external_contact":
        may_stand_at.update(shown)
    return change, {
        "effect": effect,
        "also": also,
        "in_catalogue": effect in EFFECTS,
        "joints": planted_at or shown,
        "may_stand_at": sorted(may_stand_at),
        "parameters": change.parameters,
        "size": size,
        "asked": wanted,
        "view": law.view,
        "visible": {name: round(amplitude, 3) for name, amplitude in visible.items()},
        "by": "urdf" if change.urdf else "recording",
    }


def _scaled(
    arm: MovedArm, law: Planted, j: int, wanted: float, seed: int
) -> tuple[PlantedChange, Float[Array, " n"], float] | None:
    """An effect at a joint as large as is wanted, what of it is visible, and its size.

    None where it can't show so much there.
    """
    most = law.most(arm, j)
    size = most
    if not np.isfinite(arm.noise[j]) and not law.whole_arm:
        return None
    if law.neighbours and arm.n < 2:
        return None
    for _ in range(TRIES):
        try:
            change = law.change(arm, j, size, np.random.default_rng(seed))
        except ValueError:  # this joint has none
            return None
        seen = arm.visible(change.felt, law.view, law.local)
        largest = float(seen.max() if law.whole_arm else seen[j])
        if abs(largest / wanted - 1.0) < NEAR and np.all(np.isfinite(change.torque)):
            return change, seen, size
        if size >= most and largest < wanted:
            return None
        factor = float(np.clip(wanted / max(largest, 1e-9), *STEPS))
        size = min(size * factor, most)
    return None


def _answer(
    kind: str, source: Source, effects: Sequence[Answer], noise: Array | None = None
) -> Answer:
    floor = {} if noise is None else dict(zip(source.joints, map(float, noise), strict=True))
    return {
        "schema": "ident.semi_real/1",
        "kind": kind,
        "arm": source.arm,
        "source": source.name,
        "control": f"control_{source.name}",
        "effects": list(effects),
        "noise_Nm": floor,
    }


def _write(
    out: Path, name: str, folders: Mapping[str, Sequence[Recording]], urdf: str, answer: Answer
) -> str:
    """Writes a case's session folders and its answer; the answer's SHA-256."""
    with atomic_folder(out / "cases" / name, "session") as folder:
        for side, runs in folders.items():
            place = folder / side
            place.mkdir(exist_ok=True)
            fill_session(Session(name, tuple(runs), robot="robot.urdf"), place)
            (place / "robot.urdf").write_text(urdf, encoding="utf-8")
    text = as_json(answer) + "\n"
    write_record(out / "answers" / f"{name}.json", answer)
    return hashlib.sha256(text.encode()).hexdigest()
