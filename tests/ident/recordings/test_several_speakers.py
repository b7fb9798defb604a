"""Laws of recordings to which several speak: what others leave empty is no fault of those who know the state."""

from pathlib import Path

import numpy as np
import pytest

from ident.api.daily import new
from ident.recordings.load import load_session
from ident.recordings.recording import Recording
from tests.ident.foreign import TYPES, stamped, write_bag

JointState = TYPES.types["sensor_msgs/msg/JointState"]
NOTHING = np.empty(0)


def messages(run: Recording, every: int, order: list[int], velocity: bool) -> list[tuple[int, object]]:
    """The run's states, and after some of them another node's message without effort."""
    found: list[tuple[int, object]] = []
    names = list(run.joints)
    for k, time in enumerate(run.time):
        own = (run.position[k], run.velocity[k], run.effort[k])
        found.append((round(time * 1e9), JointState(stamped(time), names, *own)))
        if k % every == 1:
            speed = np.zeros(len(names)) if velocity else NOTHING
            other = JointState(stamped(time), [names[j] for j in order], np.zeros(len(names)), speed, NOTHING)
            found.append((round(time * 1e9) + 1000, other))
    return found


@pytest.mark.parametrize("every", [2, 5, 40])
@pytest.mark.parametrize("is_reversed", [True, False])
def test_another_nodes_messages_without_effort_are_left_out(
    every: int, is_reversed: bool, run: Recording, tmp_path: Path
) -> None:
    """Law: the run is read back, whatever part of the state another node publishes between, in whichever order."""
    order = list(range(len(run.joints)))
    order = order[::-1] if is_reversed else order
    write_bag(tmp_path / "bag", messages(run, every, order, velocity=every == 5))
    read = load_session(tmp_path / "bag").runs[0]
    np.testing.assert_allclose(read.time, run.time, atol=1e-9)
    np.testing.assert_array_equal(read.effort, run.effort)
    (note,) = read.issues
    assert note.severity == "note"
    assert f"{len(range(1, len(run), every))} messages" in note.evidence


@pytest.mark.parametrize("rows_between", [1, 3, 6])
def test_rows_of_other_topics_are_skipped(rows_between: int, run: Recording, tmp_path: Path) -> None:
    """Law: an export of two topics side by side reads as the states' own table; its time is called __time."""
    header = ["__time"]
    header += [f"/states/{joint}/{channel}" for joint in run.joints for channel in ("position", "effort")]
    header += ["/goal/data[0]"]
    lines = [",".join(header)]
    for k, time in enumerate(run.time):
        cells = [f"{value:.9g}" for pair in zip(run.position[k], run.effort[k], strict=True) for value in pair]
        lines.append(",".join([f"{time:.6f}", *cells, ""]))
        for i in range(rows_between):
            empty = [""] * (len(header) - 2)
            lines.append(",".join([f"{time + 1e-4 * (i + 1):.6f}", *empty, "0.5"]))
    (tmp_path / "run.csv").write_text("\n".join(lines) + "\n")
    read = load_session(tmp_path / "run.csv").runs[0]
    assert len(read) == len(run)
    np.testing.assert_allclose(read.effort, run.effort, rtol=1e-8)
    assert [(issue.issue, issue.severity) for issue in read.issues] == [("other_topics", "note")]


def test_names_that_stand_in_the_rows_name_the_columns(tmp_path: Path) -> None:
    """Law: a dump of messages holds each joint's name beside its numbers, in the driver's order."""
    rng = np.random.default_rng(1)
    names = ["wrist", "shoulder", "elbow"]
    header = ["%time", *(f"field.{what}{k}" for what in ("name", "position", "effort") for k in range(3))]
    lines = [",".join(header)]
    for k in range(200):
        cells = [f"{value:.6g}" for value in rng.standard_normal(6)]
        lines.append(",".join([str(1_700_000_000_000_000_000 + 20_000_000 * k), *names, *cells]))
    (tmp_path / "dump.csv").write_text("\n".join(lines) + "\n")
    found = new(tmp_path / "dump.csv", None)
    assert found.columns["field.position0"] == "wrist/position"
    assert found.columns["field.effort2"] == "elbow/effort"
