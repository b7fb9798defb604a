"""How often the 95 % intervals of `ident fit` hold the truth, and how wide they are beside an ideal: simulated arms.

    python -m tests.bench.bench_fit_coverage [--arms 40] [--seed 1] [--simulator ours|other] [--longest 36]

The ideal knows what no fit can know: the spectrum of the noise of each joint, encoders' included, and how much friction
changes from run to run and drifts. It weighs every moving row by them, in the frequency domain, on the same states and
with the same prior of the inertias: no estimator of the same laws is surer. Widths are shares of its own, by figure.
Truth is the arm's own; friction that drifts is taken at the session's start, as the ideal takes it.
"""

from __future__ import annotations

import argparse
import tempfile
import xml.etree.ElementTree as ET
from collections import defaultdict
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pinocchio as pin

from ident.arrays import Array, Float
from ident.errors import InputError
from ident.model.identification import HowToIdentify, Identified, identify
from ident.model.inertia import PRIOR_SHARE, base_parameters, base_prior, parameter_scale
from ident.model.loss import NAMES
from ident.motion.motion import Motion
from ident.robot.arm import ArmModel
from ident.sessions import open_sessions
from ident.simulation.hardware import Hardware
from ident.simulation.simulate import SimulationOptions, simulate
from ident.simulation.world import find_worlds, noise_density
from tests.bench.other_simulator.sessions import lock_rest, make_session, moving_joints, strip

KEYS = ("motor_inertia_kgm2", "viscous_Nms_rad", "coulomb_Nm")
# A shorter run than this holds no whole motion [s]; a joint moves above this [rad/s]; share of a prior's variance that
# the recordings take away from a figure that counts as known.
LEAST_RUN_S, MOVING_RAD_S, INFORMED = 8.0, 0.01, 0.5


@dataclass(frozen=True)
class Known:
    """What the ideal knows of an arm: density of torque noise by frequency, changes of friction, the truth."""

    density: object  # frequencies [Hz] -> one-sided [(N m)²/Hz], shape (F, n)
    spread: float
    drift: float
    both: bool  # whether dry and viscous friction change together
    losses: Float[Array, "3 n"]
    inertias: Float[Array, " 10n"] | None


def ideal_std(motions: list[Motion], arm: ArmModel, known: Known) -> Float[Array, " m"]:
    """Standard deviations of base parameters, then (rotor, viscous, Coulomb) of each joint, by the noise as it is."""
    base, n, runs = base_parameters(arm), arm.n, len(motions)
    rank, kinds = base.rank, 1 if known.both else 2
    changes = [(r, j, k) for r in range(runs) for j in range(n) for k in range(kinds)]
    size = rank + 3 * n
    information = np.zeros((size + len(changes),) * 2)
    information[:rank, :rank] = base_prior(base, PRIOR_SHARE["consistent"] * parameter_scale(arm))
    for r, one in enumerate(motions):
        table = arm.regressor(one.q, one.dq, one.ddq, base.columns)
        rate = 1.0 / float(np.median(np.diff(one.time)))
        frequencies = np.abs(np.fft.fftfreq(len(one.time), 1.0 / rate))
        variance = 0.5 * rate * known.density(np.maximum(frequencies, 1e-3))  # type: ignore[operator]
        for j in range(n):
            dry, thin = np.sign(one.dq[:, j]), one.dq[:, j]
            own = [one.ddq[:, j], thin, dry]
            friction = [known.losses[1, j] * thin, known.losses[2, j] * dry]
            friction = [friction[0] + friction[1]] if known.both else friction
            x = np.column_stack([table[:, j], *own, *friction]) * (np.abs(thin) > MOVING_RAD_S)[:, None]
            wave = np.fft.fft(x, axis=0) / np.sqrt(len(x) * variance[:, j])[:, None]
            at = [*range(rank), *range(rank + 3 * j, rank + 3 * j + 3)]
            at += [size + changes.index((r, j, k)) for k in range(kinds)]
            information[np.ix_(at, at)] += (wave.conj().T @ wave).real
    walk = np.minimum.outer(*[np.cumsum([1.0 / runs] * runs)] * 2)
    for j in range(n):
        for k in range(kinds):
            at = [size + changes.index((r, j, k)) for r in range(runs)]
            change = known.spread**2 * np.eye(runs) + known.drift**2 * walk + 1e-12 * np.eye(runs)
            information[np.ix_(at, at)] += np.linalg.inv(change)
    return np.sqrt(np.diag(np.linalg.inv(information))[:size])


def ours(seed: int, longest: float) -> tuple[list[Motion], ArmModel, Known]:
    """An arm of this project's simulator, in a world of the list `quoted`."""
    ranges = find_worlds("quoted")
    world = ranges[seed % len(ranges)].draw(np.random.default_rng([seed, 6]))
    duration = min(world.duration_s, longest)
    world = replace(world, duration_s=duration, runs=min(world.runs, max(1, int(duration / LEAST_RUN_S))))
    done = simulate(SimulationOptions(robot=world.robot, seed=seed).in_world(world))
    opened = open_sessions([done.session], ArmModel.load(world.robot))
    losses = np.array([[done.answer.losses[joint][key] for joint in opened.arm.joint_names] for key in KEYS])
    known = Known(
        lambda f: noise_density(done.hardware, world, np.minimum(f, 0.499 * world.rate_hz)),
        world.friction_spread,
        world.friction_drift,
        False,
        losses,
        true_inertias(done.hardware),
    )
    return list(opened.motions), opened.arm, known


def true_inertias(hardware: Hardware) -> Float[Array, " 10n"]:
    """The ten numbers of each link of an arm without added bodies."""
    bodies, numbers = hardware.bodies, []
    for j, own in enumerate(list(hardware.arm.model.inertias)[1:]):
        mass = bodies.mass_scale[j]
        moments = mass * bodies.inertia_scale[j] * own.inertia
        numbers.append(pin.Inertia(mass * own.mass, own.lever + bodies.com_shift[j], moments).toDynamicParameters())
    return np.concatenate(numbers)


def other(seed: int, longest: float) -> tuple[list[Motion], ArmModel, Known]:
    """A healthy arm of the simulator that shares no code with this project; its inertias are not told."""
    from ident.robot.names import find_urdf

    text = strip(Path(find_urdf(("tm5-900", "ur5", "panda")[seed % 3])))
    names = [str(joint.get("name")) for joint in moving_joints(text)]
    text = lock_rest(text, names)
    with tempfile.TemporaryDirectory() as place:
        answer = make_session(text, names, "healthy", seed, Path(place) / "session")
        (Path(place) / "robot.urdf").write_text(text, encoding="utf-8")
        opened = open_sessions([Path(place) / "session"], ArmModel.load(Path(place) / "robot.urdf"))
        motions = list(opened.motions)
    world, noise = answer["world"], np.array(answer["torque_noise_Nm"])
    losses = np.array([answer["true_loss"][key] for key in KEYS])
    limits = {str(j.get("name")): float(j.find("limit").get("effort")) for j in ET.fromstring(text).findall("joint")
              if j.find("limit") is not None}  # fmt: skip
    rated = np.array([limits[name] for name in names])
    grown = np.mean(np.concatenate([1.0 + 0.3 * np.abs(one.tau) / rated for one in motions]) ** 2, axis=0)
    pole, rate = np.exp(-2.0 * np.pi * world["coloured"] / world["rate"]), world["rate"]
    inertia = pin.crba(opened.arm.model, opened.arm.model.createData(), motions[0].q[0])
    moved = (np.diag(inertia) + losses[0]) * np.hypot(world["encoder_noise"], 2 * np.pi / 2 ** world["bits"] / 12**0.5)

    def density(f: Array) -> Array:
        red = (1.0 - pole**2) / np.abs(1.0 - pole * np.exp(-2j * np.pi * f / rate)) ** 2
        torque = (0.85**2 + 0.25 * red)[:, None] * noise**2 * grown
        return 2.0 / rate * (torque + moved**2 * (2.0 * np.pi * f[:, None]) ** 4)

    return motions, opened.arm, Known(density, world["between_runs"], 0.0, True, losses, None)


def rows_of(found: Identified, ideal: Array, known: Known, arm: ArmModel) -> dict[str, list[tuple[bool, float]]]:
    """By kind of figure: whether the interval holds the truth, and its standard error against the ideal's."""
    rows: dict[str, list[tuple[bool, float]]] = defaultdict(list)
    rank, limits = found.inertia.base.rank, found.loss.conf_int()
    for j, k in np.ndindex(arm.n, 3):
        low, high = limits[j, k]
        if found.loss.joints[j] in found.lossless or NAMES[k] in found.loss.at_bound[j]:
            continue
        share = 0.5 * (high - low) / (1.96 * ideal[rank + 3 * j + k])
        rows[NAMES[k]].append((bool(low <= known.losses[k, j] <= high), float(share)))
    if known.inertias is not None:
        truth = found.inertia.base.mapping @ known.inertias
        for k, figure in enumerate(found.inertias):
            kind = "base parameter" if figure.informed >= INFORMED else "base, by URDF"
            share = 0.5 * (figure.high - figure.low) / (1.96 * ideal[k])
            rows[kind].append((bool(figure.low <= truth[k] <= figure.high), float(share)))
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--arms", type=int, default=40)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--simulator", choices=("ours", "other"), default="ours")
    parser.add_argument("--longest", type=float, default=36.0, help="longest session of our simulator [s]")
    asked = parser.parse_args()
    draw = {"ours": ours, "other": other}[asked.simulator]
    total: dict[str, list[tuple[bool, float]]] = defaultdict(list)
    for seed in range(1000 * asked.seed, 1000 * asked.seed + asked.arms):
        try:
            motions, arm, known = draw(seed, asked.longest)
            found = identify(motions, arm, HowToIdentify("consistent"))
        except InputError as error:
            print(f"{seed}: refused: {error}", flush=True)
            continue
        rows = rows_of(found, ideal_std(motions, arm, known), known, arm)
        for kind, own in rows.items():
            total[kind] += own
        told = {kind: (sum(held for held, _ in own), len(own), round(float(np.median([w for _, w in own])), 2))
                for kind, own in rows.items()}  # fmt: skip
        print(seed, arm.name, len(motions), told, flush=True)
    print(f"{'figure':<16}{'figures':>8}{'inside %':>10}{'width / ideal: median':>23}{'quarter':>9}{'three':>7}")
    for kind, own in total.items():
        held, width = np.array([one[0] for one in own]), np.array([one[1] for one in own])
        low, middle, high = np.percentile(width, [25, 50, 75])
        print(f"{kind:<16}{len(own):>8}{100 * held.mean():>10.1f}{middle:>23.2f}{low:>9.2f}{high:>7.2f}")


if __name__ == "__main__":
    main()
