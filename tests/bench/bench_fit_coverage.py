"""How often the 95 % intervals of `ident fit` hold the truth, and how wide they are beside an ideal: simulated arms.

    python -m tests.bench.bench_fit_coverage [--arms 40] [--seed 1] [--simulator ours|other]

The ideal knows what no fit can know: the spectrum of the noise of each joint, encoders' included, and how much friction
changes from run to run and drifts. It weighs rows by them, in the frequency domain, on the same states and with the
same prior of the inertias. Widths are shares of its own: where it takes the rows that the fit takes, and where it takes
every moving row, through reversals too, as if friction were known there. Truth: at the session's start.
"""

from __future__ import annotations

import argparse
import tempfile
import xml.etree.ElementTree as ET
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from ident.arrays import Array, Float
from ident.errors import InputError
from ident.model.block_sums import clear_of_stops
from ident.model.identification import HowToIdentify, Identified, identify
from ident.model.inertia import PRIOR_SHARE, base_parameters, base_prior, parameter_scale
from ident.model.loss import NAMES
from ident.motion.motion import Motion
from ident.robot.arm import ArmModel
from ident.robot.names import find_urdf
from ident.sessions import open_sessions
from ident.simulation.simulate import SimulationOptions, simulate
from ident.simulation.world import find_worlds, noise_density
from tests.bench.other_simulator.sessions import lock_rest, make_session, moving_joints, strip

KEYS = ("motor_inertia_kgm2", "viscous_Nms_rad", "coulomb_Nm")
# Longest session of our simulator, shortest run with a whole motion [s]; a joint moves above this [rad/s]; share of a
# prior's variance that the recordings take away from a parameter that counts as known.
LONGEST_S, LEAST_RUN_S, MOVING_RAD_S, INFORMED = 36.0, 8.0, 0.01, 0.5
Rows = dict[str, list[tuple[bool, float, float]]]


@dataclass(frozen=True)
class Known:
    """What the ideal knows: density of the noise [(N m)²/Hz] at some frequencies [Hz] and its growth in a run, how
    friction changes from run to run and walks, as shares, and whether its parts do so together; and the truth."""

    density: Callable[[Array], Array]
    spread: float
    drift: float
    both: bool
    losses: Float[Array, "3 n"]
    inertias: Float[Array, " 10n"] | None
    grown: Callable[[Motion], Array]


def ideal_std(motions: list[Motion], arm: ArmModel, known: Known, clear: bool) -> Float[Array, " m"]:
    """Standard deviations of base parameters, then (rotor, viscous, Coulomb) of each joint, by the noise as it is."""
    base, n, runs = base_parameters(arm), arm.n, len(motions)
    rank, kinds = base.rank, 1 if known.both else 2
    size = rank + 3 * n
    information = np.zeros((size + runs * n * kinds,) * 2)
    information[:rank, :rank] = base_prior(base, PRIOR_SHARE["consistent"] * parameter_scale(arm))
    for r, one in enumerate(motions):
        table = arm.regressor(one.q, one.dq, one.ddq, base.columns)
        frequencies = np.abs(np.fft.fftfreq(len(one.time), one.interval))
        variance = 0.5 / one.interval * known.density(np.maximum(frequencies, 1e-3))
        counts = np.abs(one.dq) > MOVING_RAD_S
        if clear:
            own = np.repeat(clear_of_stops(one), one.lowpass.factor, axis=0)[: len(one.time)]
            counts = np.where(own.any(axis=0), own, counts)  # as a fit does of joints that are never clear
        for j in range(n):
            dry, thin = np.sign(one.dq[:, j]), one.dq[:, j]
            friction = [known.losses[1, j] * thin, known.losses[2, j] * dry]
            friction = [friction[0] + friction[1]] if known.both else friction
            x = np.column_stack([table[:, j], one.ddq[:, j], thin, dry, *friction])
            wave = np.fft.fft(x * (counts / known.grown(one))[:, j, None], axis=0)
            wave /= np.sqrt(len(x) * variance[:, j])[:, None]
            at = [*range(rank), *range(rank + 3 * j, rank + 3 * j + 3)]
            at += [size + (r * n + j) * kinds + k for k in range(kinds)]
            information[np.ix_(at, at)] += (wave.conj().T @ wave).real
    walk = np.minimum.outer(*[np.arange(1, runs + 1) / runs] * 2)
    change = (known.spread**2 + 1e-12) * np.eye(runs) + known.drift**2 * walk
    for first in range(n * kinds):
        at = size + np.arange(runs) * n * kinds + first
        information[np.ix_(at, at)] += np.linalg.inv(change)
    return np.sqrt(np.diag(np.linalg.inv(information))[:size])


def ours(seed: int) -> tuple[list[Motion], ArmModel, Known]:
    """An arm of this project's simulator, in a world of the list `quoted`."""
    ranges = find_worlds("quoted")
    world = ranges[seed % len(ranges)].draw(np.random.default_rng([seed, 6]))
    duration = min(world.duration_s, LONGEST_S)
    world = replace(world, duration_s=duration, runs=min(world.runs, max(1, int(duration / LEAST_RUN_S))))
    done = simulate(SimulationOptions(robot=world.robot, seed=seed).in_world(world))
    opened, sensing = open_sessions([done.session], ArmModel.load(world.robot)), done.hardware.sensing

    def grown(one: Motion) -> Array:
        load = np.repeat(one.tau_filtered, one.lowpass.factor, axis=0)[: len(one.tau)]
        return 1.0 + sensing.load_growth * np.abs(load) / sensing.rated

    bodies, inertias = done.hardware.bodies, []
    for j, own in enumerate(list(done.hardware.arm.model.inertias)[1:]):  # of an arm without added bodies
        mass = bodies.mass_scale[j]
        moments = mass * bodies.inertia_scale[j] * own.inertia
        inertias.append(pin.Inertia(mass * own.mass, own.lever + bodies.com_shift[j], moments).toDynamicParameters())
    known = Known(
        lambda f: noise_density(done.hardware, world, np.minimum(f, 0.499 * world.rate_hz)),
        world.friction_spread,
        world.friction_drift,
        False,
        np.array([[done.answer.losses[joint][key] for joint in opened.arm.joint_names] for key in KEYS]),
        np.concatenate(inertias),
        grown,
    )
    return list(opened.motions), opened.arm, known


def other(seed: int) -> tuple[list[Motion], ArmModel, Known]:
    """A healthy arm of the simulator that shares no code with this project."""
    text = strip(Path(find_urdf(("tm5-900", "ur5", "panda")[seed % 3])))
    names = [str(joint.get("name")) for joint in moving_joints(text)]
    text = lock_rest(text, names)
    with tempfile.TemporaryDirectory() as place:
        answer: dict[str, Any] = make_session(text, names, "healthy", seed, Path(place) / "session")
        (Path(place) / "robot.urdf").write_text(text, encoding="utf-8")
        opened = open_sessions([Path(place) / "session"], ArmModel.load(Path(place) / "robot.urdf"))
        motions = list(opened.motions)
    world, noise = answer["world"], np.array(answer["torque_noise_Nm"])
    losses = np.array([answer["true_loss"][key] for key in KEYS])
    joints = {str(one.get("name")): one.find("limit") for one in ET.fromstring(text).findall("joint")}
    rated = np.array([float(joints[name].get("effort")) for name in names])  # type: ignore[union-attr, arg-type]
    pole, rate = np.exp(-2.0 * np.pi * world["coloured"] / world["rate"]), world["rate"]
    inertia = pin.crba(opened.arm.model, opened.arm.model.createData(), motions[0].q[0])
    moved = (np.diag(inertia) + losses[0]) * np.hypot(world["encoder_noise"], 2 * np.pi / 2 ** world["bits"] / 12**0.5)

    def density(f: Array) -> Array:
        red = (1.0 - pole**2) / np.abs(1.0 - pole * np.exp(-2j * np.pi * f / rate)) ** 2
        torque = (0.85**2 + 0.25 * red)[:, None] * noise**2
        return np.asarray(2.0 / rate * (torque + moved**2 * (2.0 * np.pi * f[:, None]) ** 4))

    def grown(one: Motion) -> Array:
        return np.asarray(1.0 + 0.3 * np.abs(one.tau) / rated)

    return motions, opened.arm, Known(density, world["between_runs"], 0.0, True, losses, None, grown)


def rows_of(found: Identified, ideals: tuple[Array, Array], known: Known, arm: ArmModel) -> Rows:
    """By kind of parameter: whether the interval holds the truth, and its standard error against each ideal's."""
    rows: Rows = defaultdict(list)
    rank, limits = found.inertia.base.rank, found.loss.conf_int()

    def enter(kind: str, low: float, high: float, truth: float, k: int) -> None:
        one, two = (float(0.5 * (high - low) / (1.96 * ideal[k])) for ideal in ideals)
        rows[kind].append((bool(low <= truth <= high), one, two))

    for j, k in np.ndindex(arm.n, 3):
        if found.loss.joints[j] not in found.lossless and NAMES[k] not in found.loss.at_bound[j]:
            enter(NAMES[k], *limits[j, k], known.losses[k, j], rank + 3 * j + k)
    if known.inertias is not None:
        truth = found.inertia.base.mapping @ known.inertias
        for k, one in enumerate(found.inertias):
            enter("base" if one.informed >= INFORMED else "base, by URDF", one.low, one.high, truth[k], k)
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--arms", type=int, default=40)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--simulator", choices=("ours", "other"), default="ours")
    asked = parser.parse_args()
    total: Rows = defaultdict(list)
    for seed in range(1000 * asked.seed, 1000 * asked.seed + asked.arms):
        try:
            motions, arm, known = {"ours": ours, "other": other}[asked.simulator](seed)
            found = identify(motions, arm, HowToIdentify("consistent"))
        except InputError as error:
            print(f"{seed}: refused: {error}", flush=True)
            continue
        rows = rows_of(found, (ideal_std(motions, arm, known, True), ideal_std(motions, arm, known, False)), known, arm)
        print(seed, arm.name, len(motions), {kind: show(own) for kind, own in rows.items()}, flush=True)
        for kind, own in rows.items():
            total[kind] += own
    print("parameters: inside of all (%); width by the ideal of the same rows, and of every moving row: medians")
    for kind, own in total.items():
        print(f"{kind:<16}{show(own)}")


def show(rows: list[tuple[bool, float, float]]) -> str:
    held, *widths = np.array(rows).T
    return f"{int(held.sum())} of {len(held)} ({100 * held.mean():.0f}), " + ", ".join(
        f"{np.median(w):.2f}" for w in widths
    )


if __name__ == "__main__":
    main()
