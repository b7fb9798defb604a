"""Laws of progress: a listener hears of stages, a share that grows to one, and the time left; nobody else hears."""

import io
import pickle
from itertools import count, pairwise

import numpy as np
import pytest
from rich.console import Console

from ident import diagnose
from ident.arrays import least_squares
from ident.errors import ArmgapError, InputError, ModelError, RecordingError, RobotError
from ident.progress import listening, stage, step
from ident.robot.names import data_path
from ident.show.console import BETWEEN_LINES, progress_line


def test_time_left_is_what_an_even_pace_leaves() -> None:
    seconds = iter(range(100))
    heard: list[tuple[str, float, float | None]] = []
    with listening(lambda *seen: heard.append(seen), lambda: float(next(seconds))):
        stage("first", 0.0, 0.5)
        step(1, 2)
        stage("second", 0.5, 1.0)
        step(4, 4)
    # The clock is looked at once to begin, and once a report.
    assert heard == [("first", 0.0, None), ("first", 0.25, 6.0), ("second", 0.5, 3.0), ("second", 1.0, 0.0)]


def foretold(shares: list[float], interval: float = 1.0) -> list[float | None]:
    """What is heard of the time left where the work has come so far at equal intervals."""
    seconds = count(0.0, interval)
    left: list[float | None] = []
    with listening(lambda *seen: left.append(seen[2]), lambda: next(seconds)):
        for share in shares:
            stage("work", share)
    return left


def test_work_that_slows_down_is_not_soon_done() -> None:
    """Law: the time left is never less than at the pace of the latter half."""
    quick = [0.1, 0.2, 0.3, 0.4]
    slow = [0.41, 0.42, 0.43, 0.44, 0.45, 0.46, 0.47, 0.48]
    left = foretold(quick + slow)[-1]
    assert left is not None
    whole_pace = 12.0 * 0.52 / 0.48
    latter_pace = 0.52 / 0.01
    assert whole_pace < left
    assert left == pytest.approx(latter_pace)


def test_of_work_that_stands_still_no_end_is_foretold() -> None:
    assert foretold([0.5] + [0.5] * 9)[-1] is None


def test_another_job_begins_its_time_anew() -> None:
    seconds = iter(range(100))
    left: list[float | None] = []
    with listening(lambda *seen: left.append(seen[2]), lambda: float(next(seconds))):
        stage("one", 0.9)
        stage("two", 0.0)
        step(1, 2)
    assert left[-1] == pytest.approx(2.0)


def test_a_diagnosis_reports_shares_that_grow() -> None:
    shares: list[float] = []
    with listening(lambda _, share, __: shares.append(share)):
        diagnose(data_path("logs/tm5_900/sealed_1"), "tm5-900")
    assert len(shares) > 5
    assert all(before <= after for before, after in pairwise(shares))
    assert 0.0 == shares[0] < shares[-1] <= 1.0


def test_a_log_gets_whole_lines_some_seconds_apart() -> None:
    out, seconds = io.StringIO(), count()
    with progress_line(Console(file=out), "fit", lambda: float(next(seconds))):
        for k in range(100):
            stage("net", k / 100)
    lines = out.getvalue().splitlines()
    assert 5 <= len(lines) <= 200 / BETWEEN_LINES
    assert all(line.startswith("fit: ") and line.endswith(" left") for line in lines[3:])


def test_a_terminal_gets_one_line_that_is_gone_at_the_end() -> None:
    out = io.StringIO()
    console = Console(file=out, force_terminal=True, width=30)
    with progress_line(console, "diagnose"):
        for k in range(4):
            stage("a stage of very many words that no line holds", k / 4)
    shown = out.getvalue()
    assert "diagnose: 75 %" in shown
    assert shown.count("\n") <= 1
    assert shown.endswith("\x1b[2K")


def test_least_squares_come_to_an_end(monkeypatch: pytest.MonkeyPatch) -> None:
    """Law: where LAPACK's fast way gives up, the solution is the same one, columns of zeros or of one kind included."""
    rng = np.random.default_rng(0)
    table, target = rng.normal(size=(20, 6)), rng.normal(size=20)
    table[:, 2], table[:, 4] = 0.0, 2.0 * table[:, 3]
    fast = least_squares(table, target, 1e-8)

    def give_up(*_: object, **__: object) -> None:
        raise np.linalg.LinAlgError

    monkeypatch.setattr("numpy.linalg.lstsq", give_up)
    np.testing.assert_allclose(least_squares(table, target, 1e-8), fast, atol=1e-12)


@pytest.mark.parametrize("kind", [InputError, RecordingError, RobotError, ModelError])
def test_message_is_one_line_with_place_fault_and_remedy(kind: type[InputError]) -> None:
    """The message names where, what and remedy in this order, in one line, and keeps them as data."""
    error = kind("log.csv, column 3", "text in a number: 'x'", "correct the cell")
    assert str(error) == "log.csv, column 3: text in a number: 'x'; correct the cell"
    assert (error.where, error.what, error.remedy) == (
        "log.csv, column 3",
        "text in a number: 'x'",
        "correct the cell",
    )
    assert isinstance(error, ArmgapError)


def test_an_error_survives_the_way_from_a_worker_process() -> None:
    """Copied through a process boundary an error keeps its class and its data."""
    error = pickle.loads(pickle.dumps(RobotError("a", "b", "c")))
    assert type(error) is RobotError
    assert (error.where, error.what, error.remedy) == ("a", "b", "c")
