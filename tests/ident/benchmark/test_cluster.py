"""A cluster that has no worker, or loses the last one: the command ends with one line, and what is done is done."""

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from errands import Errand, run_errand

from ident import cluster, workers
from ident.cluster import Attendance, no_workers_patience
from ident.errors import InputError
from ident.workers import run_tasks

distributed = pytest.importorskip("distributed")


@pytest.fixture(scope="module")
def scheduler() -> Iterator[str]:
    """Address of a scheduler without a worker."""
    with distributed.LocalCluster(n_workers=0, host="127.0.0.1", dashboard_address=None, silence_logs=50) as without:
        yield without.scheduler_address


@pytest.fixture(autouse=True)
def impatience(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cluster, "NO_WORKERS_S", 0.5)
    monkeypatch.setattr(cluster, "ASK_S", 0.1)


def begin_worker(scheduler: str) -> subprocess.Popen[bytes]:
    """A worker that nobody starts anew."""
    command = [sys.executable, "-m", "distributed.cli.dask_worker", scheduler, "--no-nanny"]
    command += ["--nthreads", "1", "--no-dashboard"]
    paths = os.pathsep.join([*sys.path, str(Path(__file__).parent)])
    return subprocess.Popen(command, env={**os.environ, "PYTHONPATH": paths}, stderr=subprocess.DEVNULL)


def test_a_cluster_without_a_worker_is_told(tmp_path: Path, scheduler: str) -> None:
    """Law: tasks that nobody can take end in one line that names the scheduler and the remedy."""
    with pytest.raises(InputError, match=f"{scheduler} has no worker.* start") as told:
        run_tasks(run_errand, [Errand(tmp_path / "task.txt")], scheduler=scheduler)
    assert len(str(told.value).splitlines()) == 1
    assert not list(tmp_path.iterdir())


def test_the_last_worker_may_be_lost(tmp_path: Path, scheduler: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Law: what was done before is reported and stays; the rest is neither done nor half-written."""
    with begin_worker(scheduler) as worker:
        with distributed.Client(scheduler, set_as_default=False) as client:
            client.wait_for_workers(1, timeout=60)
        tasks = [Errand(tmp_path / "first.txt"), Errand(tmp_path / "last.txt", deadly=True)]
        done: list[str] = []
        run_tasks(run_errand, tasks[:1], scheduler=scheduler, done=done.append)
        with pytest.raises(InputError, match="has no worker"):
            run_tasks(run_errand, tasks[1:], scheduler=scheduler, done=done.append)
        assert worker.wait() != 0
    assert done == ["first"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["first.txt", "last.died"]


def test_processes_that_die_again_and_again_are_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(workers, "MOST_LOSSES", 1)
    with pytest.raises(InputError, match="--workers: 1 task lost a process 1 times"):
        run_tasks(run_errand, [Errand(tmp_path / "task.txt", deadly=True)])
    assert [path.name for path in tmp_path.iterdir()] == ["task.died"]


class SilentClient:
    """A client whose scheduler gives no answer."""

    def nthreads(self, **_: Any) -> None:
        raise TimeoutError


def test_a_scheduler_that_gives_no_answer_is_told() -> None:
    attendance = Attendance(SilentClient(), "tcp://nowhere:1", 0.0)
    attendance._last_question -= 1.0
    with pytest.raises(InputError, match="tcp://nowhere:1 gives no answer"):
        attendance.look()


def test_the_users_settings_of_dask_hold() -> None:
    import dask

    assert no_workers_patience() == 0.5
    with dask.config.set({cluster.NO_WORKERS_SETTING: "2 minutes"}):
        assert no_workers_patience() == 120.0
