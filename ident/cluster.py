"""Runs tasks on a Dask cluster that the user names, for as long as it has a worker."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError
from typing import TYPE_CHECKING, TypeVar

from ident.errors import InputError, first_line, plural

if TYPE_CHECKING:
    from distributed import Client, Future

T = TypeVar("T")
# How long the scheduler may take to answer [s].
PATIENCE_S = 10.0
# How long tasks wait without a single worker [s], where the user's settings of Dask say nothing of
# it: as long as Dask waits for a worker that is silent. A nanny begins another one in seconds, on a
# machine that others fill in minutes.
NO_WORKERS_S = 300.0
NO_WORKERS_SETTING = "distributed.scheduler.no-workers-timeout"
# Dask's loggers, which write tracebacks of what is told here in a line.
LOGGERS = ("distributed", "distributed.client")
# Between two looks for results, and between two questions after the workers [s].
LOOK_S = 0.05
ASK_S = 1.0


class Attendance:
    """Whether a cluster has a worker, asked now and then.

    Args:
        client: Dask's client of it.
        address: Of its scheduler.
        patience: For how long it may have none, or give no answer [s].
    """

    def __init__(self, client: Client, address: str, patience: float) -> None:
        self.client = client
        self.address = address
        self.patience = patience
        self._last_question = self._last_worker = time.monotonic()

    def look(self) -> None:
        """Asks, if it is time to.

        Raises:
            InputError: There has been no worker for longer than the patience.
        """
        now = time.monotonic()
        if now - self._last_question < ASK_S:
            return
        self._last_question = now
        workers = self._count()
        if workers:
            self._last_worker = time.monotonic()
        elif now - self._last_worker > self.patience:
            lack = "gives no answer" if workers is None else "has no worker"
            raise InputError(
                "--scheduler",
                f"{self.address} {lack}, after {self.patience:g} s of waiting",
                "start what is missing, then run the command again: it goes on "
                f"(it waits longer by Dask's setting {NO_WORKERS_SETTING})",
            )

    def _count(self) -> int | None:
        """Workers that the scheduler knows; None where it does not answer."""
        try:
            threads = self.client.nthreads(callback_timeout=PATIENCE_S)
        except OSError:  # a connection that breaks, an answer that takes too long
            return None
        return len(threads)


def run_on_cluster(
    function: Callable[[T], str],
    tasks: Sequence[T],
    scheduler: str,
    done: Callable[[str], None],
) -> None:
    """Runs all tasks, in any order.

    Args:
        function: Importable on the workers; returns the name of its task.
        tasks: Its arguments.
        scheduler: Address.
        done: Told the name of each finished task.

    Raises:
        InputError: The scheduler can't be reached or goes away, there is no worker for too long, or
            workers die of a task again and again.
    """
    from distributed import Client, KilledWorker
    from distributed.scheduler import NoWorkerError

    for name in LOGGERS:
        logging.getLogger(name).setLevel(logging.CRITICAL)
    try:
        client = Client(scheduler, timeout=PATIENCE_S, set_as_default=False)
    except (OSError, ValueError, TimeoutError) as error:
        reason = str(error) or type(error).__name__
        what = f"{scheduler} can't be reached ({reason})"
        raise InputError("--scheduler", what, "give tcp://HOST:PORT") from None
    finished = 0
    with client, client.as_current():
        try:
            futures = client.map(function, list(tasks), pure=False)
            attendance = Attendance(client, scheduler, no_workers_patience())
            for name in _results(futures, attendance):
                done(name)
                finished += 1
        except InputError:
            raise
        except KilledWorker as error:
            what = f"{error.task} lost its worker too often"
            raise InputError("--scheduler", what, "give its workers more memory") from None
        except NoWorkerError as error:
            what = first_line(error)
            raise InputError("--scheduler", what, "start a worker, then run the command again") from None
        except Exception as error:
            # A scheduler that goes away shows as a future that is cancelled, a closed connection, or
            # a TypeError of the client's own.
            if client.status == "running" and not isinstance(error, CancelledError):
                raise
            done_so_far = f"{finished} of {plural(len(tasks), 'task')} are done"
            what = f"the scheduler is gone; {done_so_far} ({first_line(error)})"
            remedy = "start it, then run the command again: it goes on"
            raise InputError("--scheduler", what, remedy) from None


def no_workers_patience() -> float:
    """How long tasks may wait without a single worker [s], by the user's settings of Dask."""
    import dask

    setting = dask.config.get(NO_WORKERS_SETTING, None)
    if setting is None:
        return NO_WORKERS_S
    return float(dask.utils.parse_timedelta(setting))


def _results(futures: Sequence[Future], attendance: Attendance) -> Iterator[str]:
    """What tasks return, as they end; looks after the workers meanwhile."""
    from distributed import as_completed

    completed = as_completed(futures, with_results=True)
    while completed.count():
        if not completed.has_ready():
            attendance.look()
            time.sleep(LOOK_S)
            continue
        future, name = next(completed)
        if future.cancelled():
            raise CancelledError(f"{future.key} is cancelled")
        yield name
