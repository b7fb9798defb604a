"""The error tree. Every error a user can cause says where it is, what is wrong and what to do about it."""

from __future__ import annotations

from pathlib import Path


class ArmgapError(Exception):
    """Base of all errors raised by armgap."""


class InputError(ArmgapError):
    """The user's input is at fault: the command ends with exit status 2 and this one line.

    Attributes:
        where: File, and the place in it (column, line, key) as far as known.
        what: What is wrong, with the offending value.
        remedy: What the user can do about it.
    """

    def __init__(self, where: str | Path, what: str, remedy: str) -> None:
        self.where, self.what, self.remedy = str(where), what, remedy
        super().__init__(f"{self.where}: {what}; {remedy}")

    def __reduce__(self) -> tuple[type[InputError], tuple[str, str, str]]:
        return type(self), (self.where, self.what, self.remedy)


class RecordingError(InputError):
    """A recording, or the session.toml beside it, can't be used."""


class RobotError(InputError):
    """A URDF, or the name of a robot, can't be used."""


class ModelError(InputError):
    """A folder of a fitted model can't be used, or not with this robot."""
