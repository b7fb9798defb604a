"""Tasks run in other processes; a worker that dies costs nothing but time."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from errands import Errand, run_errand

from ident.errors import InputError
from ident.workers import run_tasks


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


def test_tasks_run_in_other_processes(tmp_path: Path) -> None:
    done: list[str] = []
    run_tasks(run_errand, errands(tmp_path), workers=1, done=done.append)
    assert sorted(done) == [f"task_{i}" for i in range(5)]
    pids = {path.read_text().strip() for path in tmp_path.glob("*.txt")}
    assert str(os.getpid()) not in pids


def test_a_killed_process_loses_no_task_and_repeats_none(tmp_path: Path) -> None:
    """Tasks done before the death are not run again; the others are, and each is told once."""
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
    monkeypatch.setattr("ident.workers.PATIENCE_S", 0.5)
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
    assert parent.stdout is not None
    worker = int(parent.stdout.readline())
    parent.kill()
    parent.wait()
    # The pipe closes when the last process that holds it has ended.
    assert parent.stdout.read() == ""
    assert not Path(f"/proc/{worker}/cmdline").exists() or not Path(f"/proc/{worker}/cmdline").read_bytes()
