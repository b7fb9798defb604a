"""CSV and foreign text tables: whatever the layout, the same numbers."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from ident.errors import RecordingError
from ident.recordings.load import load_recording, load_session
from ident.recordings.recording import Recording, TelemetryIssue

NUMBERED = '[columns]\n1 = "time"\n2 = "a/position"\n3 = "b/position"\n4 = "a/effort"\n5 = "b/effort"\n'

LAYOUTS: dict[str, Callable[[list[str]], str]] = {
    "plain": lambda lines: "\n".join(lines) + "\n",
    "no line end": lambda lines: "\n".join(lines),
    "crlf": lambda lines: "\r\n".join(lines) + "\r\n",
    "blank lines": lambda lines: "\n\n".join(lines) + "\n",
    "byte order mark": lambda lines: "\ufeff" + "\n".join(lines),
    "semicolons": lambda lines: "\n".join(lines).replace(",", ";"),
    "decimal commas": lambda lines: "\n".join(lines).replace(",", ";").replace(".", ","),
    "tabs": lambda lines: "\n".join(lines).replace(",", "\t"),
    "pipes": lambda lines: "\n".join(lines).replace(",", "|"),
    "blanks": lambda lines: "\n".join("  " + line for line in lines).replace(",", "   "),
    "blanks after commas": lambda lines: "\n".join(lines).replace(",", ", "),
    "header in a comment": lambda lines: "# made up\n# " + "\n".join(lines).replace(",", " "),
    "quoted header": lambda lines: "\n".join([",".join(f'"{n}"' for n in lines[0].split(",")), *lines[1:]]),
    "extra column": lambda lines: "\n".join([lines[0] + ",note", *(line + ",hello" for line in lines[1:])]),
}


@pytest.mark.parametrize("layout", LAYOUTS)
def test_every_layout_gives_the_same_arrays(layout: str, lines: list[str], run: Recording, tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_text(LAYOUTS[layout](lines), encoding="utf-8")
    read = load_recording(path)
    assert read.joints == run.joints
    assert read.issues == ()
    for channel in ("time", "position", "effort"):
        np.testing.assert_allclose(getattr(read, channel), getattr(run, channel), atol=5.1e-7)


SETTINGS: dict[str, tuple[Callable[[list[str]], list[str]], str]] = {
    "columns by number": (lambda lines: lines[1:], NUMBERED),
    "a joint renamed": (
        lambda lines: [lines[0].replace("a/", "fer/"), *lines[1:]],
        '[columns]\n"fer/position" = "a/position"',
    ),
    "a rate in place of time": (lambda lines: [lines[0].replace("time", "t"), *lines[1:]], "sample_rate_hz = 100"),
}


@pytest.mark.parametrize("case", SETTINGS)
def test_settings_make_native_columns(case: str, lines: list[str], run: Recording, tmp_path: Path) -> None:
    change, settings = SETTINGS[case]
    (tmp_path / "run.csv").write_text("\n".join(change(lines)))
    (tmp_path / "session.toml").write_text(settings)
    read = load_session(tmp_path).runs[0]
    assert read.joints == run.joints
    for channel in ("time", "position", "effort"):
        np.testing.assert_allclose(getattr(read, channel), getattr(run, channel), atol=5.1e-7)


def test_torque_is_sign_times_gain_times_current(lines: list[str], run: Recording, tmp_path: Path) -> None:
    (tmp_path / "run.csv").write_text("\n".join(lines).replace("effort", "current"))
    (tmp_path / "session.toml").write_text(
        "angle_unit = 'deg'\n[drive_gain_Nm_per_A]\na = 2\nb = 3\n[effort_sign]\nb = -1\n"
    )
    read = load_session(tmp_path).runs[0]
    np.testing.assert_allclose(read.effort, run.effort * [2.0, -3.0], atol=2e-6)
    np.testing.assert_allclose(read.position, np.radians(run.position), atol=1e-8)
    assert read.current is not None


def test_a_slow_temperature_is_filled_between_its_cells(lines: list[str], tmp_path: Path) -> None:
    rows = [
        f"{line},{20 + k // 100 if k % 100 == 0 else ''},{30 if k % 50 == 0 else ''}"
        for k, line in enumerate(lines[1:])
    ]
    (tmp_path / "run.csv").write_text("\n".join([lines[0] + ",a/temperature,b/temperature", *rows]))
    read = load_recording(tmp_path / "run.csv")
    assert read.issues == ()
    assert read.temperature[50, 0] == pytest.approx(20.5)


BAD: dict[str, tuple[Callable[[list[str]], str], str, str]] = {
    "empty": (lambda lines: "", "", "is empty"),
    "blank": (lambda lines: "\n \n\n", "", "is empty"),
    "header only": (lambda lines: lines[0] + "\n", "", "no rows"),
    "header only, no line end": (lambda lines: lines[0], "", "no whole row"),
    "no joint": (lambda lines: "\n".join(lines).replace("/", "_"), "", "no column <joint>/position"),
    "missing effort": (lambda lines: "\n".join(lines).replace("b/effort", "b/foo"), "", "missing column b/effort"),
    "missing position": (lambda lines: "\n".join(lines).replace("b/position", "x"), "", "missing column b/position"),
    "missing time": (lambda lines: "\n".join(lines).replace("time", "zeit"), "", "missing column time"),
    "column twice": (lambda lines: "\n".join(lines).replace("b/position", "a/position"), "", "are both"),
    "current without gain": (lambda lines: "\n".join(lines).replace("effort", "current"), "", "no drive gain"),
    "header too short": (lambda lines: "\n".join([lines[0] + ",c", *lines[1:]]), "", "number of cells"),
    "mapped column missing": (lambda lines: "\n".join(lines), '[columns]\nx = "a/position"', "no column 'x'"),
    "not a native name": (lambda lines: "\n".join(lines), '[columns]\n1 = "a/pos"', "no native column"),
    "misspelt key": (lambda lines: "\n".join(lines), "[efort_sign]\na = 1", "did you mean 'effort_sign'"),
    "key of a table": (lambda lines: "\n".join(lines), "[payload]\nmass_kg = 1\ncentre = [0, 0, 1]", "com_m, mass_kg"),
    "sign of no joint": (lambda lines: "\n".join(lines), "[effort_sign]\nz = 1", "names the joint 'z'"),
    "sign of 2": (lambda lines: "\n".join(lines), "[effort_sign]\na = 2", "a sign is 1 or -1"),
    "gain of text": (lambda lines: "\n".join(lines), '[drive_gain_Nm_per_A]\na = "x"', "finite number"),
    "negative rate": (lambda lines: "\n".join(lines), "sample_rate_hz = -1", "positive rate"),
    "negative payload": (lambda lines: "\n".join(lines), "[payload]\nmass_kg = -1", "not negative"),
    "payload's place": (lambda lines: "\n".join(lines), "[payload]\nmass_kg = 1\ncom_m = [1, 2]", "three numbers"),
    "unknown unit": (lambda lines: "\n".join(lines), 'angle_unit = "turns"', "angle_unit"),
    "not TOML": (lambda lines: "\n".join(lines), "[columns", "not TOML"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_is_refused_in_one_line(case: str, lines: list[str], tmp_path: Path) -> None:
    """Every message is one line, names the file, what is wrong and the remedy."""
    spoil, settings, expected = BAD[case]
    (tmp_path / "run.csv").write_text(spoil(lines))
    (tmp_path / "session.toml").write_text(settings)
    with pytest.raises(RecordingError) as caught:
        load_session(tmp_path)
    message = str(caught.value)
    assert expected in message
    assert "run.csv" in message or "session.toml" in message
    assert caught.value.remedy
    assert "\n" not in message


@pytest.mark.parametrize(
    "name",
    ["a, b", 'say "arm"', "[/x] $(id) {0} %s \\\\", "\x1b[31m \x1c \x85 \u2028 \u202e", "ü 関節", "épaule \\xff"],
    ids=lambda name: ascii(name),
)
@pytest.mark.parametrize("separator", [",", ";"])
def test_names_come_back_as_they_stand(tmp_path: Path, name: str, separator: str) -> None:
    """Law: separators, quotes, control characters and bytes that are not UTF-8 in a header's cell are its text."""
    path = tmp_path / "run.csv"
    names = ["time", f"{name}/position", f"{name}/effort"]
    header = separator.join('"' + cell.replace('"', '""') + '"' for cell in names).encode()
    rows = "\n".join(separator.join((f"{k / 100}", f"{k / 7}", f"{k / 3}")) for k in range(20))
    path.write_bytes(header.replace(b"\\xff", b"\xff") + b"\n" + rows.encode() + b"\n")
    run = load_session(path).runs[0]
    assert run.joints == (name,)
    np.testing.assert_allclose(run.effort[:, 0], np.arange(20) / 3)


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
    (seen,) = issues
    assert (seen.issue, seen.severity, seen.joints) == (issue, "fatal", ("b",))
    assert "run.csv, line 52, column b/position" in seen.evidence
    assert "--mend" in seen.remedy


def test_decimal_commas_are_read_in_damaged_tables_too(lines: list[str], run: Recording, tmp_path: Path) -> None:
    rows = [line.replace(",", ";").replace(".", ",") for line in lines]
    found, issues = read(tmp_path / "run.csv", [*rows[:51], "lost;x;x;x;x", *rows[51:]])
    np.testing.assert_allclose(found.effort, run.effort, atol=5.1e-7)
    assert issues[0].issue == "garbage_cells"
