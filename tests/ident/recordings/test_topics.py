"""Laws of tables whose rows are messages of several topics, each with its own rate."""

from pathlib import Path

import numpy as np
import pytest

from ident.api.daily import new
from ident.errors import InputError
from ident.recordings.load import load_session
from ident.recordings.recording import Recording
from ident.robot.arm import ArmModel
from tests.ident.made_up import made_session


@pytest.fixture(scope="module")
def run(arm: ArmModel) -> Recording:
    """Ten seconds at 1 kHz with friction, from which topics take their messages."""

    def law(q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
        return arm.inverse_dynamics(q, dq, ddq) + 8.0 * dq + 5.0 * np.tanh(dq / 0.01)

    return made_session(arm, law, [5], duration=10.0, rate=1000.0).runs[0]


def merged(run: Recording, positions: slice, torques: slice, names: str = "{joint}/{channel}") -> tuple[str, list[str]]:
    """The header, and a row for each message of either topic; both in one where stamps agree."""
    columns = [names.format(joint=joint, channel=kind) for kind in ("position", "effort") for joint in run.joints]
    rows: dict[float, list[str]] = {}
    for first, values, chosen in ((0, run.position, positions), (len(run.joints), run.effort, torques)):
        for stamp, of_row in zip(run.time[chosen], values[chosen], strict=True):
            cells = rows.setdefault(float(stamp), [""] * len(columns))
            cells[first : first + len(run.joints)] = [f"{value:.9g}" for value in of_row]
    return ",".join(["time", *columns]), [",".join([f"{stamp:.4f}", *rows[stamp]]) for stamp in sorted(rows)]


@pytest.mark.parametrize(
    ("positions", "torques"),
    [
        (slice(None, None, 5), slice(None, None, 10)),
        (slice(None, None, 5), slice(2, None, 10)),
        (slice(3, None, 8), slice(None, None, 2)),
    ],
    ids=["torque of half the rows", "rows of their own", "torque four times as fast"],
)
def test_the_rarest_channel_gives_the_rows(positions: slice, torques: slice, run: Recording, tmp_path: Path) -> None:
    """Law: what is kept are its own samples, beside the other's on the line between its neighbours."""
    header, rows = merged(run, positions, torques)
    (tmp_path / "a.csv").write_text("\n".join([header, *rows, ""]))
    session = load_session(tmp_path)
    (read,) = session.runs
    fewer = min((positions, torques), key=lambda chosen: len(run.time[chosen]))
    assert len(read) > 0.98 * len(run.time[fewer])
    assert [issue.issue for issue in session.issues()] == ["other_topics"]
    at = np.searchsorted(run.time, read.time - 1e-6)
    rare, dense = ("effort", "position") if fewer is torques else ("position", "effort")
    np.testing.assert_allclose(getattr(read, rare), getattr(run, rare)[at], rtol=1e-7, atol=1e-7)
    step = np.abs(np.diff(getattr(run, dense)[torques if dense == "effort" else positions], axis=0)).max(axis=0)
    error = np.abs(getattr(read, dense) - getattr(run, dense)[at]).max(axis=0)
    assert np.all(error <= 0.5 * step + 1e-6)


def test_nothing_is_made_up_across_a_gap_or_a_wrap(run: Recording, tmp_path: Path) -> None:
    """Law: no row lies in a second without positions, and no angle between the two ends of a turn."""
    turned = run.replace(position=(run.position + 40.0 * run.time[:, None]) % (2.0 * np.pi))
    header, rows = merged(turned, slice(None, None, 5), slice(2, None, 10))
    lost = [row for row in rows if not 3.0 < float(row.split(",")[0]) - run.time[0] < 4.0 or ",,," in row[:12]]
    (tmp_path / "a.csv").write_text("\n".join([header, *lost, ""]))
    (read,) = load_session(tmp_path).runs
    since = read.time - run.time[0]
    assert not np.any((since > 3.05) & (since < 3.95))
    truth = turned.position[np.searchsorted(run.time, read.time - 1e-6)]
    off = np.abs(np.angle(np.exp(1j * (read.position - truth))))
    assert off.max() <= np.abs(np.diff(np.unwrap(turned.position[::5], axis=0), axis=0)).max()


@pytest.mark.parametrize(
    "names",
    [
        "/joint_states/{channel}/{joint}",
        "/arm/{joint}/{channel}",
        "/js/{channel}/{joint}",
        "js.{channel}.{joint}",
        "{channel}/{joint}",
    ],
)
def test_channels_of_several_topics_are_told_by_their_names(
    names: str, run: Recording, arm: ArmModel, tmp_path: Path
) -> None:
    """Law: wherever in a path the joint stands, and whatever the topics are called."""
    header, rows = merged(run, slice(None, None, 5), slice(2, None, 10), names)
    (tmp_path / "a.csv").write_text("\n".join([header.replace("effort", "torque"), *rows, ""]))
    new(tmp_path, arm)
    (read,) = load_session(tmp_path).runs
    truth = np.searchsorted(run.time, read.time - 1e-6)
    assert read.joints == arm.joint_names
    np.testing.assert_allclose(read.effort, run.effort[truth], rtol=1e-7, atol=1e-7)
    np.testing.assert_allclose(read.position, run.position[truth], atol=1e-3)


def test_rows_that_never_hold_a_state_are_refused(run: Recording, arm: ArmModel, tmp_path: Path) -> None:
    """Law: topics whose rows are out of time's order are told in a line."""
    header, rows = merged(run, slice(None, None, 5), slice(2, None, 10))
    (tmp_path / "a.csv").write_text("\n".join([header.replace("/", "_"), *rows[::-1], ""]))
    with pytest.raises(InputError, match="no row holds both position and torque"):
        new(tmp_path, arm)
