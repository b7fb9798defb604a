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
# Dask's setting of the silence after which its tasks are given to other workers.
TIME_TO_LIVE_SETTING = "distributed.scheduler.worker-ttl"
# Dask's loggers, which write tracebacks of what is told here in a line.
LOGGERS = ("distributed", "distributed.client")
# Between two looks for results, and between two questions after the workers [s].
LOOK_S = 0.05
ASK_S = 1.0


class Attendance:
    """Whether a cluster has workers that are awake, asked now and then.

    A worker that is stopped and not ended is there all the same: only its silence tells.

    Args:
        client: Dask's client of it.
        address: Of its scheduler.
        patience: For how long it may have none, or give no answer [s].
        silence: For how long a worker that holds tasks may be silent while others are awake [s].
    """

    def __init__(self, client: Client, address: str, patience: float, silence: float) -> None:
        self.client = client
        self.address = address
        self.patience = patience
        self.silence = silence
        self._last_question = self._last_worker = time.monotonic()
        # By a worker's address: when the scheduler heard of it last, by its own clock, and since
        # when that is so, by ours.
        self._heard: dict[str, tuple[float, float]] = {}

    def look(self) -> None:
        """Asks, if it is time to.

        Raises:
            InputError: No worker has been awake for longer than the patience, or one that holds
                tasks has been silent for too long.
        """
        now = time.monotonic()
        if now - self._last_question < ASK_S:
            return
        self._last_question = now
        try:
            self._listen()
            silent = self._silent_holders(self.silence)
        except OSError:  # a connection that breaks, an answer that takes too long
            if now - self._last_worker > self.patience:
                raise self._fault("gives no answer", self.patience) from None
            return
        now = time.monotonic()
        since = [moment for _, moment in self._heard.values()]
        self._last_worker = max([self._last_worker, *since])
        if now - self._last_worker > self.patience:
            lack = "has no worker that answers" if since else "has no worker"
            raise self._fault(lack, self.patience)
        if silent:
            what = f"has a worker, {silent}, that holds tasks and is silent"
            raise self._fault(what, self.silence, "end it, or wake it")

    def _listen(self) -> None:
        """Asks the scheduler when it heard of each of its workers last.

        Raises:
            OSError: It does not answer.
        """
        assert self.client.scheduler is not None
        asked = self.client.scheduler.identity
        record = self.client.sync(asked, callback_timeout=PATIENCE_S)
        now = time.monotonic()
        heard = {}
        for worker, state in record["workers"].items():
            last = float(state["last_seen"])
            before = self._heard.get(worker)
            heard[worker] = (last, now) if before is None or before[0] != last else before
        self._heard = heard

    def _silent_holders(self, longest: float) -> str:
        """The first worker that holds tasks and has been silent for longer than so many seconds.

        Raises:
            OSError: The scheduler does not answer.
        """
        now = time.monotonic()
        silent = [worker for worker, (_, moment) in self._heard.items() if now - moment > longest]
        if not silent:
            return ""
        assert self.client.scheduler is not None
        asked = self.client.scheduler.processing
        held = self.client.sync(asked, workers=None, callback_timeout=PATIENCE_S)
        return next((worker for worker in silent if held.get(worker)), "")

    def _fault(self, lack: str, waited: float, remedy: str = "start what is missing") -> InputError:
        return InputError(
            "--scheduler",
            f"{self.address} {lack}, after {waited:g} s of waiting",
            f"{remedy}, then run the command again: it goes on "
            f"(it waits longer by Dask's setting {NO_WORKERS_SETTING})",
        )


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
            patience = no_workers_patience()
            attendance = Attendance(client, scheduler, patience, silence_patience(patience))
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
            raise InputError(
                "--scheduler", what, "start a worker, then run the command again"
            ) from None
        except Exception as error:
            # A scheduler that goes away shows as a future that is cancelled, a closed connection,
            # or a TypeError of the client's own.
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


def silence_patience(patience: float) -> float:
    """How long a worker that holds tasks may be silent [s].

    Dask itself gives its tasks to others once it has been silent for some time, of which it takes
    notice as often; that goes before.

    Args:
        patience: How long tasks wait without a worker [s].
    """
    import dask

    setting = dask.config.get(TIME_TO_LIVE_SETTING, None)
    if setting is None:
        return patience
    return max(patience, 2.0 * float(dask.utils.parse_timedelta(setting)) + PATIENCE_S)


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
