"""One run: messages of joint states in, a file of armgap's native columns out. It needs no ROS.

In: `sensor_msgs/JointState`, or whatever has `header.stamp`, `name`, `position`, `velocity` and
`effort`. Out: a CSV file with `time` [s], and of each joint position [rad or m], velocity and effort
[N m or N] where messages have them.
"""

from __future__ import annotations

import csv
import os
from collections import Counter
from pathlib import Path
from typing import Any

NANOSECONDS = 1e-9
# Quantities that a message may leave out, all of them by an empty list.
OPTIONAL = ("velocity", "effort")


class JointLog:
    """The messages of one run.

    The first message says which joints there are and which quantities. What does not fit to it is
    left out and counted: `left_out` holds how many messages, by reason.

    Args:
        after: Stamp of the last message of the run before [s]: a session has one clock.
    """

    def __init__(self, after: float = float("-inf")) -> None:
        self.joints: tuple[str, ...] = ()
        self.quantities: tuple[str, ...] = ()
        self.rows: list[list[float]] = []
        self.last = after
        self.left_out: Counter[str] = Counter()

    def add(self, message: Any) -> None:
        """Takes a message."""
        time = message.header.stamp.sec + NANOSECONDS * message.header.stamp.nanosec
        reason = self._fault(message, time)
        if reason:
            self.left_out[reason] += 1
            return
        if not self.joints:
            self.joints = tuple(message.name)
            told = tuple(name for name in OPTIONAL if len(getattr(message, name)))
            self.quantities = ("position", *told)
        place = {name: number for number, name in enumerate(message.name)}
        row = [time]
        for joint in self.joints:
            values = [getattr(message, quantity)[place[joint]] for quantity in self.quantities]
            row += map(float, values)
        self.rows.append(row)
        self.last = time

    def _fault(self, message: Any, time: float) -> str:
        """Why a message is left out; empty where it is not."""
        if time <= self.last:
            return "its stamp does not come after the one before"
        joints = list(message.name)
        if not joints or len(set(joints)) < len(joints):
            return "its joints have no names, or twice the same"
        if self.joints and set(joints) != set(self.joints):
            return "it is of other joints than the first message"
        needed = self.quantities or ("position",)
        for quantity in needed:
            if len(getattr(message, quantity)) != len(joints):
                return f"{quantity} is not given for every joint"
        return ""

    @property
    def columns(self) -> list[str]:
        """Names of the columns, as armgap reads them."""
        names = ["time"]
        for joint in self.joints:
            names += [f"{joint}/{quantity}" for quantity in self.quantities]
        return names

    @property
    def seconds(self) -> float:
        """How long the run is [s]."""
        return self.rows[-1][0] - self.rows[0][0] if self.rows else 0.0

    def describe(self) -> str:
        """What was recorded, and what is missing, in a sentence."""
        text = f"{len(self.rows)} samples of {len(self.joints)} joints in {self.seconds:.1f} s"
        if self.rows and "effort" not in self.quantities:
            text += "; without effort armgap can't diagnose: record it, or go to `ident servo`"
        for reason, number in self.left_out.items():
            text += f"; {number} messages left out: {reason}"
        return text

    def write(self, path: Path) -> None:
        """Writes the run, whole or not at all.

        Raises:
            ValueError: There is nothing to write.
        """
        if not self.rows:
            raise ValueError(f"{path}: no message came; is the topic right?")
        path.parent.mkdir(parents=True, exist_ok=True)
        begun = path.with_suffix(".part")
        with begun.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(self.columns)
            for time, *values in self.rows:
                writer.writerow([f"{time:.9f}", *map(repr, values)])
        os.replace(begun, path)
