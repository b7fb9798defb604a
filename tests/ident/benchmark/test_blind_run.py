"""A whole small check: sealed first, diagnosed apart, resumed, scored."""

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from errands import Errand, run_errand

from ident.benchmark.cases import MakeTask, Slot
from ident.benchmark.run import BlindOptions, BlindReport, run_blind
from ident.errors import InputError
from ident.simulation.request import open_envelope
from ident.simulation.simulate import SimulationOptions
from ident.workers import run_tasks

SEED = 12
OPTIONS = BlindOptions(cases=2, seed=SEED, mix={"single": 1.0, "healthy": 1.0}, runs=6, duration=4.0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("blind") / "check"


@pytest.fixture(scope="module")
def events(folder: Path) -> list[str]:
    """What the check said and did, in order."""
    seen: list[str] = []
    run_blind(at(folder), seen.append, lambda step, done, total: seen.append(f"{step} {done}/{total}"))
    return seen


@pytest.fixture(scope="module")
def record(folder: Path, events: list[str]) -> dict:  # type: ignore[type-arg]
    loaded: dict = json.loads((folder / "blind.json").read_text())  # type: ignore[type-arg]
    return loaded


def key(name: str, seed: int) -> bytes:
    return MakeTask(Slot(name, ""), 0, seed, SimulationOptions(), Path(), Path(), "").key


def at(folder: Path, **changes: object) -> BlindOptions:
    return BlindOptions(**{**vars(OPTIONS), "out": folder, **changes})


def test_all_seals_are_told_before_the_first_diagnosis(events: list[str], record: dict) -> None:  # type: ignore[type-arg]
    seals = [i for i, line in enumerate(events) if "sha256" in line]
    diagnoses = [i for i, line in enumerate(events) if line.startswith("diagnosing")]
    assert len(seals) == len(diagnoses) == 2
    assert max(seals) < min(diagnoses)
    assert all(any(seal in events[i] for i in seals) for seal in record["seals"].values())


def test_no_case_fails_and_every_score_has_its_interval(record: dict) -> None:  # type: ignore[type-arg]
    assert record["failed"] == 0
    assert record["cases"] == 2
    assert record["run"]["drawn_again"] in (0, 1, 2)
    assert {one["kind"] for one in record["outcomes"]} == {"single", "healthy"}
    assert record["intervals"].keys() - {"efficiency"} == record["scores"].keys() - {"efficiency"}
    assert record["baselines"].keys() == {"bic_forward"}


def test_the_recordings_lie_apart_from_the_answers(folder: Path, events: list[str]) -> None:
    for session in (folder / "sessions").iterdir():
        assert [path.name for path in session.glob("*.json")] in ([], [".armgap.json"])
        assert "effect" not in (session / "session.toml").read_text()
    for sealed in (folder / "sealed").iterdir():
        answer = open_envelope(sealed, key(sealed.name, SEED))
        assert all(one.effect not in (sealed / "envelope.json").read_text() for one in answer.effects)
        with pytest.raises(InputError):
            open_envelope(sealed, key(sealed.name, SEED + 1))


def test_the_diagnosing_process_does_not_know_the_plant() -> None:
    code = "import sys, ident.benchmark.examining; print([m for m in sys.modules if m.startswith('ident.simulation')])"
    seen = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert seen.stdout.strip() == "[]"


def test_a_stopped_check_goes_on_where_it_was(folder: Path, record: dict) -> None:  # type: ignore[type-arg]
    """What is finished is not done again; what is missing is, and no case counts twice."""
    kept, lost = (folder / "results" / f"case_00{i}.json" for i in (0, 1))
    time = kept.stat().st_mtime_ns
    before = json.loads(lost.read_text())
    lost.unlink()
    steps: list[str] = []
    report: BlindReport = run_blind(at(folder, seed=None), progress=lambda step, *_: steps.append(step))
    assert steps == ["diagnosing"]
    assert kept.stat().st_mtime_ns == time
    assert json.loads(lost.read_text())["diagnosis"] == before["diagnosis"]
    assert len(report.outcomes) == 2
    assert report.seals == record["seals"]


def test_another_check_in_the_same_folder_is_refused(folder: Path, events: list[str]) -> None:
    for changes in ({"cases": 3}, {"seed": SEED + 1}):
        with pytest.raises(InputError, match="another check"):
            run_blind(at(folder, **changes))


def test_a_folder_that_holds_something_else_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "thesis.txt").write_text("mine")
    with pytest.raises(InputError, match="something else"):
        run_blind(at(tmp_path))
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.txt"]


def test_a_check_that_is_done_goes_on_with_the_edit_test(folder: Path, record: dict) -> None:  # type: ignore[type-arg]
    """Only single effects are edited, each once; where nothing true was named there is a reason instead of a ratio."""
    steps: list[str] = []
    report = run_blind(at(folder, edit=True), progress=lambda step, *_: steps.append(step))
    assert steps == ["editing"]
    (single,) = [one for one in report.outcomes if one.kind == "single"]
    written = json.loads((folder / "edits" / f"{single.name}.json").read_text())
    assert ("why" in written) == (single.edit is None) == (not any(single.right))
    run_blind(at(folder, edit=True), progress=lambda step, *_: steps.append(step))
    assert steps == ["editing"]


@pytest.fixture(scope="module")
def scheduler() -> Iterator[str]:
    """Address of a Dask scheduler with two workers of one thread each."""
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, host="127.0.0.1", dashboard_address=None, silence_logs=50
    ) as cluster:
        yield cluster.scheduler_address


def errands(folder: Path, deadly: int = -1, count: int = 5) -> list[Errand]:
    return [Errand(folder / f"task_{i}.txt", deadly=i == deadly) for i in range(count)]


def test_a_killed_process_loses_no_task_and_repeats_none(tmp_path: Path) -> None:
    """Tasks done before the death are not run again; the others are, and each is reported once."""
    done: list[str] = []
    run_tasks(run_errand, errands(tmp_path, deadly=2), workers=1, done=done.append)
    assert (tmp_path / "task_2.died").exists()
    assert sorted(done) == [f"task_{i}" for i in range(5)]
    for path in tmp_path.glob("*.txt"):
        assert len(path.read_text().split()) == 1, path.name


def test_a_killed_worker_of_a_cluster_loses_no_task(tmp_path: Path, scheduler: str) -> None:
    done: list[str] = []
    run_tasks(run_errand, errands(tmp_path, deadly=1), scheduler=scheduler, done=done.append)
    assert (tmp_path / "task_1.died").exists()
    assert sorted(done) == [f"task_{i}" for i in range(5)]
    assert len(list(tmp_path.glob("*.txt"))) == 5


def test_no_scheduler_at_the_address_is_the_users_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ident.cluster.PATIENCE_S", 0.5)
    with pytest.raises(InputError, match="--scheduler"):
        run_tasks(run_errand, [Errand(Path("never"))], scheduler="tcp://127.0.0.1:1")


PARENT = """
import os, sys, time
from ident.workers import end_with
if not os.fork():
    end_with(os.getppid())
    print(os.getpid(), flush=True)
    time.sleep(600)
time.sleep(600)
"""


def test_a_worker_does_not_outlive_its_parent() -> None:
    """Law: a check that is killed outright leaves no process behind, whatever its worker is busy with."""
    parent = subprocess.Popen([sys.executable, "-c", PARENT], stdout=subprocess.PIPE, text=True)
    worker = int(parent.stdout.readline())
    parent.kill()
    parent.wait()
    # The pipe closes when the last process that holds it has ended.
    assert parent.stdout.read() == ""
    assert not Path(f"/proc/{worker}/cmdline").exists() or not Path(f"/proc/{worker}/cmdline").read_bytes()
