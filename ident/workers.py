"""Runs tasks in other processes: on this machine by joblib, or on a Dask cluster.

A task writes its own result file, so that nothing is lost with the process that asked for it; a task whose worker
dies is given to another.
"""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import CancelledError, as_completed
from concurrent.futures.process import BrokenProcessPool
from typing import Any, TypeVar

from joblib.externals.loky import ProcessPoolExecutor

from ident.errors import InputError, first_line
from ident.own_settings import keep_own_settings

T = TypeVar("T")
# How often a task may lose its worker before it is given up.
MOST_LOSSES = 4
# Processes do the work side by side; threads of many small parallel loops would only wait for each other.
THREAD_COUNTS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
# How long the scheduler may take to answer [s].
PATIENCE_S = 10.0
# How often a worker looks whether its parent is still there [s].
WATCH_S = 1.0


class LostWorker(RuntimeError):
    """Workers died again and again."""


def run_tasks(
    function: Callable[[T], str],
    tasks: Sequence[T],
    workers: int = 1,
    scheduler: str | None = None,
    done: Callable[[str], None] = lambda name: None,
) -> None:
    """Runs all tasks, in any order and in fresh processes, which know nothing of earlier tasks of another kind.

    Args:
        function: Importable; returns the name of its task.
        tasks: Its arguments.
        workers: Processes on this machine.
        scheduler: Address of a Dask scheduler instead; its workers must see the same folders.
        done: Told the name of each finished task.

    Raises:
        InputError: The scheduler can't be reached.
        LostWorker: Workers die again and again.
    """
    if not tasks:
        return
    if scheduler is not None:
        _run_on_cluster(function, tasks, scheduler, done)
        return
    waiting = dict(enumerate(tasks))
    for _ in range(MOST_LOSSES):
        workers = min(workers, len(waiting))
        executor = ProcessPoolExecutor(
            workers, env=dict.fromkeys(THREAD_COUNTS, "1"), initializer=end_with, initargs=(os.getpid(),)
        )
        try:
            futures = {executor.submit(function, task): i for i, task in waiting.items()}
            for future in as_completed(futures):
                try:
                    name = future.result()
                except BrokenProcessPool:
                    continue  # its task stays in the waiting list
                del waiting[futures[future]]
                done(name)
        except BaseException:  # Ctrl-C too: nobody waits for the tasks under way
            executor.shutdown(wait=False, kill_workers=True)
            raise
        executor.shutdown(wait=True)
        if not waiting:
            return
    raise LostWorker(f"{len(waiting)} tasks lost their worker {MOST_LOSSES} times: is there memory enough?")


def end_with(parent: int) -> None:
    """Lets this process end soon after its parent, however that ended: nobody would take its results.

    It keeps to the same settings as its parent.
    """
    keep_own_settings()

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(WATCH_S)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def _run_on_cluster(
    function: Callable[[T], str], tasks: Sequence[T], scheduler: str, done: Callable[[str], None]
) -> None:
    from distributed import Client, KilledWorker
    from distributed import as_completed as as_dask_completed

    try:
        client: Any = Client(scheduler, timeout=PATIENCE_S, set_as_default=False)
    except (OSError, ValueError, TimeoutError) as error:
        reason = str(error) or type(error).__name__
        raise InputError("--scheduler", f"{scheduler} can't be reached ({reason})", "give tcp://HOST:PORT") from None
    finished = 0
    with client, client.as_current():
        try:
            futures = client.map(function, list(tasks), pure=False)
            for _, name in as_dask_completed(futures, with_results=True):
                done(name)
                finished += 1
        except KilledWorker as error:
            raise LostWorker(f"{error.task} lost its worker too often: is there memory enough?") from None
        except Exception as error:
            # A scheduler that goes away shows as a future that is cancelled, a closed connection, or a TypeError
            # of the client's own.
            if client.status == "running" and not isinstance(error, CancelledError):
                raise
            what = f"the scheduler is gone; {finished} of {len(tasks)} tasks are done ({first_line(error)})"
            raise InputError("--scheduler", what, "start it, then run the command again: it goes on") from None
