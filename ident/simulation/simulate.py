"""`simulate`: a session of the simulated arm with chosen effects, and its folder with the answer,
open or sealed.
"""

from __future__ import annotations

import secrets
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ident.command_options import Options, option
from ident.errors import InputError, plural
from ident.files import atomic_folder, write_record
from ident.outputs import SESSION_KIND, require_own_folder
from ident.recordings.recording import Payload, Session
from ident.recordings.save import fill_session
from ident.records import as_record
from ident.results import Result
from ident.robot.arm import ArmModel
from ident.simulation.causes import CATALOGUE, Circumstances
from ident.simulation.hardware import AddedBody, Hardware, add_decoy, draw_hardware
from ident.simulation.laws import scale_friction
from ident.simulation.record import Channels, Progress, draw_pauses, no_progress, record_runs
from ident.simulation.request import (
    Answer,
    EffectRequest,
    TrueEffect,
    find_joint,
    parse_effect,
    seal,
)
from ident.simulation.visibility import VisibilityMeter
from ident.simulation.world import (
    World,
    channels_of,
    draw_world_arm,
    friction_path,
    noise_floor,
    usable_band,
)
from ident.trajectories.kinds import plan_motions
from ident.trajectories.reference import ReferenceMotion
from ident.trajectories.stepped import stepped

RICH = ("spline", "ladder", "sweep", "fourier", "chirp", "hold", "jointwise")
"""Motions that let every effect be seen."""
POOR = ("spline",)
"""Motions of everyday use only."""
ORIGIN = {"origin": "simulated by ident.simulation; not measured on hardware"}


@dataclass(frozen=True)
class SimulationOptions(Options):
    """A session to be simulated."""

    robot: str = "tm5-900"  # URDF path or name
    effects: tuple[str | EffectRequest, ...] = ()  # what is wrong, each ID:JOINT:SIZE
    seed: int = option(0, "", min=0, max=2**63 - 1)  # of everything: arm, motions, noise
    # of the individual arm, if it is to be the same in several sessions; else as `seed`
    arm_seed: int | None = None
    motions: tuple[str, ...] = RICH  # kinds of motion, in turn
    runs: int = 10  # number of runs
    duration: float = 8.0  # rough duration of a run [s]
    rate: float = option(250.0, "", "--rate", min=10.0, max=1000.0)  # log rate [Hz]
    velocity: bool = True  # whether these channels are logged
    commands: bool = True
    temperature: bool = False
    payload: Payload | None = None  # a known body at the flange
    decoys: tuple[str, ...] = ()  # names of decoys
    pause: tuple[float, float] = (4.0, 12.0)  # bounds of the standstill between runs [s]
    # deviation of the relative error of the URDF's inertias
    inertia_error: float = option(0.03, "", min=0.0, max=0.15)
    # relative change of the friction from run to run
    friction_spread: float = option(0.01, "", min=0.0, max=0.2)
    noise: float = option(1.0, "", min=0.0, max=100.0)  # factor on the noise of torque and encoders
    # whether the visible amplitude of every effect is measured for the answer
    measure: bool = False
    # whether it is measured on the whole session in longer steps, not on half of it in short ones
    coarse: bool = False
    # what the arm, its sensors and its log are like (`in_world`); the plant's own if None
    world: World | None = None
    # on the friction of each joint, as after a service; none if empty
    friction_factors: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        super().__post_init__()
        if not (self.payload is None or 0.0 <= self.payload.mass_kg <= 1000.0):
            raise InputError(
                "--payload", f"{self.payload.mass_kg:g} kg", "choose between 0 and 1000 kg"
            )
        if not all(1e-3 <= factor <= 10.0 for factor in self.friction_factors):
            raise InputError(
                "friction_factors", f"{self.friction_factors}", "choose between 0.001 and 10"
            )
        if not 0.0 <= self.pause[0] <= self.pause[1]:
            raise InputError(
                "pause",
                f"{self.pause[0]:g} to {self.pause[1]:g} s",
                "give bounds in order, from 0 s",
            )

    def in_world(self, world: World) -> SimulationOptions:
        """These options in a world: what both speak of is the world's."""
        return replace(
            self,
            world=world,
            robot=world.robot,
            runs=world.runs,
            duration=world.run_duration_s,
            rate=world.rate_hz,
            velocity=world.velocity != "none",
            inertia_error=0.0,
            friction_spread=0.0,
        )


@dataclass(frozen=True, eq=False)
class Simulation:
    """What a simulation gives."""

    session: Session  # as it would be recorded
    answer: Answer  # what was wrong
    hardware: Hardware  # the hidden arm
    motions: tuple[ReferenceMotion, ...]  # what it was asked to do
    options: SimulationOptions  # what was wanted
    meter: VisibilityMeter  # what measures how much causes show, on the arm without any
    seeds: tuple[int, ...]  # of the other parameters of each effect


Motions = Sequence[ReferenceMotion]


def simulate(
    options: SimulationOptions,
    name: str = "session",
    progress: Progress = no_progress,
    motions: Motions | None = None,
) -> Simulation:
    """Simulates a session: of planned motions, or of those that are given; `progress` is called
    after each run.

    Raises:
        InputError: Unknown effect, joint, motion or decoy, or a size outside physics.
    """
    arm = ArmModel.load(options.robot)
    world = options.world
    requests = [
        parse_effect(effect) if isinstance(effect, str) else effect for effect in options.effects
    ]
    joints = [find_joint(request, arm) for request in requests]
    plan_rng, effect_rng, run_rng, decoy_rng = np.random.default_rng(options.seed).spawn(4)
    if motions is None:
        motions = plan_motions(arm, options.motions, options.runs, options.duration, plan_rng)
        motions = [stepped(motion, world.reference) for motion in motions] if world else motions
    plans = tuple(motions)
    healthy = _healthy(arm, options, decoy_rng)
    clock_rng, record_rng = run_rng.spawn(2)
    pauses = draw_pauses(len(plans), options.pause, clock_rng)
    channels = Channels(options.rate, options.velocity, options.commands, options.temperature)
    floors = healthy.sensing.noise_floor
    band = None
    if world is not None:
        path = friction_path(
            world, healthy.n, plans, pauses, np.random.default_rng([options.seed, 2])
        )
        healthy = healthy.replace(friction_path=path)
        channels = channels_of(world, options.commands, options.temperature)
        floors = noise_floor(healthy, world, plans)
        band = usable_band(healthy, world)
    meter = VisibilityMeter(healthy, plans, pauses, options.seed, options.coarse, floors, band)
    hardware = healthy
    effects = []
    seeds = tuple(int(effect_rng.integers(2**63)) for _ in requests)
    for request, joint, seed in zip(requests, joints, seeds, strict=True):
        hardware, effect = _add_effect(request, joint, hardware, meter, seed, options.measure)
        effects.append(effect)
    runs, _ = record_runs(hardware, plans, channels, record_rng, pauses, progress, meter.feeds)
    session = Session(
        name, tuple(runs), payload=options.payload, robot=options.robot, metadata=dict(ORIGIN)
    )
    floor = dict(zip(arm.joint_names, map(float, floors), strict=True))
    answer = Answer(options.robot, options.seed, tuple(effects), tuple(options.decoys), floor)
    if world:
        keys = ("motor_inertia_kgm2", "viscous_Nms_rad", "coulomb_Nm")
        law = healthy.friction
        rows = zip(
            arm.joint_names, healthy.drive.rotor_inertia, law.viscous, law.coulomb, strict=True
        )
        losses = {
            joint: dict(zip(keys, map(float, values), strict=True)) for joint, *values in rows
        }
        answer = replace(answer, world=world.to_dict(), losses=losses)
    return Simulation(session, answer, hardware, plans, options, meter, seeds)


def _healthy(arm: ArmModel, options: SimulationOptions, decoy_rng: np.random.Generator) -> Hardware:
    """The individual arm, with its known payload and decoys, before anything is wrong."""
    seed = options.seed if options.arm_seed is None else options.arm_seed
    rng = np.random.default_rng([seed, 1])
    world = options.world
    hardware = (
        draw_world_arm(arm, world, rng) if world else draw_hardware(arm, rng, options.inertia_error)
    )
    for decoy in options.decoys:
        hardware = add_decoy(hardware, decoy, decoy_rng)
    if options.payload is not None:
        body = AddedBody(arm.links[-1], options.payload.mass_kg, options.payload.com_m)
        hardware = hardware.replace(
            bodies=hardware.bodies.replace(added=(*hardware.bodies.added, body))
        )
    if options.friction_factors:
        factors = np.array(options.friction_factors)
        hardware = hardware.replace(friction=scale_friction(hardware.friction, factors, factors))
    sensing = hardware.sensing
    sensing = sensing.replace(
        white=options.noise * sensing.white,
        coloured=options.noise * sensing.coloured,
        count_noise=options.noise * sensing.count_noise,
    )
    return hardware.replace(
        sensing=sensing, friction_spread=0.0 if world else options.friction_spread
    )


def _add_effect(
    request: EffectRequest,
    joint: int,
    hardware: Hardware,
    meter: VisibilityMeter,
    seed: int,
    measure: bool,
) -> tuple[Hardware, TrueEffect]:
    """The hardware with one more effect, and the truth about it."""
    cause = request.cause
    names = hardware.arm.joint_names
    alone = Circumstances(meter.hardware, joint, meter.motions, np.random.default_rng(seed))
    if request.amplitude is not None:
        size = meter.find_size(cause, alone, request.amplitude, seed)
    else:
        size = cause.typical(alone) if request.size is None else request.size
    size = cause.checked(alone, float(size))
    visible = (
        meter.measure(cause, alone, size, seed) if measure or request.amplitude is not None else ()
    )
    changed, parameters = cause.apply(replace(alone, hardware=hardware), size)
    return changed, TrueEffect(
        effect=cause.id,
        in_catalogue=cause.id in CATALOGUE,
        joints=() if cause.whole_arm else (names[joint],),
        size=size,
        parameter=cause.parameter,
        parameters=parameters,
        visible_Nm=dict(zip(names, map(float, visible), strict=False)),
    )


@dataclass(frozen=True, eq=False)
class WrittenSession(Result):
    """What was written."""

    folder: Path
    runs: int
    samples: int
    duration_s: float
    robot: str
    joints: tuple[str, ...]
    sha256: str = ""  # of the envelope; empty without one
    key: str = ""  # hexadecimal key that opens the envelope; kept nowhere else

    def to_dict(self) -> dict[str, Any]:
        session = {
            name: as_record(value) for name, value in vars(self).items() if name != "provenance"
        }
        arm = {"schema": "ident.simulation/1", "robot": self.robot, "joints": list(self.joints)}
        return {**arm, "sessions": [session], "provenance": self.provenance.to_dict()}

    def summary(self) -> str:
        """How much was written, and how it is sealed."""
        lines = [
            (
                f"{self.folder}: {plural(self.runs, 'run')}, {self.samples} samples, "
                f"{self.duration_s:.0f} s"
            )
        ]
        if self.sha256:
            lines.append(
                f"sealed: sha256 {self.sha256}" + (f", key {self.key}" if self.key else "")
            )
        return "\n".join(lines)


def write_simulation(
    simulation: Simulation, folder: str | Path, answer: bool = False, sealed: bool = False
) -> WrittenSession:
    """Writes the session's folder, whole or not at all; the answer in plain text beside the runs,
    or sealed with a key.

    The key is drawn from the system's source of secrets.

    Raises:
        InputError: Both an open and a sealed answer were asked for, or the folder holds something
            else.
    """
    if answer and sealed:
        raise InputError(
            "--sealed", "an answer in plain text beside a sealed one", "choose --answer or --sealed"
        )
    session = simulation.session
    digest = ""
    secret = secrets.token_bytes(16)
    with atomic_folder(Path(folder), SESSION_KIND) as temporary:
        fill_session(session, temporary)
        if answer:
            write_record(temporary / "answer.json", simulation.answer.to_dict())
        if sealed:
            digest = seal(simulation.answer, temporary, secret)
    size = (len(session.runs), session.samples, session.duration)
    names = (session.robot or "", session.joints)
    return WrittenSession(Path(folder), *size, *names, digest, secret.hex() if sealed else "")


def simulate_to(
    folder: str | Path,
    options: SimulationOptions,
    answer: bool = False,
    sealed: bool = False,
    progress: Progress = no_progress,
    motions: Sequence[ReferenceMotion] | None = None,
) -> WrittenSession:
    """Simulates a session and writes it: what `ident simulate` does; arguments as of the two that
    it calls.

    Raises:
        InputError: As `simulate` and `write_simulation`.
    """
    require_own_folder(Path(folder), SESSION_KIND)
    simulation = simulate(options, name=Path(folder).name, progress=progress, motions=motions)
    return write_simulation(simulation, folder, answer, sealed)
