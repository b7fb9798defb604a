"""A simulation as a folder: runs, session.toml, and the answer, open or sealed."""

from __future__ import annotations

import secrets
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ident.errors import InputError
from ident.files import atomic_folder, write_record
from ident.outputs import SESSION_KIND, require_own_folder
from ident.recordings.save import fill_session
from ident.simulation.answer import seal
from ident.simulation.record import Progress, no_progress
from ident.simulation.simulate import Simulation, SimulationOptions, simulate
from ident.trajectories.reference import ReferenceMotion


@dataclass(frozen=True)
class WrittenSession:
    """What was written."""

    folder: Path
    runs: int
    samples: int
    duration_s: float
    robot: str
    joints: tuple[str, ...]
    sha256: str = ""  # of the envelope; empty without one
    key: str = ""  # hexadecimal key that opens the envelope; kept nowhere else


def write_simulation(
    simulation: Simulation,
    folder: str | Path,
    answer: bool = False,
    sealed: bool = False,
    key: bytes | None = None,
) -> WrittenSession:
    """Writes the session's folder, whole or not at all.

    Args:
        simulation: What to write.
        folder: Where; an earlier session there is replaced.
        answer: Whether the answer is written beside the runs in plain text.
        sealed: Whether it is written as a sealed envelope.
        key: Of the envelope; drawn from the system's source of secrets if None.

    Raises:
        InputError: Both an open and a sealed answer were asked for, or the folder holds something else.
    """
    _choose_one(answer, sealed)
    session, digest, secret = simulation.session, "", key or secrets.token_bytes(16)
    with atomic_folder(Path(folder), SESSION_KIND) as temporary:
        fill_session(session, temporary)
        if answer:
            write_record(temporary / "answer.json", simulation.answer.to_dict())
        if sealed:
            digest = seal(simulation.answer, temporary, secret)
    size = len(session.runs), session.samples, session.duration
    key_text = secret.hex() if sealed else ""
    return WrittenSession(Path(folder), *size, session.robot or "", session.joints, digest, key_text)


def simulate_to(
    folder: str | Path,
    options: SimulationOptions,
    answer: bool = False,
    sealed: bool = False,
    progress: Progress = no_progress,
    motions: Sequence[ReferenceMotion] | None = None,
) -> WrittenSession:
    """Simulates a session and writes it: what `ident simulate` does.

    Args:
        folder: Where the session is written.
        options: What is wanted; `options.runs` is the number of calls of `progress`.
        answer, sealed: Form of the answer; neither by default.
        progress: Called after each run.
        motions: Motions to be run instead of those that the options ask for.

    Raises:
        InputError: As `simulate` and `write_simulation`.
    """
    _choose_one(answer, sealed)
    require_own_folder(Path(folder), SESSION_KIND)
    simulation = simulate(options, name=Path(folder).name, progress=progress, motions=motions)
    return write_simulation(simulation, folder, answer, sealed)


def _choose_one(answer: bool, sealed: bool) -> None:
    if answer and sealed:
        raise InputError("--sealed", "an answer in plain text beside a sealed one", "choose --answer or --sealed")
