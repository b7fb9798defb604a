"""The shipped recordings, made anew: the paper's sets of the TM5-900, and the sealed sessions.

    python logs/make.py OUT             # the same code gives the same files
    python logs/make.py --open sealed_1  # what was wrong in a sealed session: diagnose it first

Ten trajectories for training (T1, T2) run in both directions at three speeds, ten for evaluation (E1, E2), and the
evaluation trajectories again with three payloads. One and the same hidden arm in all of them.

Source: paper, section 4.1 (10,306 samples in T1 and T2; payloads of 516, 1029 and 1544 g).
"""

from __future__ import annotations

import argparse
import hashlib
import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ident.arrays import Array, Float
from ident.errors import InputError
from ident.recordings.recording import Payload, Session
from ident.recordings.save import write_session
from ident.robot.arm import ArmModel
from ident.simulation.causes import CATALOGUE
from ident.simulation.hardware import AddedBody, Hardware, draw_hardware
from ident.simulation.laws import plain_friction
from ident.simulation.record import Channels, draw_pauses, record_runs
from ident.simulation.request import EffectRequest, open_envelope
from ident.simulation.simulate import ORIGIN, Simulation, SimulationOptions, simulate, write_simulation
from ident.trajectories.kinds import MotionLimits, random_path
from ident.trajectories.reference import ReferenceMotion, via_spline

ARM_SEED = 900
RATE_HZ = 50.0
TRAINING_SAMPLES = 10306
SPEEDS = {"slow": 1.55, "medium": 1.0, "fast": 0.72}
# Standstill at the start and the end of each run [s].
HOLD_S = 0.2
# A joint's share of its span that a trajectory covers.
REACH = (0.2, 0.4)
# So sized that the paper's analytic model misses about 10 N m RMS and some tens of joules a run; elbow and wrist have
# smaller gears than shoulder.
COULOMB_NM = np.array([7.0, 7.0, 5.0, 2.0, 2.0, 1.7])
VISCOUS_NMS_RAD = np.array([6.0, 6.0, 4.0, 1.4, 1.4, 1.0])
ROTOR_KGM2 = np.array([1.0, 1.0, 0.5, 0.15, 0.15, 0.1])
PAYLOADS_KG = {"payload_516g": 0.516, "payload_1029g": 1.029, "payload_1544g": 1.544}
# The weights are discs of steel on the flange: the heavier, the thicker the stack.
PAYLOAD_DENSITY_KG_M = 25.0
SEALED, SEALED_SEED, SEALED_AMPLITUDE = 3, 7100, 3.0


def paper_arm(arm: ArmModel) -> Hardware:
    """The individual arm of the shipped recordings: more friction than Coulomb's and Newton's laws explain.

    Its joints have a Stribeck fall, friction that grows with the load, shear thinning, and a small difference
    between forward and backward; nothing else of the catalogue.
    """
    rng = np.random.default_rng(ARM_SEED)
    hardware = draw_hardware(arm, rng)
    own = np.exp(0.1 * rng.standard_normal((3, arm.n)))
    rotor = ROTOR_KGM2 * own[2]
    coulomb = COULOMB_NM * own[0]
    hardware = hardware.replace(friction=plain_friction(coulomb, VISCOUS_NMS_RAD * own[1], rotor))
    hardware = hardware.with_laws("drive", rotor_inertia=rotor)
    return hardware.with_laws(
        "friction",
        stribeck=np.array([0.30, 0.25, 0.25, 0.20, 0.20, 0.20]) * coulomb,
        stribeck_velocity=np.array([0.06, 0.08, 0.07, 0.05, 0.05, 0.06]),
        load=np.array([0.02, 0.06, 0.06, 0.03, 0.03, 0.02]),
        eyring=np.array([0.15, 0.12, 0.12, 0.10, 0.10, 0.10]) * coulomb,
        eyring_velocity=np.array([0.15, 0.15, 0.15, 0.2, 0.2, 0.2]),
        coulomb_skew=np.array([0.06, -0.05, 0.04, 0.05, -0.04, 0.05]) * coulomb,
    )


def training_counts(rng: np.random.Generator) -> Array:
    """Samples of each (trajectory, speed) of the ten training trajectories, so that all add up; shape (10, 3)."""
    base = rng.uniform(0.85, 1.15, (10, 1)) * np.array(list(SPEEDS.values()))
    counts = np.round(base * TRAINING_SAMPLES / (2.0 * base.sum())).astype(int)
    counts[-1, 0] += (TRAINING_SAMPLES - 2 * counts.sum()) // 2
    return counts


def path_within(limits: MotionLimits, duration: float, rng: np.random.Generator) -> Float[Array, "m n"]:
    """Via points of a path that the arm can follow within a duration [s]."""
    while True:
        points = random_path(limits, 2, rng, span=rng.uniform(*REACH), roam=0.7)
        motion = via_spline("", points, duration)
        if limits.excess(motion.q, motion.dq, motion.ddq) <= 1.0:
            return points


def training_motions(limits: MotionLimits, rng: np.random.Generator) -> list[list[ReferenceMotion]]:
    """Motions of T1 and T2: five trajectories each, forward and backward, slow, medium and fast."""
    sets: list[list[ReferenceMotion]] = [[], []]
    for number, counts in enumerate(training_counts(rng)):
        durations = (counts - 1) / RATE_HZ - 2.0 * HOLD_S
        points = path_within(limits, durations.min(), rng)
        for speed, duration in zip(SPEEDS, durations, strict=True):
            name = f"trajectory_{number % 5 + 1}"
            forward = via_spline(f"{name}_forward_{speed}", points, duration)
            back = forward.reversed(f"{name}_backward_{speed}")
            sets[number // 5] += [motion.held(HOLD_S, HOLD_S) for motion in (forward, back)]
    return sets


def evaluation_motions(limits: MotionLimits, rng: np.random.Generator) -> list[list[ReferenceMotion]]:
    """Motions of E1 and E2: five trajectories each, once, at speeds between those of the training."""
    sets: list[list[ReferenceMotion]] = [[], []]
    for number in range(10):
        duration = round(rng.uniform(2.0, 4.6) * RATE_HZ) / RATE_HZ
        motion = via_spline(f"trajectory_{number % 5 + 1}", path_within(limits, duration, rng), duration)
        sets[number // 5].append(motion.held(HOLD_S, HOLD_S))
    return sets


def weight(arm: ArmModel, mass: float) -> tuple[AddedBody, Payload]:
    """A stack of discs on the flange, as a body and as session.toml tells it."""
    com = (0.0, 0.0, round(0.5 * mass / PAYLOAD_DENSITY_KG_M, 4))
    return AddedBody(arm.links[-1], mass, com, radius=0.025), Payload(mass, com)


def paper_sessions() -> Iterator[Session]:
    """T1, T2, E1, E2 and the payload sets, one after the other."""
    arm = ArmModel.load("tm5-900")
    limits, hardware = MotionLimits(arm), paper_arm(arm)
    rng = np.random.default_rng(ARM_SEED + 1)
    training, evaluation = training_motions(limits, rng), evaluation_motions(limits, rng)
    plans = dict(zip(("T1", "T2", "E1", "E2"), training + evaluation, strict=True))
    plans.update(dict.fromkeys(PAYLOADS_KG, evaluation[0] + evaluation[1]))
    for name, motions in plans.items():
        body, payload = weight(arm, PAYLOADS_KG[name]) if name in PAYLOADS_KG else (None, None)
        loaded = hardware.replace(bodies=hardware.bodies.replace(added=(body,))) if body else hardware
        pauses = draw_pauses(len(motions), (4.0, 12.0), rng)
        runs, _ = record_runs(loaded, motions, Channels(rate=RATE_HZ), rng.spawn(1)[0], pauses)
        yield Session(name, tuple(runs), payload=payload, robot="tm5-900", metadata=dict(ORIGIN))


def draw_sealed(name: str, seed: int) -> Simulation:
    """A session with one effect and joint drawn by chance, three times as large as the noise."""
    rng = np.random.default_rng(seed)
    joints = ArmModel.load("tm5-900").joint_names
    while True:
        effect, joint = str(rng.choice(list(CATALOGUE))), str(rng.choice(joints))
        request = EffectRequest(effect, joint, amplitude=SEALED_AMPLITUDE)
        options = SimulationOptions(effects=(request,), seed=seed, runs=10, duration=6.0, rate=100.0, temperature=True)
        try:
            return simulate(options, name)
        except InputError:  # that effect can't be so large at that joint: draw again
            continue


def sealed_key(name: str) -> bytes:
    """Key of a shipped envelope: fixed, so that the same file comes out; nothing in the folder leads to it."""
    return hashlib.sha256(f"{name} of the shipped recordings".encode()).digest()


def write_logs(folder: Path) -> None:
    """Writes everything that lies in `logs/tm5_900`; the sealed sessions have one effect each, drawn by chance."""
    for session in paper_sessions():
        write_session(session, folder / session.name)
    for number in range(1, SEALED + 1):
        name = f"sealed_{number}"
        write_simulation(draw_sealed(name, SEALED_SEED + number), folder / name, sealed=True, key=sealed_key(name))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, nargs="?", default=Path("out/tm5_900"))
    parser.add_argument("--open", metavar="SESSION")
    given = parser.parse_args()
    if given.open:
        envelope = Path(__file__).parent / "tm5_900" / given.open
        print(json.dumps(open_envelope(envelope, sealed_key(given.open)).to_dict(), indent=1))
    else:
        write_logs(given.out)


if __name__ == "__main__":
    main()
