"""Arms that log goal and position only, on a terminal: what holds each joint back, and what these
recordings don't tell.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from rich.console import Console

from ident.errors import join_words, plural
from ident.servos.servo_fit import FIGURES, LATE, TEXT, ServoArm, ServoJoint
from ident.show.console import say
from ident.show.report.words import sentence, significant

ServoRecord = Mapping[str, Any]
"""`ident.servo/1`, or a part of it."""

WRITE_FILES = (
    "Write what was found for your simulator: `ident servo … --robot … --out servo` "
    "(MuJoCo, mjlab, BAM)."
)
RECORD_MORE = (
    "Record this again: each joint over its whole range, slowly both ways and with sudden starts."
)
# Causes that goal and position can't part.
ALIKE = "Dead band, dry friction and backlash look alike here: {}."


def print_servo(console: Console, result: ServoArm) -> None:
    """The joint that follows worst and what to do; the figures of each joint; what is not told."""
    for issue in result.telemetry:
        say(console, f"{issue.severity}: {issue.evidence}; {issue.remedy}", hanging="    ")
    judged = judged_joints(result.to_dict())
    say(console, headline(judged), style="bold")
    say(console, f"Do: {WRITE_FILES if judged else RECORD_MORE}", hanging="    ")
    for joint in result.joints:
        for line in figure_lines(joint):
            say(console, line, hanging=f"{line[: len(line) - len(line.lstrip())]}  ")
    if any("dead_band_rad" in joint.figures for joint in result.joints):
        say(console, ALIKE.format(TEXT["parted_by"]), hanging="  ")
    for model in result.rolled:
        runs = plural(len(model.held), "run")
        error = f"{1e3 * model.held_error:.0f} mrad on average over {runs} held back"
        say(
            console,
            f"{model.joint}: rolled out from its goals alone it is off by {error}",
            hanging="  ",
        )
    if any(LATE & {*joint.figures} for joint in result.joints):
        say(
            console,
            TEXT["held"].format(hold=1e3 * result.hold_s, half=500.0 * result.hold_s),
            hanging="  ",
        )
    untold = untold_lines(result)
    if untold:
        say(console, "Not told by these recordings, and what would:")
    for line in untold:
        say(console, line, "  ", "    ")


def figure_lines(joint: ServoJoint) -> Iterator[str]:
    """A joint's error, and a line for each of its figures."""
    if np.isnan(joint.rms_before):
        yield f"{joint.joint}: nothing can be told"
        return
    sizes = [significant(1e3 * size, 3) for size in (joint.rms_before, joint.rms_after)]
    known = f"{sizes[1]} mrad of it are not explained"
    yield f"{joint.joint}: off its goal by {sizes[0]} mrad rms; {known}"
    for name, figure in joint.figures.items():
        if "words" in FIGURES[name]:
            yield "  " + FIGURES[name]["words"].format(*(1e3 * end for end in figure))


def untold_lines(result: ServoArm) -> list[str]:
    """What is not told, a line for each reason: which figures, at which joints, what would help."""
    joints: dict[tuple[str, str], list[str]] = {}
    for joint in result.joints:
        for name, reason in joint.untold.items():
            joints.setdefault((FIGURES[name]["name"], reason), []).append(joint.joint)
    names: dict[tuple[str, str], list[str]] = {}
    for (name, reason), where in joints.items():
        names.setdefault((reason, _places(where, result)), []).append(name)
    lines = []
    for (reason, places), figures in names.items():
        lines.append(f"{sentence(join_words(figures))}{places}: {reason}")
    return lines


def _places(joints: Sequence[str], result: ServoArm) -> str:
    """At which joints, in brackets; nothing of an arm with one."""
    if len(result.joints) == 1:
        return ""
    return " (every joint)" if len(joints) == len(result.joints) else f" ({join_words(joints)})"


def judged_joints(record: ServoRecord) -> dict[str, ServoRecord]:
    """The joints of which anything is known, by their names."""
    return {name: joint for name, joint in record["joints"].items() if joint["heldout"] is not None}


def headline(judged: Mapping[str, ServoRecord]) -> str:
    """The joint that follows worst, and what is known of it, in one sentence."""
    if not judged:
        return "These recordings tell nothing of the servos."
    errors = {name: joint["heldout"] for name, joint in judged.items()}
    worst = max(errors, key=lambda name: errors[name]["rms_before_rad"])
    before, after = (1e3 * errors[worst][f"rms_{when}_rad"] for when in ("before", "after"))
    late = judged[worst]["figures"].get("total_lag_s")
    lag = f", {1e3 * late['value']:.0f} ms late" if late else ""
    whose = f"{worst} follows"
    if len(judged) > 1:
        whose = f"Of {plural(len(judged), 'joint')} {worst} follows worst:"
    known = f"all but {significant(after)} mrad of it is explained"
    return f"{whose} its goal within {significant(before)} mrad{lag}; {known}."
