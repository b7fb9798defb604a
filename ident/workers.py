"""Runs tasks in other processes: on this machine by joblib, or on a Dask cluster.

A task writes its own result file, so that nothing is lost with the process that asked for it; a
task whose worker dies is given to another.
"""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import as_completed
from concurrent.futures.process import BrokenProcessPool
from typing import TypeVar

from joblib.externals.loky import ProcessPoolExecutor

from ident.cluster import run_on_cluster
from ident.errors import InputError, plural
from ident.own_settings import keep_own_settings

T = TypeVar("T")
# How often a task may lose its worker before it is given up.
MOST_LOSSES = 4
# Processes do the work side by side; threads of many small parallel loops would only wait for each
# other.
THREAD_COUNTS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
# How often a worker looks whether its parent is still there [s].
WATCH_S = 1.0


def run_tasks(
    function: Callable[[T], str],
    tasks: Sequence[T],
    workers: int = 1,
    scheduler: str | None = None,
    done: Callable[[str], None] = lambda name: None,
) -> None:
    """Runs all tasks, in any order and in fresh processes, which know nothing of earlier tasks of
    another kind.

    Args:
        function: Importable; returns the name of its task.
        tasks: Its arguments.
        workers: Processes on this machine.
        scheduler: Address of a Dask scheduler instead; its workers must see the same folders.
        done: Told the name of each finished task.

    Raises:
        InputError: The scheduler can't be reached, its cluster has no worker, or workers die again
            and again.
    """
    if not tasks:
        return
    if scheduler is not None:
        run_on_cluster(function, tasks, scheduler, done)
        return
    waiting = dict(enumerate(tasks))
    for _ in range(MOST_LOSSES):
        workers = min(workers, len(waiting))
        executor = ProcessPoolExecutor(
            workers,
            env=dict.fromkeys(THREAD_COUNTS, "1"),
            initializer=end_with,
            initargs=(os.getpid(),),
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
    what = f"{plural(len(waiting), 'task')} lost a process {MOST_LOSSES} times"
    raise InputError("--workers", what, "give fewer workers, or a machine with more memory")


def end_with(parent: int) -> None:
    """Lets this process end soon after its parent, however that ended: nobody would take its
    results.

    It keeps to the same settings as its parent.
    """
    keep_own_settings()

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(WATCH_S)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
