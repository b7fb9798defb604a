"""Laws of logs of goals and positions that are no such: refused in one line that says what is wrong and what to do."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from ident.api.daily import servo
from ident.errors import RecordingError
from ident.recordings.recording import Recording, Session

RATE, LAG = 50.0, 0.06
Change = Callable[[Recording], Recording]


def followed(seconds: float = 24.0) -> Session:
    """Two servos that follow their goals 60 ms late, with a little noise."""
    rng = np.random.default_rng(3)
    time = np.arange(int(seconds * RATE)) / RATE
    phases = np.array([0.0, 1.0])
    goal = 0.8 * np.sin(1.9 * time[:, None] + phases) + 0.4 * np.sign(np.sin(0.7 * time[:, None] + 2.0 * phases))
    position = np.empty_like(goal)
    state = goal[0]
    for row, target in enumerate(goal):  # what a goal moves is seen from the next row on
        position[row] = state
        state = state + (target - state) / (LAG * RATE)
    position += 3e-4 * rng.standard_normal(position.shape)
    run = Recording("run", ("pan", "lift"), time, position, np.zeros_like(position), position_command=goal)
    return Session("servos", (run,))


def goals(run: Recording, factor: float) -> Recording:
    """The run with its goals times a factor."""
    assert run.position_command is not None
    return run.replace(position_command=factor * run.position_command)


def swapped(run: Recording) -> Recording:
    """The run with the goals of its joints exchanged."""
    assert run.position_command is not None
    return run.replace(position_command=run.position_command[:, ::-1])


def scaled(run: Recording, factor: float, middle: float = 0.0) -> Recording:
    """The run with goals and positions in another unit."""
    return goals(run, factor).replace(position=factor * run.position + middle)


WRONG: dict[str, tuple[Change, str]] = {
    "goals of the other joint": (swapped, "follows the goal of lift"),
    "goals turned round": (lambda run: goals(run, -1.0), "its own goal, turned round"),
    "goals in degrees": (lambda run: goals(run, math.degrees(1.0)), "read as degrees"),
    "positions in degrees": (
        lambda run: goals(run, math.radians(1.0)),
        "read as radians, the position as degrees",
    ),
    "all in degrees": (lambda run: scaled(run, math.degrees(1.0)), 'angle_unit = "deg"'),
    "all in counts": (lambda run: scaled(run, 651.9, 2048.0), "counts_per_turn"),
    "milliseconds": (lambda run: run.replace(time=1e3 * run.time), "time_unit = 0.001"),
    "time backwards": (lambda run: run.replace(time=run.time[::-1]), "zero or negative"),
    "another rate": (lambda run: run.replace(stated_rate_hz=200.0), "sample_rate_hz = 200"),
    "no goal": (lambda run: run.replace(position_command=None), "no column pan/position_command"),
}


@pytest.mark.parametrize("case", WRONG)
def test_a_log_that_is_read_wrongly_is_refused(case: str) -> None:
    """Law: one line that names what was seen, never figures of another unit, joint or direction."""
    change, told = WRONG[case]
    session = followed()
    with pytest.raises(RecordingError) as refused:
        servo(session.replace(runs=tuple(map(change, session.runs))))
    assert told in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_log_that_is_right_stands() -> None:
    """Law: a servo's own goal is held for its own, and the figures explain how far it is off."""
    found = servo(followed())
    assert found.telemetry == ()
    for joint in found.joints:
        assert joint.rms_after < 0.1 * joint.rms_before


def test_a_soft_servo_is_no_other_unit() -> None:
    """Law: a servo that moves by a quarter of its goal, late, follows it badly; its goal is no angle in degrees."""
    session = followed()
    run = session.runs[0]
    late = np.roll(0.25 * run.position, 10, axis=0)[10:]
    soft = run.at(slice(10, None)).replace(position=late)
    assert len(servo(session.replace(runs=(soft,))).joints) == 2


def test_joints_with_one_goal_are_no_fault() -> None:
    """Law: where two joints are given the same goal either is as good, and nothing is refused."""
    session = followed()
    run = session.runs[0]
    assert run.position_command is not None
    same = run.replace(position=run.position[:, [0, 0]], position_command=run.position_command[:, [0, 0]])
    (first, second) = servo(session.replace(runs=(same,))).joints
    assert first.rms_after == second.rms_after < 0.1 * first.rms_before
