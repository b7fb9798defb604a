"""Who records: an arm, real or simulated, that is given motions and returns what its log says of
them.
"""

from __future__ import annotations

import os
import shlex
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

import numpy as np

from ident.errors import InputError, RecordingError
from ident.recordings.load import load_session
from ident.recordings.recording import Session
from ident.robot.arm import ArmModel
from ident.simulation.causes import ALIKE, CATALOGUE, EVENTS, find_cause
from ident.simulation.hardware import Hardware
from ident.simulation.record import Channels, draw_pauses, record_runs
from ident.simulation.request import EffectRequest
from ident.simulation.simulate import SimulationOptions, simulate
from ident.trajectories.files import write_commands
from ident.trajectories.reference import ReferenceMotion

# What a user's command must hold: the folder with the command files, and the folder for what was
# recorded.
COMMANDS = "{commands}"
SESSION = "{session}"
# A simulated arm with hidden effects in the loop: the arm rests and cools while the diagnosis
# thinks [s].
REST_S = 600.0


class Recorder(Protocol):
    """An arm that can be asked to move, simulated or real."""

    def record(self, motions: Sequence[ReferenceMotion]) -> Session:
        """Runs the motions in order and gives back one run for each."""
        ...


class CommandRecorder:
    """A real arm behind a user's command, which is run once a round, without a shell.

    Args:
        command: What to run; `{commands}` becomes the folder with one command file a run,
            `{session}` the folder in which the command must leave its recordings.
        folder: Where both lie, in a folder a round.
        arm: The arm that moves.

    Raises:
        InputError: A command that can't be split into words, or lacks a folder.
    """

    def __init__(self, command: str, folder: Path, arm: ArmModel) -> None:
        self.folder = folder
        self.arm = arm
        self.rounds = 0
        try:
            self.words = shlex.split(command)
        except ValueError as error:
            raise InputError(
                "--record", f"{command!r} can't be read ({error})", "quote it as for a shell"
            ) from None
        for place in (COMMANDS, SESSION):
            if not any(place in word for word in self.words):
                raise InputError(
                    "--record", f"{command!r} has no {place}", f"say where {place} goes"
                )

    def record(self, motions: Sequence[ReferenceMotion]) -> Session:
        """Writes the command files, runs the command, reads what it recorded.

        Raises:
            InputError: The command failed.
            RecordingError: It left nothing that can be read.
        """
        self.rounds += 1
        place = self.folder / f"round_{self.rounds}"
        commands = place / "commands"
        session = place / "session"
        write_commands(motions, self.arm.joint_names, commands)
        session.mkdir(parents=True, exist_ok=True)
        words = [
            word.replace(COMMANDS, str(commands)).replace(SESSION, str(session))
            for word in self.words
        ]
        try:
            done = subprocess.run(words, check=False, env={**os.environ, "PYTHONSAFEPATH": ""})
        except OSError as error:
            raise InputError(
                "--record", f"{words[0]!r} can't be run ({error.strerror})", "give a program"
            ) from None
        if done.returncode != 0:
            what = f"it ended with exit status {done.returncode} in round {self.rounds}"
            raise InputError("--record", what, "mend it, and start again")
        if not any(session.iterdir()):
            raise RecordingError(
                session, "the command left no recording there", "write one run a command file"
            )
        return load_session(session)


def draw_effects(
    joints: Sequence[str], count: int, rng: np.random.Generator
) -> tuple[EffectRequest, ...]:
    """Random effects of usual size at random joints, no two of which are one and the same
    torque.
    """
    names = sorted(set(CATALOGUE) - EVENTS)
    while True:
        ids = [str(effect) for effect in rng.choice(names, count, replace=False)]
        if all(len(twins & set(ids)) < 2 for twins in ALIKE):
            break
    return tuple(
        EffectRequest(effect, "" if find_cause(effect).whole_arm else str(rng.choice(joints)))
        for effect in ids
    )


class SimulatedArm:
    """One arm with hidden effects, which records again and again.

    Args:
        options: What it is; its runs and motions are those that it is given.
    """

    def __init__(self, options: SimulationOptions) -> None:
        self.options = options
        self.clock = 0.0
        self.rounds = 0
        self.hardware: Hardware | None = None
        self.effects: tuple[str, ...] = ()

    def record(self, motions: Sequence[ReferenceMotion]) -> Session:
        """One run for each motion, on a clock that goes on from round to round."""
        self.rounds += 1
        name = f"round_{self.rounds}"
        if self.hardware is None:
            made = simulate(self.options, motions=motions)
            session = made.session
            self.hardware = made.hardware
            truth = made.answer.effects
            self.effects = tuple(
                ":".join([effect.effect, *(effect.joints or ("arm",)), f"{effect.size:.4g}"])
                for effect in truth
            )
        else:
            rng = np.random.default_rng([self.options.seed, self.rounds])
            pauses = draw_pauses(len(motions), self.options.pause, rng)
            channels = Channels(self.options.rate, self.options.velocity, self.options.commands)
            recorded, _ = record_runs(self.hardware, motions, channels, rng, pauses)
            session = Session(name, tuple(recorded), robot=self.options.robot)
        runs = [
            run.replace(time=run.time + self.clock, name=f"{name}_{run.name}")
            for run in session.runs
        ]
        self.clock = float(runs[-1].time[-1]) + REST_S
        return session.replace(name=name, runs=tuple(runs))
