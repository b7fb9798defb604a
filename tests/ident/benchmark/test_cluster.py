"""A cluster that has no worker, or loses the last one: the command ends with one line, and what is done is done."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from errands import Errand, run_errand

from ident import cluster, workers
from ident.cluster import Attendance, no_workers_patience, silence_patience
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


def test_a_worker_that_is_stopped_is_told(tmp_path: Path, scheduler: str) -> None:
    """Law: a worker that is stopped and not ended counts as silent, not as one that works."""
    with begin_worker(scheduler) as worker:
        try:
            with distributed.Client(scheduler, set_as_default=False) as client:
                client.wait_for_workers(1, timeout=60)
            worker.send_signal(signal.SIGSTOP)
            with pytest.raises(InputError, match=f"{scheduler} has no worker that answers") as told:
                run_tasks(run_errand, [Errand(tmp_path / "task.txt")], scheduler=scheduler)
        finally:
            worker.kill()
    assert len(str(told.value).splitlines()) == 1
    assert not list(tmp_path.iterdir())


class MadeUpClient:
    """A client of a scheduler that says what it is told to: when it heard of whom, and who holds tasks."""

    def __init__(self, heard: dict[str, float] | None, held: dict[str, list[str]]) -> None:
        self.heard, self.held = heard, held
        self.scheduler = self

    def identity(self) -> dict[str, Any]:
        if self.heard is None:
            raise TimeoutError
        return {"workers": {worker: {"last_seen": last} for worker, last in self.heard.items()}}

    def processing(self) -> dict[str, list[str]]:
        return self.held

    def sync(self, asked: Callable[[], Any], **_: Any) -> Any:
        return asked()


def test_one_silent_worker_among_others_is_told_where_it_holds_tasks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Law: one that holds nothing may be silent for as long as it likes; what is heard of does not end the wait."""
    monkeypatch.setattr(cluster, "ASK_S", 0.0)
    client = MadeUpClient({"stopped": 1.0, "awake": 1.0}, {"stopped": [], "awake": ["task"]})
    attendance = Attendance(client, "tcp://made.up:1", 60.0, 0.01)
    attendance.look()
    time.sleep(0.02)
    client.heard = {"stopped": 1.0, "awake": 2.0}
    attendance.look()
    client.held = {"stopped": ["task"], "awake": []}
    with pytest.raises(InputError, match=r"has a worker, stopped, that holds tasks and is silent.*; end it, or wake"):
        attendance.look()


def test_dask_s_own_remedy_goes_before() -> None:
    """Law: where Dask gives a silent worker's tasks to others, that is waited for."""
    import dask

    with dask.config.set({cluster.TIME_TO_LIVE_SETTING: "1 minute"}):
        assert silence_patience(0.5) > 120.0
    with dask.config.set({cluster.TIME_TO_LIVE_SETTING: None}):
        assert silence_patience(0.5) == 0.5


def test_a_scheduler_that_gives_no_answer_is_told() -> None:
    attendance = Attendance(MadeUpClient(None, {}), "tcp://nowhere:1", 0.0, 0.0)
    attendance._last_question -= 1.0
    with pytest.raises(InputError, match="tcp://nowhere:1 gives no answer"):
        attendance.look()


def test_the_users_settings_of_dask_hold() -> None:
    import dask

    assert no_workers_patience() == 0.5
    with dask.config.set({cluster.NO_WORKERS_SETTING: "2 minutes"}):
        assert no_workers_patience() == 120.0
