"""The Python door of `ident`: what a command does, a few lines do; tables in memory are as good as files."""

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

import ident
import plan
from ident import Effect, plant
from ident.errors import InputError
from ident.recordings.load import gather_sources, load_recording, read_frame
from ident.robot.names import data_path

E1 = Path(data_path("logs/tm5_900")) / "E1"
RUNS = sorted(E1.glob("*.parquet"))


@pytest.fixture(scope="module")
def columns() -> dict[str, np.ndarray]:
    """One run as a mapping of arrays."""
    table = pq.read_table(RUNS[0])
    return {name: table.column(name).to_numpy() for name in table.column_names}


@pytest.mark.parametrize("package", [ident, plan])
def test_every_public_name_is_there_and_none_else(package: Any) -> None:
    assert all(getattr(package, name) is not None for name in package.__all__)
    assert sorted(package.__all__) == dir(package)
    with pytest.raises(AttributeError, match="it has: "):
        _ = package.nothing_of_the_kind


def test_a_table_in_memory_is_the_same_recording_as_its_file(columns: dict[str, np.ndarray]) -> None:
    file = load_recording(RUNS[0])
    for frame in (columns, pq.read_table(RUNS[0])):
        run = read_frame(frame)
        assert run.joints == file.joints
        assert np.array_equal(run.time, file.time)
        assert all(np.array_equal(run.channels()[name], values) for name, values in file.channels().items())


@pytest.mark.parametrize("library", ["pandas", "polars"])
def test_frames_of_other_libraries_are_the_same_too(library: str, columns: dict[str, np.ndarray]) -> None:
    frames = pytest.importorskip(library)
    assert np.array_equal(read_frame(frames.DataFrame(columns)).effort, load_recording(RUNS[0]).effort)


def test_tables_that_follow_each_other_are_the_runs_of_one_session(columns: dict[str, np.ndarray]) -> None:
    found = gather_sources([columns, columns, E1])
    assert [len(one.runs) if isinstance(one, ident.Session) else one for one in found] == [2, E1]


def _spoilt(columns: dict[str, np.ndarray], **changes: Any) -> dict[str, Any]:
    changed = {**columns, **{name.replace("__", "/"): values for name, values in changes.items()}}
    return {name: values for name, values in changed.items() if values is not None}


BAD: dict[str, tuple[Callable[[dict[str, np.ndarray]], Any], str]] = {
    "a number": (lambda columns: 3, "a int holds no recording"),
    "nothing": (lambda columns: [], "holds no recording"),
    "no such file": (lambda columns: "nowhere", "no such file or folder"),
    "no effort": (lambda columns: _spoilt(columns, joint_1__effort=None), "missing column joint_1/effort"),
    "no time": (lambda columns: _spoilt(columns, time=None), "missing column time"),
    "no joint": (lambda columns: {"time": columns["time"]}, "no column <joint>/position"),
    "lengths": (lambda columns: _spoilt(columns, time=columns["time"][:-1]), "samples and"),
    "text": (lambda columns: _spoilt(columns, joint_1__effort=["x"] * len(columns["time"])), "holds no numbers"),
    "stacked": (lambda columns: _spoilt(columns, time=columns["time"][:, None]), "has 2 dimensions"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_recordings_are_one_line_that_says_what_to_do(case: str, columns: dict[str, np.ndarray]) -> None:
    make, seen = BAD[case]
    with pytest.raises(InputError) as found:
        ident.inspect(make(columns), "tm5-900")
    error = found.value
    assert seen in error.what
    assert error.where
    assert error.remedy
    assert "\n" not in str(error)


def test_joints_that_the_robot_lacks_are_told(columns: dict[str, np.ndarray]) -> None:
    foreign = {name.replace("joint_", "wheel").replace("/", "_a/"): values for name, values in columns.items()}
    with pytest.raises(InputError) as found:
        ident.inspect(foreign, "tm5-900")
    assert found.value.remedy


def test_other_arguments_of_a_wrong_type_are_told_alike(columns: dict[str, np.ndarray]) -> None:
    asked: list[Callable[[], object]] = [
        lambda: ident.inspect(columns, 3),  # type: ignore[arg-type]
        lambda: ident.diagnose(columns, "tm5-900", model=3),  # type: ignore[arg-type]
        lambda: ident.diagnose(columns, "tm5-900", catalogue=[3]),  # type: ignore[list-item]
        lambda: ident.evaluate(columns, 3),  # type: ignore[arg-type]
        lambda: ident.patch(3, "tm5-900", "nowhere"),  # type: ignore[arg-type]
        lambda: ident.simulate(effect="payload"),
        lambda: ident.blind(1, speed=3),
        lambda: plan.solve(3),  # type: ignore[arg-type]
    ]
    for call in asked:
        with pytest.raises(InputError) as found:
            call()
        assert found.value.remedy


def test_arrays_of_the_wrong_shape_make_no_recording() -> None:
    with pytest.raises(InputError, match="has shape"):
        ident.Recording("run", ("a", "b"), np.arange(3.0), np.zeros((3, 2)), np.zeros((3, 1)))


def test_a_diagnosis_of_tables_is_that_of_their_file(columns: dict[str, np.ndarray], tmp_path: Path) -> None:
    """One run is too little for a verdict, but comes to the same words; the origin says where it is from."""
    found = ident.diagnose(columns, "tm5-900")
    command = [
        sys.executable,
        "-c",
        "from ident.cli.app import main; main()",
        "diagnose",
        str(RUNS[0]),
        "--robot",
        "tm5-900",
    ]
    subprocess.run([*command, "--json", str(tmp_path / "why.json")], check=True, capture_output=True)
    written = json.loads((tmp_path / "why.json").read_text())
    assert found.verdict == written["verdict"]
    assert found.session == written["session"]
    (stamp,) = written["provenance"]["sessions"]
    assert stamp["path"] == str(RUNS[0])
    assert written["provenance"]["command"] == found.provenance.command == "ident diagnose"
    assert [stamp["first"], stamp["last"]] == [columns["time"][0], columns["time"][-1]]


SESSION = data_path("logs/tm5_900/E1")


class Magnet(Effect):
    """tau = A sin 3q: what nothing of the catalogue is at this joint."""

    id = "magnet"
    figures = ("amplitude_Nm",)
    prior = ("2 coulomb",)

    def columns(self, session: Any, joint: int, variant: Any) -> list[Any]:
        return [np.sin(3 * run.motion.q[:, [joint]]) for run in session.runs]


def test_what_is_planted_is_found_at_its_joint_and_as_large() -> None:
    planted = plant(Magnet(), "joint_2", SESSION, coefficients=[6.0])
    assert planted.found, planted
    assert planted.joint == "joint_2"
    (finding,) = (one for one in planted.diagnosis.findings if one.effect == "magnet")
    assert finding.estimate.parameters["amplitude_Nm"].value == pytest.approx(6.0, rel=0.15)


def test_nothing_planted_is_not_found() -> None:
    assert not plant(Magnet(), "joint_2", SESSION, coefficients=[0.0]).found


def test_a_joint_that_is_not_there_is_one_line() -> None:
    with pytest.raises(InputError, match="joint_2"):
        plant(Magnet(), "elbow", SESSION)


SEALED = data_path("logs/tm5_900/sealed_2")


@pytest.fixture(scope="module")
def found() -> ident.Diagnosis:
    return ident.diagnose(SEALED, "tm5-900")


def test_a_diagnosis_from_its_file_is_shown_as_it_was(found: ident.Diagnosis, tmp_path: Path) -> None:
    found.save(tmp_path / "why.json")
    loaded = ident.Diagnosis.load(tmp_path / "why.json")
    assert loaded.verdict == found.verdict
    assert loaded.summary() == found.summary()
    assert loaded._repr_html_() == found._repr_html_()
    heights = [[bar.get_height() for bar in one.plot().axes[0].patches] for one in (found, loaded)]
    assert heights[0] == heights[1]


def test_a_notebook_shows_the_page_and_the_page_alone(found: ident.Diagnosis) -> None:
    html = found._repr_html_()
    assert html.startswith("<iframe srcdoc=")
    assert "&lt;section id=&quot;verdict&quot;" in html


def test_what_python_echoes_is_no_longer_than_a_screen(found: ident.Diagnosis) -> None:
    opened = ident.open_sessions(SEALED, "tm5-900")
    session = ident.simulate(runs=1, duration=2.0)
    for one in (
        found,
        ident.inspect(SEALED, "tm5-900"),
        opened,
        opened.arm,
        opened.motions[0],
        session,
        session.runs[0],
    ):
        lines = repr(one).splitlines()
        assert len(lines) <= 24
        assert sum(-(-len(line) // 80) for line in lines) <= 50
        assert type(one).__name__ in lines[0]
        assert "array(" not in repr(one)


def test_a_plot_has_the_colours_of_the_page(found: ident.Diagnosis) -> None:
    page = found._repr_html_()
    axes = found.plot().axes[0]
    for bars in axes.containers:
        red, green, blue, _ = np.round(255 * np.array(bars.patches[0].get_facecolor())).astype(int)
        assert f"background:#{red:02x}{green:02x}{blue:02x}" in page


def test_a_loaded_diagnosis_has_the_parts_of_the_one_that_was_saved(found: ident.Diagnosis, tmp_path: Path) -> None:
    """Law: whoever reads the file next week asks it as the diagnosis itself."""
    found.save(tmp_path / "why.json")
    loaded = ident.Diagnosis.load(tmp_path / "why.json")
    for name in ("robot", "joints", "verdict", "session", "telemetry"):
        assert getattr(loaded, name) == getattr(found, name), name
    assert len(loaded.findings) == len(found.findings) > 0
    for saved, own in zip(loaded.findings, found.findings, strict=True):
        for name in ("effect", "joints", "probability", "rivals", "rms_before", "rms_after", "shrink", "action"):
            assert getattr(saved, name) == getattr(own, name), name
        assert {name: vars(one) for name, one in saved.parameters.items()} == {
            name: vars(one) for name, one in own.parameters.items()
        }
    assert [vars(place) for place in loaded.where] == [vars(place) for place in found.where]
    assert loaded.heldout is not None
    assert loaded.heldout.shrink == found.heldout.shrink
    assert loaded.to_dict() == json.loads(json.dumps(found.to_dict()))
    assert loaded.summary() == found.summary()


def test_diagnose_says_what_it_takes() -> None:
    """Law: an editor shows every option by its name; they are those of the command."""
    from dataclasses import fields
    from inspect import signature

    from ident.command_options import ComparisonOptions, DiagnoseOptions

    pairs = ((ident.diagnose, DiagnoseOptions, 2), (ident.compare, ComparisonOptions, 3))
    for function, options, places in pairs:
        taken = signature(function).parameters
        assert set(list(taken)[places:]) == {one.name for one in fields(options)}
        assert all(taken[one.name].default == one.default for one in fields(options))
