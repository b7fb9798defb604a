"""A recording is known again in whatever form it is written; a motion that is made again is another recording."""

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv as pacsv
import pyarrow.parquet as pq
import pytest

from ident.api.exporting import verify
from ident.checks.inspection import inspect_sessions
from ident.command_options import FitOptions
from ident.fitting.fit import fit_hybrid
from ident.model.hybrid import HybridModel
from ident.recordings.load import load_session
from ident.recordings.recording import Recording
from ident.recordings.series import SearchedRun, Series
from ident.robot.arm import ArmModel
from ident.robot.names import data_path
from ident.sessions import open_sessions

E1 = Path(data_path("logs/tm5_900")) / "E1"
LIMITS = "[torque_rmse_Nm]\ntotal = 1e6\n"
Table = pa.Table


def per_column(table: Table, change: Callable[[np.ndarray], np.ndarray]) -> Table:
    return pa.table({name: change(table[name].to_numpy()) for name in table.column_names})


def later(table: Table) -> Table:
    return table.set_column(0, "time", pa.array(table["time"].to_numpy() + 1000.0))


def digits(table: Table) -> Table:
    return per_column(table, lambda values: np.round(values, 5))


def half(table: Table) -> Table:
    return table.take(np.arange(0, len(table), 2))


# How the recordings of a fit may be written again.
FORMS: dict[str, Callable[[Table], Table]] = {
    "as they are": lambda table: table,
    "five decimals": digits,
    "shifted in time": later,
    "half the rate": half,
    "the other half": lambda table: half(table.slice(1)),
    "a third of the rate": lambda table: table.take(np.arange(0, len(table), 3)),
    "twenty samples cut": lambda table: table.slice(20),
    "float32": lambda table: per_column(table, lambda values: values.astype(np.float32)),
    "columns in another order": lambda table: table.select([table.column_names[0], *table.column_names[:0:-1]]),
    "the second half of it": lambda table: table.slice(len(table) // 2),
    "all of that": lambda table: half(later(digits(table.slice(20)))),
}


DAMAGED = (
    {},
    {"joints": ["a"], "moments": "?"},
    {"joints": ["a"], "moments": "AAAA"},
    {"joints": [], "moments": ""},
)


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    opened = open_sessions([E1], ArmModel.load("tm5-900"))
    fit = fit_hybrid(opened.motions, opened.arm, FitOptions(inertia="nominal", net="none"), opened.data_records())
    folder = tmp_path_factory.mktemp("model") / "model"
    fit.model.save(folder)
    return folder


@pytest.fixture
def limits(tmp_path: Path) -> Path:
    (tmp_path / "limits.toml").write_text(LIMITS)
    return tmp_path / "limits.toml"


@pytest.mark.parametrize("form", FORMS)
def test_a_gate_knows_its_own_training_data(form: str, model: Path, limits: Path, tmp_path: Path) -> None:
    """Law: whatever is done to the files, recordings of the fit are in sample, and the gate is not passed."""
    written = tmp_path / "session"
    written.mkdir()
    for file in E1.glob("*.parquet"):
        pacsv.write_csv(FORMS[form](pq.read_table(file)), written / f"{file.stem}.csv")
    (written / "session.toml").write_text((E1 / "session.toml").read_text())
    found = verify(model, written, limits)
    assert found.in_sample
    assert not found.passed


@pytest.mark.parametrize("name", ["E2", "T1", "T2", "sealed_1", "payload_516g"])
def test_other_recordings_pass(name: str, model: Path, limits: Path) -> None:
    """Law: the same motions recorded again, on another day or with a payload, are held out."""
    found = verify(model, E1.with_name(name), limits)
    assert not found.in_sample
    assert found.passed


def runs() -> Iterator[Recording]:
    yield from load_session(E1).runs


@pytest.mark.parametrize("thinned", [1, 2])
def test_runs_given_twice_are_told(thinned: int) -> None:
    """Law: within a session, and of two, a run that comes again a thousand seconds later is no other run."""
    first = load_session(E1)
    again = [
        run.at(slice(None, None, thinned), name=f"{run.name}_again").replace(time=run.time[::thinned] + 1000.0)
        for run in first.runs
    ]
    arm = ArmModel.load("tm5-900")
    session = first.replace(runs=(*first.runs, *again))
    for sessions in ([session], [first, first.replace(name="later", runs=tuple(again))]):
        (issue,) = inspect_sessions(sessions, arm)[0].find("repeated_session")
        assert issue.severity == "fatal"
        assert "once more, and 4 more" in issue.evidence


def test_motions_made_again_are_other_runs() -> None:
    """Law: sessions of the shipped arm, most of them of the same motions, hold no run twice."""
    sessions = [load_session(folder) for folder in sorted(E1.parent.iterdir()) if folder.is_dir()]
    report = inspect_sessions(sessions, ArmModel.load("tm5-900"))[0]
    assert report.find("repeated_session") == ()


def made_up(noise: float, seed: int = 0, joints: int = 3) -> Recording:
    """A smooth motion under torque with noise."""
    rng, time = np.random.default_rng(seed), np.arange(0.0, 20.0, 0.01)
    position = np.sin(np.outer(time, 0.3 + 0.2 * np.arange(joints)))
    return Recording(
        "run", tuple("abcdefg"[:joints]), time, position, 5 * position + noise * rng.normal(size=position.shape)
    )


def test_noise_tells_a_motion_made_again() -> None:
    known = Series.of(made_up(0.05))
    assert known is not None
    assert known.is_in(SearchedRun(made_up(0.05)))
    assert not known.is_in(SearchedRun(made_up(0.05, seed=1)))
    assert not known.is_in(SearchedRun(made_up(0.05, joints=2)))


def test_a_run_at_rest_says_nothing() -> None:
    """Law: an arm that stands still twice is no copy."""
    run = made_up(0.0)
    still = run.replace(position=np.ones_like(run.position), effort=np.ones_like(run.effort))
    assert Series.of(still) is None


@pytest.mark.parametrize("rows", [32, 33, 60, 127, 200])
def test_a_run_that_is_logged_every_minute_is_known(rows: int) -> None:
    """Law: its duration would have more moments than it has rows; it is told from others all the same."""
    run = made_up(0.0)
    slow = Recording("slow", run.joints, 60.0 * np.arange(rows), position=run.position[:rows], effort=run.effort[:rows])
    series = Series.of(slow)
    assert series is not None
    assert series.is_in(SearchedRun(slow))


def test_records_give_the_same_moments() -> None:
    for run in runs():
        known = Series.of(run)
        assert known is not None
        read = Series.from_dict(known.to_dict())
        assert read.joints == known.joints
        np.testing.assert_allclose(read.moments, known.moments, rtol=1e-6, atol=1e-6)
        assert read.found_in(SearchedRun(run)) == len(read.moments)
    for damaged in DAMAGED:
        with pytest.raises((KeyError, ValueError)):
            Series.from_dict(damaged)


def test_a_model_without_series_is_read(model: Path, limits: Path) -> None:
    """Law: models of earlier versions know their files by hashes alone."""
    loaded = HybridModel.load(model)
    for data in loaded.provenance["data"]:
        data.pop("series")
    assert verify(loaded, E1, limits).in_sample


def test_an_absurd_run_is_searched_without_harm() -> None:
    run = made_up(0.05)
    wild = run.position.copy()
    wild[::7] = 1e300
    wild[::11] = np.nan
    known = Series.of(run)
    assert known is not None
    assert known.is_in(SearchedRun(run.replace(position=wild)))
    assert Series.of(run.replace(position=wild)) is not None
