"""Hands an identified arm on: what `ident export` and `ident verify` do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ident.api.fitting import Model, load_model
from ident.api.patching import Written
from ident.export.write import FILES, write_export
from ident.model.evaluation import VERIFICATION_SCHEMA, Check, evaluate, load_limits
from ident.provenance import Provenance, files_of, runs_of
from ident.recordings.load import TOPIC
from ident.results import Result
from ident.sessions import Sources, open_sessions


@dataclass(frozen=True, eq=False)
class Verification(Result):
    """A model against limits.

    Attributes:
        model: Its name.
        robot: Its robot.
        joints: Its joints.
        checks: Every limit on every session.
        in_sample: Whether the model was fitted on one of the recordings.
        accepted: Whether that was accepted.
    """

    SHOWN_BY = "ident.export.printing"

    model: str
    robot: str
    joints: tuple[str, ...]
    checks: tuple[Check, ...]
    in_sample: bool
    accepted: bool

    @property
    def passed(self) -> bool:
        """Whether all limits are kept, on recordings that say something of unseen ones."""
        return all(check.passed for check in self.checks) and (self.accepted or not self.in_sample)

    def to_dict(self) -> dict[str, Any]:
        return {
            "schema": VERIFICATION_SCHEMA,
            "model": self.model,
            "robot": self.robot,
            "joints": list(self.joints),
            "passed": self.passed,
            "in_sample": self.in_sample,
            "checks": [check.to_dict() for check in self.checks],
            "provenance": self.provenance.to_dict(),
        }


def export(
    model: Model,
    out: str | Path,
    *,
    formats: Sequence[str] = tuple(FILES),
    nearest: bool = False,
    on: Sources | None = None,
    into: str | Path | None = None,
    topic: str = TOPIC,
    session_file: str | Path | None = None,
) -> Written:
    """What was identified, for others: URDF, MJCF, TOML, Python, C++, Isaac Lab, ros2_control.

    Args:
        model: A fitted model or its folder.
        out: Folder of the export.
        formats: Which of `urdf`, `mjcf`, `toml`, `python`, `isaaclab`, `ros2_control`, `cpp`.
        nearest: Whether links that no body could be are written as the nearest bodies.
        on: Recordings to measure the files on; the best of the candidates is written.
        into: Your own MJCF of this arm: a copy of it gets what was identified.
        topic: Topic of bags.
        session_file: A session.toml for folders that can't hold one.

    Raises:
        InputError: An unknown format, links that no body could be, or recordings that can't be used.
    """
    loaded = load_model(model)
    opened = None if on is None else open_sessions(on, loaded, topic, session_file, learning=False)
    name = loaded.robot.name if loaded is model else str(model)
    stamps = () if opened is None else opened.stamps
    origin = Provenance("ident export", settings={"model": name, "nearest": nearest}, sessions=stamps)
    motions = () if opened is None else opened.motions
    place = None if into is None else Path(into)
    record = write_export(loaded, Path(out), tuple(formats), nearest, motions, place, origin)
    return Written(Path(out), record, provenance=origin)


def verify(
    model: Model,
    sessions: Sources,
    limits: str | Path,
    *,
    in_sample: bool = False,
    topic: str = TOPIC,
    session_file: str | Path | None = None,
    cutoff: float | None = None,
) -> Verification:
    """A gate: whether a model keeps its limits on recordings that it was not fitted on.

    Args:
        model: A fitted model or its folder.
        sessions: The recordings.
        limits: A TOML file of limits.
        in_sample: Whether recordings that the model was fitted on are accepted.
        topic: Topic of bags.
        session_file: A session.toml for folders that can't hold one.
        cutoff: Corner of the filter for torques [Hz].

    Raises:
        InputError: Model, recordings or limits can't be used.
    """
    loaded = load_model(model)
    wanted = load_limits(Path(limits), loaded.joint_names, loaded.rungs)
    opened = open_sessions(sessions, loaded, topic, session_file, cutoff, learning=False)
    name = loaded.robot.name if loaded is model else Path(str(model)).name
    scores = evaluate(loaded, opened.groups, name).sessions
    checks = tuple(check for score in scores for check in wanted.check(score))
    seen = bool(files_of(loaded.provenance) & runs_of(opened.stamps))
    origin = Provenance("ident verify", settings={"model": name, "limits": str(limits)}, sessions=opened.stamps)
    return Verification(name, loaded.robot.name, loaded.joint_names, checks, seen, in_sample, provenance=origin)
