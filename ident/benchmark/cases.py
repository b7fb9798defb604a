"""First step of a case: draw what is wrong, where, how much and in which motion; simulate; seal the answer."""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ident.benchmark.oracle import oracle_accuracy
from ident.effects import catalogue
from ident.errors import InputError
from ident.files import atomic_folder, atomic_write
from ident.recordings.save import write_session
from ident.robot.arm import ArmModel
from ident.simulation.answer import seal
from ident.simulation.causes import CATALOGUE, OUTSIDE, find_cause
from ident.simulation.hardware import DECOYS
from ident.simulation.request import EffectRequest
from ident.simulation.simulate import POOR, RICH, SimulationOptions, simulate
from ident.simulation.world import World, WorldRange

FULL_MIX: dict[str, float] = {
    "single": 252,
    "healthy": 60,
    "decoy": 40,
    "pair": 36,
    "triple": 14,
    "excluded": 42,
    "outside": 36,
}
"""Kinds of case and their shares: `excluded` effects are taken out of the catalogue, `outside` were never in it."""
# Number of effects of a kind of case; one of the others.
COUNTS = {"healthy": 0, "decoy": 0, "pair": 2, "triple": 3}
# Visible amplitudes of a single effect in multiples of the noise floor, and motions: three rich for one poor.
SINGLE_CELLS = tuple((size, rich) for rich in (True, True, True, False) for size in (0.3, 1.0, 3.0))
VISIBLE = (1.0, 3.0)
RATES_HZ = (100.0, 250.0, 500.0)
RATE_SHARES = (0.2, 0.6, 0.2)
# Taking an effect out of the catalogue without these would leave its columns there.
TWINS = {effect.id: effect.twins for effect in catalogue.CATALOGUE}
# From this attempt on other effects are drawn too, not only another joint and arm.
OTHER_EFFECTS_FROM = 4


@dataclass(frozen=True)
class Slot:
    """A place in the check: its kind and, for a single effect, its cell of the table of all of them."""

    name: str  # of the case
    kind: str  # one of `FULL_MIX`
    effect: str = ""  # of the cell; drawn if empty
    amplitude: float = 3.0  # visible amplitude [noise floors]
    rich: bool = True  # whether the motion is rich


def parse_mix(text: str) -> dict[str, float]:
    """Reads a mix such as `single=20,healthy=5`; a kind without a number has its share of the full mix.

    Raises:
        InputError: An unknown kind, or shares that are no positive numbers.
    """
    mix = {}
    for part in filter(None, (part.strip() for part in text.split(","))):
        kind, _, share = part.partition("=")
        if kind not in FULL_MIX:
            raise InputError("--mix", f"unknown kind {kind!r}", f"choose from: {', '.join(FULL_MIX)}")
        try:
            mix[kind] = float(share) if share else FULL_MIX[kind]
        except ValueError:
            raise InputError("--mix", f"{part!r} has no number", "write KIND=SHARE, separated by commas") from None
        if not 0.0 <= mix[kind] < np.inf:
            raise InputError("--mix", f"a share of {share} for {kind}", "give a positive number")
    if not any(mix.values()):
        raise InputError("--mix", "it holds no case", f"name one or more of: {', '.join(FULL_MIX)}")
    return mix


def apportion(cases: int, mix: Mapping[str, float]) -> dict[str, int]:
    """Numbers of each kind that add up to all cases: largest remainders."""
    kinds = [kind for kind, share in mix.items() if share > 0.0]
    exact = np.array([mix[kind] for kind in kinds]) * cases / sum(mix.values())
    counts = np.floor(exact).astype(int)
    for k in np.argsort(-(exact - counts), kind="stable")[: cases - int(counts.sum())]:
        counts[k] += 1
    return dict(zip(kinds, map(int, counts), strict=True))


def plan_slots(cases: int, mix: Mapping[str, float], seed: int) -> tuple[Slot, ...]:
    """All places of a check. Single effects take the cells effect × size × motion in turn: every effect once a round,
    with another cell in every round.
    """
    effects = tuple(CATALOGUE)
    rng = np.random.default_rng([seed, 0])
    kinds = [kind for kind, count in apportion(cases, mix).items() for _ in range(count)]
    order = {effect: rng.permutation(len(SINGLE_CELLS)) for effect in effects}
    singles = (
        (str(effect), *SINGLE_CELLS[order[effect][turn % len(SINGLE_CELLS)]])
        for turn in range(-(-kinds.count("single") // len(effects)))
        for effect in rng.permutation(effects)
    )
    width = max(3, len(str(cases - 1)))
    slots = []
    for i, kind in enumerate(kinds):
        effect, amplitude, rich = next(singles) if kind == "single" else ("", 3.0, kind != "healthy" or bool(i % 4))
        slots.append(Slot(f"case_{i:0{width}d}", kind, effect, amplitude, rich))
    return tuple(slots)


def draw_world_of(number: int, seed: int, worlds: Sequence[WorldRange]) -> World | None:
    """The world of a case: of the ranges in turn, in an order that does not go with the kinds of case; None of none."""
    if not worlds:
        return None
    turn, place = divmod(number, len(worlds))
    order = np.random.default_rng([seed, 4, turn]).permutation(len(worlds))
    return worlds[int(order[place])].draw(np.random.default_rng([seed, 5, number]))


def draw_case(
    slot: Slot, number: int, seed: int, base: SimulationOptions, joints: Sequence[str], attempt: int = 0
) -> tuple[SimulationOptions, tuple[str, ...]]:
    """Draws what a place leaves open.

    Args:
        slot: The place.
        number: Its number.
        seed: Of the check.
        base: What all cases have in common (robot, number and length of runs), or the case's world.
        joints: The robot's joints.
        attempt: Goes up where the size asked for is impossible at the joint drawn.

    Returns:
        The session to be simulated, and the ids that the diagnosis must do without.
    """
    fixed = np.random.default_rng([seed, 1, number, max(attempt - OTHER_EFFECTS_FROM + 1, 0)])
    rng = np.random.default_rng([seed, 2, number, attempt])
    effects = tuple(
        EffectRequest(effect, "" if find_cause(effect).whole_arm else str(rng.choice(joints)), amplitude=size)
        for effect, size in _draw_effects(slot, attempt, fixed)
    )
    options = replace(
        base,
        effects=effects,
        seed=int(rng.integers(2**62)),
        motions=RICH if slot.rich else POOR,
        rate=float(rng.choice(RATES_HZ, p=RATE_SHARES)),
        velocity=bool(rng.random() < 0.75),
        temperature=bool(rng.random() < 0.5),
        decoys=(str(rng.choice(list(DECOYS))),) if slot.kind == "decoy" else (),
        friction_spread=float(rng.choice([0.0, 0.01, 0.02])),
    )
    if base.world is not None:
        options = options.in_world(base.world)
    first = effects[0].effect if slot.kind == "excluded" else ""
    return options, (first, *TWINS.get(first, ())) if first else ()


def _draw_effects(slot: Slot, attempt: int, rng: np.random.Generator) -> list[tuple[str, float]]:
    """Ids and visible amplitudes."""
    if slot.kind == "single" and attempt < OTHER_EFFECTS_FROM and slot.effect:
        return [(slot.effect, slot.amplitude)]
    family = OUTSIDE if slot.kind == "outside" else CATALOGUE
    while True:
        ids = [str(one) for one in rng.choice(list(family), COUNTS.get(slot.kind, 1), replace=False)]
        if not any(twin in ids for one in ids for twin in TWINS.get(one, ())):
            break
    sizes = [slot.amplitude] if slot.kind == "single" else [float(rng.choice(VISIBLE)) for _ in ids]
    return list(zip(ids, sizes, strict=True))


MOST_ATTEMPTS = 12
MADE_NAME = "made.json"


@dataclass(frozen=True)
class MakeTask:
    """What the simulating process is told."""

    slot: Slot  # the case's place
    number: int  # and its number
    seed: int  # of the check
    base: SimulationOptions  # what all cases have in common
    session: Path  # folder for the recordings
    sealed: Path  # folder for the envelope
    stamp: str  # of the simulating code
    worlds: tuple[WorldRange, ...] = ()  # where the case's world is drawn from; empty for the plant's own
    oracle: bool = True  # whether the bound of single effects is worked out

    @property
    def key(self) -> bytes:
        """Key of the case's envelope: follows from the check's seed, which the diagnosing processes never get."""
        return hashlib.sha256(f"{self.seed} {self.slot.name} ident.blind/1".encode()).digest()

    def drawn(self, attempt: int) -> tuple[SimulationOptions, tuple[str, ...]]:
        """The case as drawn at an attempt: what is simulated, and the ids that are taken out of the catalogue."""
        world = draw_world_of(self.number, self.seed, self.worlds)
        base = self.base if world is None else self.base.in_world(world)
        joints = ArmModel.load(base.robot).joint_names
        return draw_case(self.slot, self.number, self.seed, base, joints, attempt)


def make(task: MakeTask) -> str:
    """Makes a case and seals its answer; returns its name. Draws again where a size is impossible."""
    start, used, name = time.perf_counter(), time.process_time(), task.slot.name
    for attempt in range(MOST_ATTEMPTS):
        try:
            options, excluded = task.drawn(attempt)
            made = simulate(options, name)
            accuracy = oracle_accuracy(made) if task.oracle and task.slot.kind == "single" else None
            break
        except InputError:
            if attempt == MOST_ATTEMPTS - 1:
                raise
    write_session(made.session, task.session)
    with atomic_folder(task.sealed, "envelope") as folder:
        record = {
            "sha256": seal(made.answer, folder, task.key),
            "attempt": attempt,
            "excluded": list(excluded),
            "robot": options.robot,
            "starts": [float(run.time[0]) for run in made.session.runs],
            "oracle": accuracy,
            "seconds": time.perf_counter() - start,
            "processor_seconds": time.process_time() - used,
            "stamp": task.stamp,
        }
        with atomic_write(folder / MADE_NAME) as part:
            part.write_text(json.dumps(record) + "\n", encoding="utf-8")
    return name
