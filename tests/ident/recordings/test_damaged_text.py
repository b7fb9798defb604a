"""Damaged cells: a row that is no sample is dropped and told; a doubtful cell forbids a fit and is named."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ident.recordings.load import load_recording, load_session
from ident.recordings.recording import Recording, TelemetryIssue


def read(path: Path, lines: list[str], end: str = "\n") -> tuple[Recording, tuple[TelemetryIssue, ...]]:
    path.write_text("\n".join(lines) + end, encoding="utf-8", errors="surrogateescape")
    run = load_recording(path)
    return run, run.issues


@pytest.mark.parametrize(
    "garbage",
    [
        "[WARN] connection lost",
        "[WARN],a,b,c,d",
        "\udcff\udcfe\x00",
        "time,a/position,b/position,a/effort,b/effort",
        "1,2",
        "1,2,3,4,5,6",
    ],
)
def test_a_garbage_row_is_dropped_and_told(garbage: str, lines: list[str], run: Recording, tmp_path: Path) -> None:
    """A line of a log, a repeated header, a wrong number of cells: the 400 samples around it are kept."""
    found, issues = read(tmp_path / "run.csv", [*lines[:51], "", garbage, *lines[51:]])
    assert len(found) == 400
    np.testing.assert_allclose(found.position, run.position, atol=5.1e-7)
    assert [(issue.issue, issue.severity) for issue in issues] == [("garbage_cells", "note")]
    assert "line 53" in issues[0].evidence  # blank lines count


@pytest.mark.parametrize("cut", [4, 20, 30])
def test_a_last_row_cut_short_is_dropped(cut: int, lines: list[str], tmp_path: Path) -> None:
    """Also where the cut leaves a number: fewer decimals than all rows before give it away."""
    lines[-1] = lines[-1][:-cut]
    found, issues = read(tmp_path / "run.csv", lines, end="")
    assert len(found) == 399
    assert [(issue.issue, issue.severity) for issue in issues] == [("truncated_row", "note")]


@pytest.mark.parametrize(
    ("cell", "issue"),
    [("O.5", "garbage_cells"), ("nan", "nan_cells"), ("", "nan_cells"), ("inf", "nan_cells"), ("1e999", "nan_cells")],
)
def test_a_bad_cell_in_a_good_row_is_fatal_and_named(cell: str, issue: str, lines: list[str], tmp_path: Path) -> None:
    cells = lines[51].split(",")
    cells[2] = cell
    found, issues = read(tmp_path / "run.csv", [*lines[:51], ",".join(cells), *lines[52:]])
    assert len(found) == 400
    assert np.isnan(found.position[50, 1])
    (told,) = issues
    assert (told.issue, told.severity, told.joints) == (issue, "fatal", ("b",))
    assert "run.csv, line 52, column b/position" in told.evidence
    assert "--mend" in told.remedy


def test_a_row_of_nan_is_dropped(lines: list[str], tmp_path: Path) -> None:
    """Where every fifth row is lost, what is left is no continuous motion."""
    found, issues = read(tmp_path / "run.csv", [*lines[:51], "0.5,nan,nan,nan,nan", *lines[52:]])
    assert len(found) == 399
    assert [(issue.issue, issue.severity) for issue in issues] == [("nan_cells", "note")]
    spoilt = [line if k % 5 else "x,x,x,x,x" for k, line in enumerate(lines[1:])]
    _, issues = read(tmp_path / "run.csv", [lines[0], *spoilt])
    assert [(issue.issue, issue.severity) for issue in issues] == [("garbage_cells", "fatal")]


def test_garbage_in_a_column_that_is_not_used_is_no_damage(lines: list[str], tmp_path: Path) -> None:
    rows = [f"{line},{'?' if k == 7 else 1}" for k, line in enumerate(lines[1:])]
    found, issues = read(tmp_path / "run.csv", [lines[0] + ",note", *rows])
    assert len(found) == 400
    assert issues == ()


def test_decimal_commas_are_read_in_damaged_tables_too(lines: list[str], run: Recording, tmp_path: Path) -> None:
    rows = [line.replace(",", ";").replace(".", ",") for line in lines]
    found, issues = read(tmp_path / "run.csv", [*rows[:51], "lost;x;x;x;x", *rows[51:]])
    np.testing.assert_allclose(found.effort, run.effort, atol=5.1e-7)
    assert issues[0].issue == "garbage_cells"


def test_a_carriage_return_within_a_row_spoils_its_cell_alone(tmp_path: Path) -> None:
    """Law: a byte that some readers take for a line's end changes no other row."""
    rows = [f"{0.01 * k:.2f},{0.1 * k:.3f},{0.2 * k:.3f}" for k in range(40)]
    rows[7] = rows[7].replace(",", ",\r", 1)
    path = tmp_path / "run.csv"
    path.write_bytes("\n".join(["time,j/position,j/effort", *rows, ""]).encode())
    run = load_session(path).runs[0]
    assert len(run) == 40
    assert [issue.issue for issue in run.issues] == ["garbage_cells"]
