"""First step of a case.

Draw what is wrong, where, how much and in which motion; simulate; seal the answer.

The arm runs with each cause of the catalogue at the true joint, at its typical size; what is left
of the change of torque after the best ordinary model is that cause's signature. Torque noise and
encoder noise, with their spectra, and friction that changes from run to run, with its variance, are
the noise. Which signature is there, at a size that nobody knows, is then a question to a linear
Gaussian model, whose answer needs the signatures' products alone: noise is drawn, the most probable
cause named, and the share of true names counted.

It is a bound, not a competitor: it knows the true cause's inner parameters, takes noise as that of
an unloaded joint, and needs no smoothing.

Source: Eriksson, Frisk and Krysander 2013 (distinguishability of faults as the Kullback-Leibler
divergence).
"""

from __future__ import annotations

import hashlib
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ident.arrays import Array, Float
from ident.effects import catalogue
from ident.errors import InputError
from ident.files import atomic_folder, atomic_write
from ident.recordings.save import write_session
from ident.records import as_json
from ident.robot.arm import ArmModel
from ident.simulation.causes import CATALOGUE, OUTSIDE, Cause, Circumstances, find_cause
from ident.simulation.hardware import DECOYS, Hardware
from ident.simulation.request import EffectRequest, seal
from ident.simulation.simulate import POOR, RICH, Simulation, SimulationOptions, simulate
from ident.simulation.visibility import VisibilityMeter
from ident.simulation.visible_rows import STRIDE_S
from ident.simulation.world import World, WorldRange, noise_density

# Sizes that are thought possible, in visible noise floors, evenly in the logarithm.
SIZES = np.geomspace(0.1, 10.0, 25)
DRAWS = 400
# Causes that show less than this at their typical size are no rivals [noise floors].
LEAST_SHOWN = 0.02
FULL_MIX: dict[str, float] = {
    "single": 252,
    "healthy": 60,
    "decoy": 40,
    "pair": 36,
    "triple": 14,
    "excluded": 42,
    "outside": 36,
}
"""Kinds of case and their shares.

`excluded` effects are taken out of the catalogue, `outside` were never in it.
"""
# Number of effects of a kind of case; one of the others.
COUNTS = {"healthy": 0, "decoy": 0, "pair": 2, "triple": 3}
# Visible amplitudes of a single effect in multiples of the noise floor, and motions: three rich for
# one poor.
SINGLE_CELLS = tuple((size, rich) for rich in (True, True, True, False) for size in (0.3, 1.0, 3.0))
VISIBLE = (1.0, 3.0)
RATES_HZ = (100.0, 250.0, 500.0)
RATE_SHARES = (0.2, 0.6, 0.2)
# Taking an effect out of the catalogue without these would leave its columns there.
TWINS = {effect.id: effect.twins for effect in catalogue.CATALOGUE}
# From this attempt on other effects and worlds are drawn too, not only another joint and arm.
OTHER_EFFECTS_FROM = 4
MOST_ATTEMPTS = 40
MADE_NAME = "made.json"


def oracle_accuracy(simulation: Simulation) -> float | None:
    """Probability that an oracle names the only effect of a case in a world.

    None where it is not worked out.
    """
    meter = simulation.meter
    truth = simulation.answer.effects
    world = simulation.options.world
    if world is None or meter is None or len(truth) != 1 or truth[0].effect not in CATALOGUE:
        return None
    true = CATALOGUE[truth[0].effect]
    names = meter.hardware.arm.joint_names
    joint = names.index(truth[0].joints[0]) if truth[0].joints else len(names) - 1
    scene = Circumstances(meter.hardware, joint, meter.motions, np.random.default_rng(0))
    first = meter.show(true, scene, truth[0].size, simulation.seeds[0], true.view, true.needs_all)
    # The true signature at its size, the others at one noise floor.
    floor = np.array(list(simulation.answer.noise_floor_Nm.values()))
    signatures = [first.torque, *_rival_signatures(meter, scene, true, floor)]
    stack = np.stack(signatures, axis=2)
    gram = np.zeros((len(signatures), len(signatures)))
    # Products of each run and joint.
    for number in np.unique(first.run):
        rows = first.run == number
        speed = first.speed[rows]
        for products in _run_products(stack[rows], speed, simulation.hardware, world):
            gram += products
    gram /= first.share
    return name_by_evidence(gram, np.random.default_rng([0, 7])) if gram[0, 0] > 0.0 else 0.0


def _rival_signatures(
    meter: VisibilityMeter, scene: Circumstances, true: Cause, floor: Float[Array, " n"]
) -> list[Float[Array, "t n"]]:
    """Signatures of all other causes that show at their typical size, at one noise floor.

    Args:
        meter, scene: What shows causes, and the circumstances of the true one.
        true: The true cause.
        floor: Noise floor of each joint [N m].
    """
    signatures = []
    for cause in CATALOGUE.values():
        if cause.id == true.id or (cause.needs_all and not true.needs_all):
            continue
        try:
            size = float(np.clip(cause.typical(scene), *cause.bounds(scene)))
            shown = meter.show(cause, scene, size, 0, true.view, true.needs_all)
        except InputError:  # the arm can't move with it: it is not what happened
            continue
        level = float((shown.rms / floor).max())
        if level > LEAST_SHOWN:
            signatures.append(shown.torque / level)
    return signatures


def _run_products(
    stack: Float[Array, "t n K"], speed: Float[Array, "t n"], hardware: Hardware, world: World
) -> Iterator[Float[Array, "K K"]]:
    """Products of signatures over a run in units of the noise, joint by joint.

    What the run's own friction may explain is taken out as far as it varies.

    Args:
        stack: Signatures along the run [N m].
        speed: Of each joint [rad/s].
        hardware, world: The arm with its friction and sensors, and how these vary.
    """
    count, joints, k = stack.shape
    level = hardware.friction
    change = np.hypot(world.friction_spread, world.friction_drift / np.sqrt(2.0))
    frequencies = np.fft.rfftfreq(count, STRIDE_S)
    variance = noise_density(hardware, world, frequencies) * 0.5 / STRIDE_S
    # All frequencies but the first, and the last of an even count, stand for two.
    is_single = (frequencies == 0.0) | (2 * np.arange(len(frequencies)) == count)
    weight = np.where(is_single, 1.0, 2.0)
    for j in range(joints):
        coulomb = np.sign(speed[:, j]) * level.coulomb[j]
        viscous = speed[:, j] * level.viscous[j]
        columns = np.column_stack([stack[:, j], change * np.column_stack([coulomb, viscous])])
        scale = np.sqrt(weight / variance[:, j] / count)[:, None]
        spectra = np.fft.rfft(columns, axis=0) * scale
        products = (spectra.conj().T @ spectra).real
        cross = products[:k, k:]
        of_friction = products[k:, k:] + np.eye(2)
        yield products[:k, :k] - cross @ np.linalg.solve(of_friction, cross.T)


def name_by_evidence(gram: Float[Array, "K K"], rng: np.random.Generator) -> float:
    """Share of true names over drawn noise; the first signature is the true one, at its true size.

    A cause at b times its signature has the log-likelihood b y - b² G / 2 above that of none, y the
    product of the data with the signature.
    """
    k = len(gram)
    root = np.linalg.cholesky(gram + 1e-9 * np.trace(gram) / k * np.eye(k) + 1e-12 * np.eye(k))
    data = gram[0] + rng.standard_normal((DRAWS, k)) @ root.T
    # Of each signature sizes from the same span of what can be seen: the true one is as large as it
    # is.
    sizes = np.concatenate([-SIZES[::-1], SIZES])
    log_likelihood = data[:, :, None] * sizes - 0.5 * sizes**2 * np.diag(gram)[:, None]
    evidence = np.logaddexp.reduce(log_likelihood, axis=2) - np.log(len(sizes))
    # Before the data, none is as probable as all causes together: what does not show is not named.
    return float(np.mean((evidence.argmax(axis=1) == 0) & (evidence.max(axis=1) > np.log(k))))


@dataclass(frozen=True)
class Slot:
    """A place in the check.

    Its kind and, for a single effect, its cell of the table of all of them.
    """

    name: str  # of the case
    kind: str  # one of `FULL_MIX`
    effect: str = ""  # of the cell; drawn if empty
    amplitude: float = 3.0  # visible amplitude [noise floors]
    rich: bool = True  # whether the motion is rich


def parse_mix(text: str) -> dict[str, float]:
    """Reads a mix such as `single=20,healthy=5`.

    A kind without a number has its share of the full mix.

    Raises:
        InputError: An unknown kind, or shares that are no positive numbers.
    """
    known = ", ".join(FULL_MIX)
    mix: dict[str, float] = {}
    for entry in text.split(","):
        entry = entry.strip()
        if not entry:
            continue
        kind, _, share = entry.partition("=")
        if kind not in FULL_MIX:
            raise InputError("--mix", f"unknown kind {kind!r}", f"choose from: {known}")
        try:
            mix[kind] = float(share) if share else FULL_MIX[kind]
        except ValueError:
            what = f"{entry!r} has no number"
            remedy = "write KIND=SHARE, separated by commas"
            raise InputError("--mix", what, remedy) from None
        if not 0.0 <= mix[kind] < np.inf:
            raise InputError("--mix", f"a share of {share} for {kind}", "give a positive number")
    if not any(mix.values()):
        raise InputError("--mix", "it holds no case", f"name one or more of: {known}")
    return mix


def apportion(cases: int, mix: Mapping[str, float]) -> dict[str, int]:
    """Numbers of each kind that add up to all cases: largest remainders."""
    wanted = {kind: share for kind, share in mix.items() if share > 0.0}
    exact = np.array(list(wanted.values())) * cases / sum(mix.values())
    counts = np.floor(exact).astype(int)
    counts[np.argsort(counts - exact, kind="stable")[: cases - int(counts.sum())]] += 1
    return dict(zip(wanted, map(int, counts), strict=True))


def plan_slots(cases: int, mix: Mapping[str, float], seed: int) -> tuple[Slot, ...]:
    """All places of a check.

    Single effects take the cells effect × size × motion in turn: every effect once a round,
    with another cell in every round.
    """
    rng = np.random.default_rng([seed, 0])
    kinds: list[str] = []
    for kind, count in apportion(cases, mix).items():
        kinds += [kind] * count
    singles = _single_cells(kinds.count("single"), rng)
    width = max(3, len(str(cases - 1)))
    slots = []
    for i, kind in enumerate(kinds):
        effect = ""
        amplitude = 3.0
        rich = kind != "healthy" or bool(i % 4)
        if kind == "single":
            effect, amplitude, rich = next(singles)
        slots.append(Slot(f"case_{i:0{width}d}", kind, effect, amplitude, rich))
    return tuple(slots)


def _single_cells(count: int, rng: np.random.Generator) -> Iterator[tuple[str, float, bool]]:
    """Effects with their sizes and motions for at least so many cases."""
    effects = tuple(CATALOGUE)
    order = {effect: rng.permutation(len(SINGLE_CELLS)) for effect in effects}
    rounds = -(-count // len(effects))
    for turn in range(rounds):
        for effect in rng.permutation(effects):
            cell = order[effect][turn % len(SINGLE_CELLS)]
            yield (str(effect), *SINGLE_CELLS[cell])


def draw_world_of(
    number: int, seed: int, worlds: Sequence[WorldRange], again: int = 0
) -> World | None:
    """The world of a case.

    Of the ranges in turn, in an order that does not go with the kinds of case; None of none.

    Args:
        number: The case's.
        seed: The check's.
        worlds: The ranges.
        again: How many times it was drawn anew: in some worlds nothing shows as much as it should.
    """
    if not worlds:
        return None
    turn, place = divmod(number, len(worlds))
    order = np.random.default_rng([seed, 4, turn]).permutation(len(worlds))
    rng = np.random.default_rng([seed, 5, number, again] if again else [seed, 5, number])
    return worlds[int(order[(place + again) % len(worlds)])].draw(rng)


def draw_case(
    slot: Slot,
    number: int,
    seed: int,
    base: SimulationOptions,
    joints: Sequence[str],
    attempt: int = 0,
) -> tuple[SimulationOptions, tuple[str, ...]]:
    """Draws what a place leaves open.

    Returns:
        The session to be simulated, and the ids that the diagnosis must do without.
    """
    fixed = np.random.default_rng([seed, 1, number, max(attempt - OTHER_EFFECTS_FROM + 1, 0)])
    rng = np.random.default_rng([seed, 2, number, attempt])
    if slot.kind == "single" and attempt < OTHER_EFFECTS_FROM and slot.effect:
        wanted = [(slot.effect, slot.amplitude)]
    else:
        wanted = _draw_effects(slot, fixed)
    effects = []
    for effect, size in wanted:
        joint = "" if find_cause(effect).whole_arm else str(rng.choice(joints))
        effects.append(EffectRequest(effect, joint, amplitude=size))
    options = replace(
        base,
        effects=tuple(effects),
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
    if slot.kind != "excluded" or not effects[0].effect:
        return options, ()
    excluded = effects[0].effect
    return options, (excluded, *TWINS.get(excluded, ()))


def _draw_effects(slot: Slot, rng: np.random.Generator) -> list[tuple[str, float]]:
    """Effects of a place with their visible amplitudes [noise floors], none twin of another."""
    family = list(OUTSIDE if slot.kind == "outside" else CATALOGUE)
    count = COUNTS.get(slot.kind, 1)
    ids = list(map(str, rng.choice(family, count, replace=False)))
    while _has_twins(ids):
        ids = list(map(str, rng.choice(family, count, replace=False)))
    if slot.kind == "single":
        return [(effect, slot.amplitude) for effect in ids]
    return [(effect, float(rng.choice(VISIBLE))) for effect in ids]


def _has_twins(ids: Sequence[str]) -> bool:
    """Whether one of some effects leaves the columns of another in the catalogue."""
    twins = {twin for effect in ids for twin in TWINS.get(effect, ())}
    return any(effect in twins for effect in ids)


@dataclass(frozen=True)
class MakeTask:
    """What the simulating process is given."""

    slot: Slot  # the case's place
    number: int  # and its number
    seed: int  # of the check
    base: SimulationOptions  # what all cases have in common
    session: Path  # folder for the recordings
    sealed: Path  # folder for the envelope
    stamp: str  # of the simulating code
    worlds: tuple[
        WorldRange, ...
    ] = ()  # where the case's world is drawn from; empty for the plant's own
    oracle: bool = True  # whether the bound of single effects is worked out

    @property
    def key(self) -> bytes:
        """Key of the case's envelope.

        Follows from the check's seed, which the diagnosing processes never get.
        """
        return hashlib.sha256(f"{self.seed} {self.slot.name} ident.blind/1".encode()).digest()

    def drawn(self, attempt: int) -> tuple[SimulationOptions, tuple[str, ...]]:
        """The case as drawn at an attempt.

        What is simulated, and the ids that are taken out of the catalogue.
        """
        again = max(attempt - OTHER_EFFECTS_FROM + 1, 0)
        world = draw_world_of(self.number, self.seed, self.worlds, again)
        base = self.base if world is None else self.base.in_world(world)
        joints = ArmModel.load(base.robot).joint_names
        return draw_case(self.slot, self.number, self.seed, base, joints, attempt)


def make(task: MakeTask) -> str:
    """Makes a case and seals its answer; returns its name.

    Draws again where a size is impossible.
    """
    start = time.perf_counter()
    used = time.process_time()
    name = task.slot.name
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
        with atomic_write(folder / MADE_NAME) as scratch:
            scratch.write_text(as_json(record, None) + "\n", encoding="utf-8")
    return name
