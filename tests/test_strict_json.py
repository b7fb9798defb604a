"""Results are JSON as the standard has it, whatever their numbers; figures that no arm has are not handed on."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ident.errors import InputError
from ident.export.identified import Diagnosed
from ident.files import write_record
from ident.records import as_json
from ident.robot.arm import ArmModel
from ident.safe_read import read_json, require_finite
from tests.ident.export.diagnoses import write_diagnosis

ROOT = Path(__file__).parents[1]
# Texts in quotes for TOML, YAML and messages; schemas; an envelope of texts; the door itself.
ALLOWED = ("ensure_ascii=False", "json.dumps(name)", "make_schema", "ident.envelope/1")
ALLOWED += ("list(self.joints)", "_strict(record)", "json.dumps(value)", "json.dumps(foreign)", "json.dumps(f'")
ALLOWED += ("json.dumps(sessions, sort_keys=True)", "json.dumps(answer, sort_keys=True, ")
NO_NUMBERS = (math.nan, math.inf, -math.inf)


def strictly(text: str) -> Any:
    """What a reader by the standard makes of a text."""

    def refuse(name: str) -> None:
        raise ValueError(f"{name} is no JSON")

    return json.loads(text, parse_constant=refuse)


@pytest.mark.parametrize("value", [*NO_NUMBERS, np.float64("nan"), np.float32("inf")])
def test_what_is_no_number_is_null(value: float, tmp_path: Path) -> None:
    """Law: at any depth, in every file that is written, and on standard output."""
    record = {"a": [1.0, {"b": (value, [value])}], "c": value}
    wanted = {"a": [1.0, {"b": [None, [None]]}], "c": None}
    assert strictly(as_json(record)) == wanted
    write_record(tmp_path / "result.json", record)
    assert strictly((tmp_path / "result.json").read_text()) == wanted


def test_numbers_stay_what_they_are() -> None:
    record = {"a": 1e-300, "b": 1.7e308, "c": 0.1 + 0.2, "d": True, "e": None, "f": 3, "g": np.float64(2.5)}
    assert strictly(as_json(record)) == record


def test_no_result_is_written_past_that_door() -> None:
    """Law: only schemas, names and seals are made JSON elsewhere."""
    doors = []
    for package in ("ident", "plan"):
        for path in (ROOT / package).rglob("*.py"):
            for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1):
                if "json.dump" in line and not line.lstrip().startswith("#"):
                    doors.append((path.name, number, line.strip()))
    assert all(any(known in line for known in ALLOWED) for _, _, line in doors), doors


def test_what_earlier_versions_wrote_counts_as_missing(tmp_path: Path) -> None:
    (tmp_path / "old.json").write_text('{"a": NaN, "b": [-Infinity, 1]}')
    assert read_json(tmp_path / "old.json", "") == {"a": None, "b": [None, 1]}


@pytest.mark.parametrize("figure", [1e308, -1e308, 1e13, math.nan, math.inf])
def test_no_figure_beyond_any_arm_is_patched(figure: float, tm5: ArmModel, tmp_path: Path) -> None:
    """Law: of an effect, of the baseline and of a link, each is refused by name, and nothing is written."""
    path = tmp_path / "diagnosis.json"
    write_diagnosis(path, tm5, "stribeck_friction", "payload")
    record = json.loads(path.read_text())
    finding = next(iter(record["findings"][0]["parameters"].values()))
    for place in (finding, record["baseline"]["joint_1"], record["baseline"]["joint_2"]["link_change"]):
        for key, good in [(key, value) for key, value in place.items() if isinstance(value, float)]:
            place[key] = figure
            with pytest.raises(InputError, match="damaged"):
                Diagnosed.of_record(record)
            place[key] = good
    Diagnosed.of_record(record)


def test_a_figure_is_a_number_of_this_world() -> None:
    assert require_finite(1e9, "a stiffness") == 1e9
    for value in (True, "1", None, *NO_NUMBERS, 1e308):
        with pytest.raises(ValueError, match="a stiffness"):
            require_finite(value, "a stiffness")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('{"a": 1, "a": 2}', "the key 'a' stands twice"),
        ('{"b": [{"mass": 1, "x": 0, "mass": 9}]}', "the key 'mass' stands twice"),
        ('{"a": 1e999}', "beyond double precision"),
        ('{"a": [-1e400]}', "beyond double precision"),
        ('{"a": 123456789012345678901234}', "more than 64 bit"),
        ('{"a": "\\ud800"}', "half of a character"),
        ('{"a": [{"\\udfff x": 1}]}', "half of a character"),
    ],
)
def test_json_that_two_readers_would_read_otherwise_is_refused(text: str, words: str, tmp_path: Path) -> None:
    """Law: of a key that stands twice readers take the first or the last; neither is taken here."""
    (tmp_path / "a.json").write_text(text)
    with pytest.raises(InputError, match=words):
        read_json(tmp_path / "a.json", "")
