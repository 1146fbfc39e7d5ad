"""Many tasks: in this process, in several, or on a Ray cluster."""

import logging
import os
import re
import signal
import threading
import time
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait as wait_for
from contextlib import closing, suppress
from dataclasses import dataclass
from functools import partial
from typing import Any, Generic, TypeVar

from tqdm import tqdm

from nsdr.errors import CheckpointError, DataError, MachineError, machine_error
from nsdr.io.device import available_cores, passive_environment
from nsdr.io.files import check_installed

ENGINES = ("processes", "ray")
RAY_RETRIES = 3
"""How often Ray repeats the task of a lost worker."""
RAY_TASKS_PER_CORE = 2
"""Tasks handed to Ray per core, so that no core waits for its next task."""
PARENT_POLL_S = 1.0
"""How often a worker checks that its program still runs (s)."""
Item = TypeVar("Item")
log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Outcome(Generic[Item]):
    """What became of a task: its result, or the error's text."""

    item: Item
    result: Any = None
    error: str | None = None


_Found = Outcome[Item] | MachineError | CheckpointError
"""What a worker returns: an outcome, or an error that is not about the item."""


def run_tasks(
    function: Callable[[Item], Any], items: Sequence[Item], engine: str = "processes", workers: int = 0
) -> Generator[Outcome[Item], None, None]:
    """Call `function(item)` for all items. Outcomes come in the order in which they end; one failure does not stop the rest.

    Errors that are not about an item end the work at once: those of the machine, such as a full disk, and weights that
    cannot be loaded. When a process dies, the tasks that were running are done again, one by one, after all others; if one of
    them dies again, the work ends.

    Args:
        function: travels to other processes, as do the items.
        items: what to work on.
        engine: "processes" of this machine, or "ray": the cluster that `RAY_ADDRESS` names or this program is connected
            to, or else this machine.
        workers: processes, which share the available CPU cores; 0 is one per core, 1 with "processes" works in this process.
            With "ray", tasks at a time, each on one core; 0 keeps all of the cluster's cores busy.

    Raises:
        DataError: an unknown engine, or Ray is not installed.
        MachineError: the machine failed, or a task was lost, such as with its process; names the file or the item.
        CheckpointError: a task cannot load its weights.
    """
    if engine not in ENGINES:
        raise DataError(f"engine is {engine!r}; expected one of {', '.join(ENGINES)}")
    if workers < 0:
        raise DataError(f"workers is {workers}; expected 0 for one per CPU core, or more")
    waiting, lost = deque(items), list[_Lost[Item]]()
    if engine == "ray":
        lost = yield from _side_by_side(_Ray(workers), function, waiting)
    elif workers == 1 or len(items) <= 1:
        for item in items:
            yield _outcome(_attempt(function, item))
    else:
        again: list[_Lost[Item]] = []
        while waiting:
            processes = min(workers or available_cores(), len(waiting))
            again += yield from _side_by_side(_Processes(processes), function, waiting)
        for task in again:  # alone, so that another one's death is not taken for its own
            lost += yield from _side_by_side(_Processes(1), function, deque([task.item]))
    if lost:
        others = f" ({len(lost)} tasks in all)" if len(lost) > 1 else ""
        raise MachineError(f"{lost[0].item!s:.200}: {lost[0].how}{others}")


def run_in_order(
    function: Callable[[Item], Any], items: Sequence[Item], engine: str = "processes", workers: int = 0
) -> Iterator[Any]:
    """Results of `run_tasks` in the order of the items.

    Raises:
        DataError: a task failed.
        MachineError, CheckpointError: those of `run_tasks`.
    """
    results: dict[int, Any] = {}
    following = 0
    for outcome in run_tasks(partial(_numbered, function), list(enumerate(items)), engine, workers):
        if outcome.error:
            raise DataError(outcome.error)
        results[outcome.item[0]] = outcome.result
        while following in results:
            yield results.pop(following)
            following += 1


def _numbered(function: Callable[[Item], Any], item: tuple[int, Item]) -> Any:
    return function(item[1])


def _attempt(function: Callable[[Item], Any], item: Item) -> _Found[Item]:
    """What became of the task, or an error that is not about the item."""
    try:
        return Outcome(item, function(item))
    except CheckpointError as e:
        return e
    except Exception as e:
        log.debug("task %r failed", item, exc_info=True)
        return machine_error(e, f"{item!s:.200}") or Outcome(item, error=f"{type(e).__name__}: {e}")


def _outcome(found: _Found[Item]) -> Outcome[Item]:
    """The outcome; an error that is not about the item is raised."""
    if isinstance(found, Outcome):
        return found
    raise found


@dataclass(frozen=True)
class _Lost(Generic[Item]):
    """A task whose process died, or that could not be sent to its process or back."""

    item: Item
    how: str


def _side_by_side(
    pool: "_Processes | _Ray", function: Callable[[Item], Any], waiting: deque[Item]
) -> Generator[Outcome[Item], None, list[_Lost[Item]]]:
    """Yield outcomes, and return the lost tasks. This ends when a process dies, even while items are still waiting."""
    from loky.process_executor import BrokenProcessPool

    lost: list[_Lost[Item]] = []
    running: dict[Future[_Found[Item]], Item] = {}
    with closing(pool):
        while waiting or running:
            try:
                while waiting and len(running) < pool.most:
                    future = pool.submit(function, waiting[0])
                    running[future] = waiting.popleft()
                for future in wait_for(running, return_when=FIRST_COMPLETED).done:
                    error = future.exception()
                    if isinstance(error, BrokenProcessPool):
                        raise error
                    item = running.pop(future)
                    if error is None:
                        yield _outcome(future.result())
                    else:
                        lost.append(_Lost(item, _untold(error)))
            except BrokenProcessPool as e:
                found = re.search("exit codes of the workers are {(.+)}", str(e))
                code = f"exit code {found[1]}" if found else str(e).splitlines()[0]
                log.warning("a worker process died (%s)", code)
                memory = "; it may need more memory than there is" if "SIGKILL" in code else ""
                return lost + [_Lost(item, f"its worker process died ({code}){memory}") for item in running.values()]
    return lost


def _untold(error: BaseException) -> str:
    """The text of an error that did not happen in the task."""
    reason = (str(error).strip().splitlines() or [type(error).__name__])[-1]
    return f"it cannot be sent to or from its worker, or was lost ({reason}); workers need the same packages and files"


class _Processes:
    """Processes of this machine, each with its share of the cores."""

    def __init__(self, workers: int) -> None:
        from loky import ProcessPoolExecutor

        threads, own = max(available_cores() // workers, 1), os.environ.get("OMP_NUM_THREADS", "")
        most = str(min(threads, int(own)) if own.isdigit() else threads)
        environment = {"OMP_NUM_THREADS": most, **passive_environment()}
        self.most = workers
        self._executor = ProcessPoolExecutor(
            workers, initializer=_begin, initargs=(threads, os.getpid()), env=environment
        )

    def submit(self, function: Callable[[Item], Any], item: Item) -> "Future[_Found[Item]]":
        future: Future[_Found[Item]] = self._executor.submit(_attempt, function, item)
        return future

    def close(self) -> None:
        self._executor.shutdown(kill_workers=True)


def _begin(threads: int, program: int) -> None:
    """The start of a worker: Ctrl-C is for the program alone, and the worker ends with it, even if that is killed."""
    import cv2

    def watch() -> None:
        while os.getppid() == program:
            time.sleep(PARENT_POLL_S)
        os._exit(1)

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    cv2.setNumThreads(threads)
    tqdm.set_lock(threading.RLock())  # tqdm's own is a system's semaphore, which a worker that is ended leaves behind
    threading.Thread(target=watch, daemon=True).start()


class _Ray:
    """Workers of a Ray cluster, which does the tasks of lost ones again."""

    def __init__(self, workers: int) -> None:
        check_installed("ray", "engine: ray needs Ray", "ray")
        import ray

        if not ray.is_initialized():
            ray.init(log_to_driver=False)
        self.most = workers or RAY_TASKS_PER_CORE * max(int(ray.cluster_resources().get("CPU", 1)), 1)
        self._ray, self._running = ray, dict[Any, Any]()
        self._remote: Any = ray.remote(num_cpus=1, max_retries=RAY_RETRIES)(_attempt_in)

    def submit(self, function: Callable[[Item], Any], item: Item) -> "Future[_Found[Item]]":
        reference = self._remote.remote(os.getcwd(), function, item)
        future: Future[_Found[Item]] = reference.future()
        self._running[future] = reference
        return future

    def close(self) -> None:
        for future, reference in self._running.items():
            if not future.done() and self._ray.is_initialized():
                self._ray.cancel(reference, force=True)


def _attempt_in(folder: str, function: Callable[[Item], Any], item: Item) -> _Found[Item]:
    """`_attempt` in this program's folder, for relative paths: Ray's workers start in that in which Ray was started."""
    with suppress(OSError):  # machines that lack it share other, absolute, folders
        os.chdir(folder)
    return _attempt(function, item)
