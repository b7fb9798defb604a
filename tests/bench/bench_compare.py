"""Compares pairs of simulated sessions of one arm each, over worlds, and counts what was named, how large, and alarms.

    python tests/bench/bench_compare.py PAIRS [--seed N] [--out FILE.jsonl] [--runs 6] [--seconds 6] [--budget S]

Each pair is drawn: a world, an arm, whether the motions are the same before and after, and what happens in between:
nothing (every third pair), a payload that comes or goes, friction of one joint after a service, a drive's gain, an
offset, something mounted on a link. Fresh from the system's entropy unless a seed is given. Counted: *named*: the
effect (or one of its class) at its joint (or at one that the answer leaves open), with no false name beside; *strict*:
the first name and place are the true ones; *alone*: strict, and nothing else is left open; *sized*: the interval of the
true figure holds it; *alarms*: anything told where nothing changed. FILE gets a line of JSON for each pair.
"""

import argparse
import json
import secrets
import time
from collections import Counter
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ident import compare
from ident.errors import InputError
from ident.robot.arm import ArmModel
from ident.simulation.causes import Circumstances, find_cause
from ident.simulation.hardware import draw_hardware
from ident.simulation.request import EffectRequest
from ident.simulation.simulate import Simulation, SimulationOptions, simulate
from ident.simulation.world import PRESETS, settle

KINDS = ("payload", "friction_change", "torque_gain_error", "torque_offset", "link_inertial_error")
# Sizes are the plant's typical ones times a factor between these.
FACTORS = 0.7, 2.5
# Friction after a service: so many times what it was.
SERVICE = 0.6, 1.6
# What each kind is determined by: the figure of the answer and the change's own.
FIGURES = {
    "payload": "mass_kg",
    "torque_gain_error": "gain",
    "torque_offset": "offset_Nm",
    "link_inertial_error": "mass_change_kg",
    "friction_change": "coulomb_change_Nm",
}


@dataclass(frozen=True)
class Pair:
    """What was drawn and what was reported."""

    kind: str
    world: str
    joint: str
    size: float
    same_motions: bool
    verdict: str
    shown: tuple[tuple[str, tuple[str, ...], tuple[str, ...], tuple[tuple[str, str], ...]], ...]
    interval: tuple[float, float, float] | None
    seconds: float
    doubted: tuple[str, ...]

    @property
    def named(self) -> bool:
        return bool(self.shown) and all(self._right(*one) for one in self.shown)

    @property
    def seen(self) -> bool:
        return any(self._right(*one) for one in self.shown)

    @property
    def sized(self) -> bool:
        return self.interval is not None and self.interval[1] <= self.size <= self.interval[2]

    @property
    def strict(self) -> bool:
        return len(self.shown) == 1 and self.shown[0][0] == self.kind and self.joint in ("", *self.shown[0][2])

    @property
    def alone(self) -> bool:
        """Whether the answer leaves neither another effect nor another place open."""
        return self.strict and len(self.shown[0][1]) <= 1 and not self.shown[0][3]

    def _right(
        self, effect: str, near: tuple[str, ...], joints: tuple[str, ...], elsewhere: tuple[tuple[str, str], ...]
    ) -> bool:
        here = (effect == self.kind or self.kind in near) and (not self.joint or self.joint in joints)
        return here or (self.kind, self.joint) in elsewhere


def draw_pair(seed: int, runs: int, seconds: float) -> Pair:
    """One pair, simulated and compared."""
    rng = np.random.default_rng([seed, 77])
    preset = list(PRESETS.values())[int(rng.integers(len(PRESETS)))]
    world = settle(preset, seed, runs=runs, duration=seconds)
    kind = "nothing" if seed % 3 == 0 else KINDS[int(rng.integers(len(KINDS)))]
    arm = ArmModel.load(world.robot)
    joint = int(rng.integers(arm.n))
    earlier = SimulationOptions(seed=int(rng.integers(2**31)), arm_seed=seed).in_world(world)
    later = replace(earlier, seed=int(rng.integers(2**31)))
    first, second, reverse = {}, {}, False
    if kind == "friction_change":
        factor = float(np.exp(rng.uniform(*np.log(SERVICE))))
        second = {"friction_factors": tuple(factor if j == joint else 1.0 for j in range(arm.n))}
    elif kind != "nothing":
        second = {"effects": (_request(kind, arm, joint, rng),)}
        reverse = kind == "payload" and rng.random() < 0.3
        if reverse:
            first, second = second, first
    same = bool(rng.random() < 0.5)
    before = simulate(replace(earlier, **first))
    after = simulate(replace(later, **second), motions=before.motions if same else None)
    truth = _truth(kind, arm.joint_names[joint], before, after, reverse)
    started = time.process_time()
    try:
        found = compare(before.session, after.session, arm)
    except InputError as error:  # a joint that hardly moves, say: refused with a reason, so nothing is reported
        spent = time.process_time() - started
        own = "" if kind in ("payload", "nothing") else arm.joint_names[joint]
        return Pair(kind, world.name, own, truth, same, f"refused ({error})", (), None, spent, ())
    spent = time.process_time() - started
    shown = tuple((one.effect, one.estimate.rivals, one.joints, one.elsewhere) for one in found.changes)
    own = "" if kind in ("payload", "nothing") else arm.joint_names[joint]
    interval = None
    for one in found.changes:
        if one.effect == kind and (not own or own in one.joints) and FIGURES[kind] in one.estimate.parameters:
            figure = one.estimate.parameters[FIGURES[kind]]
            interval = (figure.value, figure.low, figure.high)
    doubted = tuple(one.effect for one in found.reservations)
    return Pair(kind, world.name, own, truth, same, found.verdict, shown, interval, spent, doubted)


def _request(kind: str, arm: ArmModel, joint: int, rng: np.random.Generator) -> EffectRequest:
    cause = find_cause(kind)
    scene = Circumstances(draw_hardware(arm, np.random.default_rng(0)), joint, (), rng)
    size = cause.typical(scene) * float(np.exp(rng.uniform(*np.log(FACTORS))))
    if kind in ("torque_gain_error", "torque_offset") and rng.random() < 0.5:
        size = -size
    return EffectRequest(kind, arm.joint_names[joint], size)


def _truth(kind: str, joint: str, before: Simulation, after: Simulation, reverse: bool) -> float:
    if kind == "nothing":
        return 0.0
    if kind == "friction_change":
        old, new = (one.answer.losses[joint]["coulomb_Nm"] for one in (before, after))
        return new - old
    changed = before if reverse else after
    parameters = changed.answer.effects[0].parameters
    size = float(parameters[FIGURES[kind]])
    if kind == "torque_offset":  # it drifts from what it was at the session's first tick: told is its mean
        times = np.concatenate([run.time for run in changed.session.runs])
        size += float(parameters["drift_Nm_s"]) * float(times.mean())
    return -size if reverse else size


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("pairs", type=int)
    parser.add_argument("--seed", type=int, default=None)
    parser.add_argument("--runs", type=int, default=6)
    parser.add_argument("--seconds", type=float, default=6.0)
    parser.add_argument("--out", default=None)
    parser.add_argument("--budget", type=float, default=np.inf, help="Begin no pair after so much processor time [s].")
    options = parser.parse_args()
    seed = secrets.randbelow(2**31) if options.seed is None else options.seed
    print(f"seed {seed}", flush=True)
    pairs = []
    for k in range(options.pairs):
        if time.process_time() > options.budget:
            break
        pair = draw_pair(seed + k, options.runs, options.seconds)
        pairs.append(pair)
        mark = "ok" if pair.named or (pair.kind == "nothing" and not pair.shown) else "--"
        said = "; ".join(
            f"{effect} {','.join(joints)} or {','.join((*near[1:], *(place for _, place in elsewhere))) or 'nothing'}"
            for effect, near, joints, elsewhere in pair.shown
        )
        print(
            f"{mark} {seed + k} {pair.world} {pair.kind} {pair.joint} {pair.size:.3g} -> {pair.verdict}: {said} "
            f"{pair.interval} {pair.doubted} {pair.seconds:.1f} s",
            flush=True,
        )
        if options.out:
            with open(options.out, "a", encoding="utf-8") as stream:
                print(json.dumps({"seed": seed + k, **vars(pair)}), file=stream)
    print(json.dumps(summary(pairs), indent=1))


def summary(pairs: list[Pair]) -> dict[str, Any]:
    """Counts by kind."""
    found: dict[str, Any] = {}
    for kind in ("nothing", *KINDS):
        own = [pair for pair in pairs if pair.kind == kind]
        if kind == "nothing":
            found[kind] = {"pairs": len(own), "alarms": sum(bool(pair.shown) for pair in own)}
            continue
        shown = [pair for pair in own if pair.interval is not None]
        found[kind] = {
            "pairs": len(own),
            "named": sum(pair.named for pair in own),
            "strict": sum(pair.strict for pair in own),
            "alone": sum(pair.alone for pair in own),
            "seen": sum(pair.seen for pair in own),
            "sized": f"{sum(pair.sized for pair in shown)} of {len(shown)}",
            "silent": sum(not pair.shown for pair in own),
        }
    found["verdicts"] = dict(Counter(pair.verdict.split(" ")[0] for pair in pairs))
    found["seconds"] = round(float(np.mean([pair.seconds for pair in pairs])), 1)
    return found


if __name__ == "__main__":
    main()
