"""The error tree. Every error a user can cause says where it is, what is wrong and what to do about
it.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

# Control characters, marks that turn the direction of writing, and bytes of names that are not
# UTF-8.
UNSEEN = re.compile(
    "[\x00-\x1f\x7f-\x9f\u061c\u200b-\u200f\u2028-\u202e\u2060-\u2069\ufeff\ud800-\udfff]"
)
# A line for a settings file within a remedy, where it stands in backquotes.
LINE_TO_WRITE = re.compile(r"`(\w+ = [^`]+)`")
# As much of a place, a fault and a remedy as is told: together they fill a screen [characters].
LONGEST_PART = 600


def visible(text: str, lines: bool = False) -> str:
    """A text with everything in it that a terminal would obey rather than show written as its
    escape.

    Args:
        text: Names from files, messages with such names in them.
        lines: Whether line ends and tabs stay.
    """

    def escape(mark: re.Match[str]) -> str:
        code = ord(mark.group())
        if lines and code in (9, 10):
            return mark.group()
        if 0xDC80 <= code <= 0xDCFF:  # a byte of a file's name that is not UTF-8
            code -= 0xDC00
        return f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}"

    return UNSEEN.sub(escape, text)


def plural(count: int, noun: str) -> str:
    """A count with its noun: `1 run`, `2 runs`."""
    return f"{count:,} {noun}{'' if count == 1 else 's'}"


def join_words(words: Sequence[str]) -> str:
    """Words as a list in a sentence: `a, b and c`."""
    if len(words) < 2:
        return "".join(words)
    return f"{', '.join(words[:-1])} and {words[-1]}"


def first_line(error: BaseException) -> str:
    """The first line of what a library says, or the kind of its error where it says nothing."""
    return (str(error).strip().splitlines() or [type(error).__name__])[0]


def shortened(text: str, longest: int = LONGEST_PART) -> str:
    """A text with its middle left out where it has more than `longest` characters."""
    if len(text) <= longest:
        return text
    half = longest // 2
    return f"{text[:half]} … {text[-half:]}"


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
        self.where = str(where)
        self.what = what
        self.remedy = remedy
        parts = (shortened(visible(words)) for words in (self.where, what, remedy))
        super().__init__("{}: {}; {}".format(*parts))

    def __reduce__(self) -> tuple[type[InputError], tuple[str, str, str]]:
        return type(self), (self.where, self.what, self.remedy)


class RecordingError(InputError):
    """A recording, or the session.toml beside it, can't be used."""


class RobotError(InputError):
    """A URDF, or the name of a robot, can't be used."""


class ModelError(InputError):
    """A folder of a fitted model can't be used, or not with this robot."""
