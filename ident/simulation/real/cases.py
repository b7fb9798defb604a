"""Cases: which effect, on whose recordings, where and how large; written as sessions and answers
apart from them.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Sequence
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
from ident.simulation.real.planted import (
    EFFECTS,
    Draw,
    Planted,
    PlantedChange,
    at_joint,
    at_speed,
    bristle,
    decay,
    fixed,
    neighbour,
    over_range,
    up_to,
)
from ident.simulation.real.sources import Source, cut, kept_back_arms, load_known, recorded_causes

SIZES = (3.0, 1.0)
PAIR_SIZES = (3.0, 3.0)
# How near a size has to come to what was asked for, in how many tries; draws of joint and numbers a
# case.
NEAR = 0.1
TRIES = 12
DRAWS = 7
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
LEAST_PARTS = 6
MOVES = 0.05  # of a run that is cut; how far a joint goes that moves in one [rad, m]


def plant_cable(arm: MovedArm, j: int, size: float, draw: Draw) -> PlantedChange:
    """A cable pulls tight beyond an angle."""
    start = float(np.quantile(arm.q[:, j], draw.uniform(0.5, 0.75)))
    return at_joint(arm, j, size * np.maximum(arm.q[:, j] - start, 0.0) ** 2, {"from_rad": start})


def plant_product(arm: MovedArm, j: int, size: float, draw: Draw) -> PlantedChange:
    """Drag where the neighbour moves fast, too."""
    other = neighbour(arm, j, draw)
    return at_joint(
        arm,
        j,
        size * arm.v[:, j] * np.abs(arm.v[:, other]),
        {"other_joint": arm.source.joints[other]},
    )


def plant_seal(arm: MovedArm, j: int, size: float, draw: Draw) -> PlantedChange:
    """A seal winds up with the shaft and relaxes."""
    relaxation = float(draw.uniform(0.2, 1.0))
    speed = np.where(np.isfinite(arm.steps), arm.v[:, j], 0.0)
    return at_joint(arm, j, size * decay(arm, speed, relaxation), {"relaxation_s": relaxation})


def plant_brake(arm: MovedArm, j: int, size: float, draw: Draw) -> PlantedChange:
    """The holding brake lets go slowly at the start of each run."""
    fading = float(draw.uniform(1.0, 3.0))
    holding = np.zeros(len(arm.t))
    for rows in arm.given:
        since = arm.t[rows] - arm.t[rows.start]
        holding[rows] = np.exp(-since / fading)
    return at_joint(arm, j, size * holding * bristle(arm, arm.v[:, j]), {"decay_s": fading})


def plant_sag(arm: MovedArm, j: int, size: float, draw: Draw) -> PlantedChange:
    """The supply sags under the power of all drives, and with it the scale of one reading."""
    power = np.abs(arm.load * arm.v).sum(axis=1)
    share = power / max(float(np.quantile(power, 0.99)), 1e-9)
    return at_joint(arm, j, size * share * arm.tau[:, j], {"largest_rise": size})


def plant_floor(arm: MovedArm, j: int, size: float, draw: Draw) -> PlantedChange:
    """The floor shakes the arm at a steady pace."""
    pace = float(draw.uniform(0.8, 4.0))
    return at_joint(arm, j, size * np.sin(2.0 * np.pi * pace * arm.t), {"frequency_Hz": pace})


def plant_tooth(arm: MovedArm, j: int, size: float, draw: Draw) -> PlantedChange:
    """Friction of sliding teeth, of a size [N m], turns round at every pitch point."""
    usual = float(np.quantile(np.abs(arm.v[:, j]), 0.6)) + 1e-3
    order = float(np.clip(round(2.0 * np.pi * draw.uniform(0.8, 3.0) / usual), 4, 80))
    wave = np.tanh(4.0 * np.sin(order * arm.q[:, j]))
    return at_joint(
        arm, j, size * np.abs(arm.load[:, j]) * wave * bristle(arm, arm.v[:, j]), {"teeth": order}
    )


def plant_ageing(arm: MovedArm, j: int, size: float, draw: Draw) -> PlantedChange:
    """Dry friction that starts high after each reversal and wears off with travel."""
    travel = float(draw.uniform(0.03, 0.2))
    v = arm.v[:, j]
    torque = size * (bristle(arm, v) - bristle(arm, v, travel))
    return at_joint(arm, j, torque, {"travel_rad": travel})


OUTSIDE: dict[str, Planted] = {
    "cable_at_the_end": Planted(plant_cable, over_range(30.0)),
    "velocity_product_drag": Planted(plant_product, at_speed(5.0), neighbours=True),
    "seal_relaxation": Planted(plant_seal, over_range(20.0)),
    "brake_release": Planted(plant_brake, up_to(1.0), local=True),
    "supply_sag": Planted(plant_sag, fixed(0.6)),
    "floor_vibration": Planted(plant_floor, up_to(0.6)),
    "tooth_friction": Planted(plant_tooth, fixed(0.5)),
    "wearing_off_after_reversal": Planted(plant_ageing, up_to(0.8)),
}
"""Laws that no catalogue lists."""


Effects = tuple[tuple[str, float], ...]
"""Effects that are requested: id and visible size [noise] of each."""


def plan_slots(cases: int, seed: int) -> list[tuple[str, Effects]]:
    """Kinds of case by their shares, each with its effects; singles in turn, every second or third
    of them small.
    """
    rng = np.random.default_rng([seed, 0])
    counts = {kind: round(share * cases) for kind, share in KINDS.items() if kind != "single"}
    singles = cases - sum(counts.values())
    order = [
        str(e) for _ in range(-(-singles // len(EFFECTS))) for e in rng.permutation(list(EFFECTS))
    ]
    drawn: list[tuple[str, Effects]] = [
        ("single", ((effect, SIZES[0] if (i // len(EFFECTS)) % 5 in (0, 2, 4) else SIZES[1]),))
        for i, effect in enumerate(order[:singles])
    ]
    others = [
        str(e) for e in rng.permutation(list(OUTSIDE) * (1 + counts["outside"] // len(OUTSIDE)))
    ]
    drawn += [("outside", ((effect, SIZES[0]),)) for effect in others[: counts["outside"]]]
    for _ in range(counts["pair"]):
        first, second = (str(e) for e in rng.choice(list(EFFECTS), 2, replace=False))
        drawn.append(
            (
                "pair",
                tuple(
                    sorted(
                        zip((first, second), PAIR_SIZES, strict=True), key=lambda e: e[0] in LAST
                    )
                ),
            )
        )
    return drawn + [("untouched", ())] * counts["untouched"]


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
    for source in () if paired else sources:
        _write(
            out,
            f"control_{source.name}",
            {"": source.runs},
            source.urdf,
            _answer("control", source, ()),
            seals,
        )
    for number, (kind, effects) in enumerate(plan_slots(cases, seed)):
        made = None
        name = f"case_{number:03d}"
        for attempt in range(len(sources)):
            source = next(turn)
            rng_of_case = np.random.default_rng([seed, 1, number, attempt])
            made = plant_effects(arms[source.name], kind, effects, rng_of_case)
            if made is not None:
                break
        if made is None:
            say(f"{name} {kind} {effects}: no arm can show it, left out")
            continue
        runs, urdf, answer = made
        rng = np.random.default_rng([seed, 2, number])
        folders = (
            _before_and_after(source, runs, rng)
            if paired
            else {"": runs if effects else _some(runs, rng)}
        )
        _write(out, name, folders, urdf, answer, seals)
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
        answer = {**_answer("measured", source, (truth,)), "control": f"control_{entry['control']}"}
        _write(out, f"recorded_{name}", {"": source.runs}, source.urdf, answer, seals)
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


def _before_and_after(
    source: Source, runs: Sequence[Recording], rng: np.random.Generator
) -> dict[str, Any]:
    """Every second run as it was, the others with the effect; runs are cut where some joint moves
    in few of them.
    """
    pieces = [list(source.runs), list(runs)]
    moves = sum(np.ptp(run.position, axis=0) > MOVES for run in runs)
    if min(moves[moves > 0], default=0) < 4:
        pieces = [_cut_each(side) for side in pieces]
    first = int(rng.integers(2))
    return {"before": pieces[0][first::2], "after": pieces[1][1 - first :: 2]}


def _cut_each(runs: Sequence[Recording]) -> list[Recording]:
    """The pieces of some runs, one after the other."""
    return [piece for run in runs for piece in cut(run, LEAST_PARTS)]


def plant_effects(
    arm: MovedArm, kind: str, effects: Effects, rng: np.random.Generator
) -> tuple[list[Recording], str, dict[str, Any]] | None:
    """Effects, one after the other, on an arm's recordings.

    Returns:
        Recordings of the rows that are given, URDF and answer of a case; None if nothing that was
        drawn can show so much.
    """
    truth: list[dict[str, Any]] = []
    urdf = arm.source.urdf
    shift = np.zeros(arm.n)
    now = arm
    for effect, wanted in effects:
        sized_change = sized(
            now, effect, wanted, rng, {joint for entry in truth for joint in entry["joints"]}
        )
        if sized_change is None:
            return None
        change, entry = sized_change
        truth.append(entry)
        now = now.plus(change.torque)
        shift = shift + change.shift
        urdf = change.urdf or urdf
    runs: list[Recording] = []
    for rows in arm.given:
        number = next(k for k, run in enumerate(arm.runs) if rows.start < run.stop)
        start = arm.runs[number].start
        given = arm.source.runs[number].at(slice(rows.start - start, rows.stop - start))
        runs.append(replace(given, effort=now.tau[rows], position=given.position + shift))
    return runs, urdf, _answer(kind, arm.source, truth, arm.noise)


def sized(
    arm: MovedArm, effect: str, wanted: float, rng: np.random.Generator, taken: set[str]
) -> tuple[PlantedChange, dict[str, Any]] | None:
    """The effect at a joint where it can show as much as is wanted, and its entry in the answer."""
    law = {**EFFECTS, **OUTSIDE}[effect]
    joints = [int(j) for j in rng.permutation(arm.n) if arm.source.joints[j] not in taken]
    for j in (joints * DRAWS)[:DRAWS]:
        scaled = _scaled(arm, law, j, wanted, int(rng.integers(2**32)))
        if scaled is not None:
            break
    else:
        return None
    (change, seen, size) = scaled
    names = arm.source.joints
    shown = [
        name for name, visible in zip(names, seen, strict=True) if visible >= SHOWN * seen.max()
    ]
    own_joints = [] if law.whole_arm else [names[j]]
    others = {
        "joint_coupling": [str(change.parameters.get("other_joint"))],
        "payload": names[-1:],
    }.get(effect, ())
    return change, {
        "effect": effect,
        "in_catalogue": effect in EFFECTS,
        "joints": own_joints or shown,
        "may_stand_at": sorted(
            {
                *own_joints,
                *others,
                *(shown if law.whole_arm or effect == "external_contact" else []),
            }
        ),
        "parameters": change.parameters,
        "size": size,
        "asked": wanted,
        "view": law.view,
        "visible": {
            name: round(float(visible), 3) for name, visible in zip(names, seen, strict=True)
        },
        "by": "urdf" if change.urdf else "recording",
    }


def _scaled(
    arm: MovedArm, law: Planted, j: int, wanted: float, seed: int
) -> tuple[PlantedChange, Float[Array, " n"], float] | None:
    most = size = law.most(arm, j)
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
        size = min(size * float(np.clip(wanted / max(largest, 1e-9), 0.01, 5.0)), most)
    return None


def _answer(
    kind: str, source: Source, effects: Sequence[dict[str, Any]], noise: Array | None = None
) -> dict[str, Any]:
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
    out: Path,
    name: str,
    folders: dict[str, Sequence[Recording]],
    urdf: str,
    answer: dict[str, Any],
    seals: dict[str, str],
) -> None:
    """A case's session folders and its answer; adds the answer's SHA-256 to the seals."""
    with atomic_folder(out / "cases" / name, "session") as folder:
        for side, runs in folders.items():
            place = folder / side
            place.mkdir(exist_ok=True)
            fill_session(Session(name, tuple(runs), robot="robot.urdf"), place)
            (place / "robot.urdf").write_text(urdf, encoding="utf-8")
    text = as_json(answer) + "\n"
    seals[name] = hashlib.sha256(text.encode()).hexdigest()
    write_record(out / "answers" / f"{name}.json", answer)
