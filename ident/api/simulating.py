"""The simulated arm and planted effects: what the commands simulate, blind and close do, and `plant`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np

from ident.api.diagnosing import diagnose
from ident.benchmark.run import BlindOptions, Progress, Say, run_blind
from ident.benchmark.summary import BlindReport
from ident.closed_loop.loop import close_gap
from ident.closed_loop.recorder import CommandRecorder
from ident.closed_loop.result import Closing, close_simulated, keep
from ident.command_options import CloseOptions, SimulateOptions
from ident.diagnosis.result import Diagnosis
from ident.effects.base import Effect
from ident.effects.catalogue import CATALOGUE
from ident.errors import InputError
from ident.outputs import begin_folder
from ident.progress import stage, step
from ident.recordings.load import load_session
from ident.recordings.recording import Session
from ident.regression.baseline import fit_baseline
from ident.regression.decimation import prepare_slower
from ident.regression.runs import build_session
from ident.results import Provenance
from ident.robot.arm import ArmModel
from ident.sessions import Given, Robot, Sources, inspect_sources, load_robot
from ident.simulation.request import parse_effect, parse_payload
from ident.simulation.simulate import RICH, SimulationOptions, WrittenSession, simulate_to
from ident.simulation.simulate import simulate as run
from ident.simulation.world import find_world, settle
from ident.trajectories.files import read_commands, read_plan


def blind(
    cases: int = 40,
    *,
    out: str | Path = "out/blind",
    say: Say = lambda line: None,
    progress: Progress = lambda step, done, total: None,
    **options: Any,
) -> BlindReport:
    """Draws effects, simulates, seals, diagnoses from the recordings alone, opens, scores.

    Args:
        cases: Number of cases.
        out: Folder for everything; a check that was stopped there goes on.
        say: Called with the seals, line by line, before any diagnosis.
        progress: Called with what is being done, how many cases are done, and of how many.
        options: Further fields of `ident.benchmark.run.BlindOptions`: seed, workers, robot, runs, duration, …

    Raises:
        InputError: Options that make no sense, or another check in the folder.
    """
    return run_blind(BlindOptions.of("blind", {"cases": cases, "out": Path(out), **options}), say, progress)


CLOSE_KIND = "close"


def close(
    robot: Robot = "tm5-900",
    out: str | Path = "out/close",
    *,
    say: Callable[[str], None] = lambda line: None,
    **options: Any,
) -> Closing:
    """From a URDF and an arm to a model that leaves hardly more than noise on recordings that it never saw.

    Args:
        robot: URDF path, name or arm.
        out: Folder for `close.json` and, for each arm, its last diagnosis and patch.
        say: Called with each line that says what happens.
        options: Fields of `ident.command_options.CloseOptions`: `recorder` (a command, or an object with
            `record(motions)`; of simulated arms none), `arms`, `seed`, `rounds`, `effects`, `compared`.

    Raises:
        InputError: A robot, recordings or numbers that can't be used.
    """
    chosen = CloseOptions.of("close", options)
    folder = Path(out)
    begin_folder(folder, CLOSE_KIND)
    recorder, seed, rounds = chosen.recorder, chosen.seed, chosen.rounds
    if recorder is not None:
        arm = load_robot(robot, ())
        who = CommandRecorder(recorder, folder / "recorded", arm) if isinstance(recorder, str) else recorder
        loop = close_gap(arm, who, seed, rounds, say)
        found = [keep(loop, arm, folder / "arm_00")]
    else:
        if not isinstance(robot, str | Path):
            raise InputError("robot", "an arm in memory can't be simulated", "give its URDF's path, or its name")
        for one in chosen.effects or ():
            parse_effect(one)  # before anything is simulated
        found = [
            close_simulated(str(robot), seed + k, folder / f"arm_{k:02d}", rounds, chosen.effects, chosen.compared, say)
            for k in range(chosen.arms)
        ]
    settings = {"robot": str(getattr(robot, "name", robot)), "arms": chosen.arms, "seed": seed, "rounds": rounds}
    result = Closing(tuple(found)).with_provenance(Provenance("ident close", settings=settings))
    result.save(folder / "close.json")
    return result


@dataclass(frozen=True, eq=False)
class PlantedEffect:
    """An effect that was planted, and what became of it."""

    effect: str  # its id
    joint: str  # where; "" for an effect of the whole arm
    rms: float  # root mean square of its torque at the joint where it acts most [N m]
    session: Session  # the recordings with it
    diagnosis: Diagnosis  # what they were found to be

    @property
    def found(self) -> bool:
        """Whether a finding at its joint holds it in its class."""
        return any(
            self.effect in one.estimate.rivals and (not self.joint or self.joint in one.joints)
            for one in self.diagnosis.findings
        )

    def __repr__(self) -> str:
        names = ", ".join(f"{one.effect} at {', '.join(one.joints)}" for one in self.diagnosis.findings) or "nothing"
        where = f" at {self.joint}" if self.joint else ""
        found = "found" if self.found else "not found"
        return f"{self.effect}{where}, {self.rms:.2g} N m rms: {found} (named: {names})"


def plant(
    effect: Effect,
    joint: str | None = None,
    source: Sources | None = None,
    robot: Robot = "tm5-900",
    *,
    coefficients: Sequence[float] | None = None,
) -> PlantedEffect:
    """Adds an effect's torque to recordings of an arm without it, and diagnoses them.

        assert plant(Magnet(), "joint_2").found

    Args:
        effect: The effect; of its inner grid the first point is planted.
        joint: Where; None takes the second joint. Of no matter for an effect of the whole arm.
        source: Recordings of the arm without it; a simulated arm's if None.
        robot: URDF path, name or arm.
        coefficients: Of its columns; half of what `prior_scale` says is plausible if None.

    Raises:
        InputError: No such joint, recordings that can't show the effect, or no size to plant it with.
    """
    if not isinstance(effect, Effect):
        what = f"a {type(effect).__name__} is no effect"
        raise InputError("effect", what, "give an object of a class of ident.Effect")
    read = inspect_sources(Given([simulate(robot=str(robot), runs=10)] if source is None else source, robot))
    session, names = next(iter(read.reports)).session, read.arm.joint_names
    if joint is not None and joint not in names:
        raise InputError("joint", f"there is no {joint!r}", f"give one of: {', '.join(names)}")
    j = 0 if effect.scope == "arm" else names.index(joint) if joint else min(1, len(names) - 1)
    motions = list(prepare_slower(session))
    context = build_session(fit_baseline(motions, read.arm), motions, common_clock=session.common_clock)
    # The effect's torque in every run [N m].
    if reason := effect.untestable(context, j):
        raise InputError(effect.id, reason, "give recordings that can show it")
    variant = effect.variants(context, j)[0]
    scale = effect.prior_scale(context, j, variant) if coefficients is None else 2.0 * np.asarray(coefficients)
    if scale is None:
        raise InputError(effect.id, "its prior_scale says nothing of its size", "give coefficients")
    torques = []  # of all joints [N m]
    for columns in effect.columns(context, j, variant):
        own = columns @ (0.5 * scale)
        whole = own if own.ndim == 2 else np.zeros((len(own), context.n))
        if own.ndim == 1:
            whole[:, j] = own
        torques.append(whole)
    added = {motion.name: (motion.time, torque) for motion, torque in zip(motions, torques, strict=True)}
    runs = []
    for one in (one for one in session.runs if one.name in added):
        time, torque = added[one.name]
        more = np.stack([np.interp(one.time, time, column) for column in torque.T], axis=1)
        runs.append(one.replace(effort=one.effort + more))
    spoilt = session.replace(runs=runs)
    further = [] if effect.id in {known.id for known in CATALOGUE} else [effect]
    rms = float(np.sqrt(np.mean(np.concatenate(torques) ** 2, axis=0)).max())
    where = names[j] if effect.scope == "joint" else ""
    return PlantedEffect(effect.id, where, rms, spoilt, diagnose(spoilt, read.arm, catalogue=further))


def simulate(*effects: str, out: str | Path | None = None, **options: Any) -> Session:
    """A session of the simulated arm, its effects chosen.

    Args:
        effects: What is wrong, each ID:JOINT:SIZE; SIZE in SI units, or as a multiple of the noise (`3x`).
        out: Folder in which it is written too; in memory alone if None.
        options: Fields of `ident.simulation.simulate.SimulationOptions`: robot, seed, runs, duration, rate, payload, …

    Raises:
        InputError: An unknown effect, joint or option.
    """
    for effect in effects:
        if not isinstance(effect, str):
            raise InputError("simulate", f"a {type(effect).__name__} is no effect", "give ID:JOINT:SIZE as text")
    chosen = SimulationOptions.of("simulate", {**options, "effects": effects})
    if out is None:
        return run(chosen).session
    simulate_to(out, chosen)
    return load_session(out)


def simulate_into(out: Path, given: SimulateOptions) -> WrittenSession:
    """A session of the simulated arm in a folder, as the command asks for it.

    Raises:
        InputError: An unknown effect, joint, world, motion or decoy, or options that exclude each other.
    """
    if given.plan is not None and given.commands is not None:
        raise InputError("--plan", "given beside --commands", "give one of them")
    asked = {name: getattr(given, name) for name in ("robot", "runs", "duration", "rate", "velocity")}
    options = SimulationOptions(
        **{name: value for name, value in asked.items() if value is not None},
        effects=given.effect,
        seed=given.seed,
        motions=given.motion or RICH,
        temperature=given.temperature,
        payload=parse_payload(given.payload) if given.payload else None,
        decoys=given.decoy,
    )
    if given.world is not None:
        options = options.in_world(settle(find_world(given.world), given.seed, **asked))
    robot, runs = options.robot, options.runs
    motions = None if given.commands is None else read_commands(given.commands, ArmModel.load(robot))
    if given.plan is not None:
        motions = (read_plan(given.plan, ArmModel.load(robot)),) * runs
    finished, total = count(1), runs if motions is None else len(motions)
    stage("running the arm")
    written = simulate_to(out, options, given.answer, given.sealed, lambda: step(next(finished), total), motions)
    settings = {"effects": list(given.effect), "robot": robot, "world": given.world, "seed": given.seed}
    return written.with_provenance(Provenance("ident simulate", settings=settings))
