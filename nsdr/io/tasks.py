"""Many independent tasks: in this process, in several, or on a Ray cluster. Lost workers' tasks are done again."""

import logging
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context, parent_process
from threading import Thread
from typing import Any, Generic, TypeVar

from nsdr.errors import DataError

__all__ = ["ENGINES", "Outcome", "run_in_order", "run_tasks"]

ENGINES = ("processes", "ray")
ATTEMPTS = 3
"""Number of lost workers after which a task counts as failed."""
IN_FLIGHT_PER_WORKER = 2
"""Tasks handed out per worker, so that none waits for the next one."""

Item = TypeVar("Item")
log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Outcome(Generic[Item]):
    """What became of a task: its result, or the error's text."""

    item: Item
    result: Any = None
    error: str | None = None


def run_tasks(
    function: Callable[[Item], Any], items: Sequence[Item], engine: str = "processes", workers: int = 0
) -> Iterator[Outcome[Item]]:
    """Do `function(item)` for all items; outcomes come as they end, in any order. One failure does not stop the rest.

    Args:
        function: importable (or a `functools.partial` of such a function), as it travels to other processes.
        items: picklable.
        engine: "processes" of this machine, or "ray": the cluster that `RAY_ADDRESS` names or this program is connected
            to, or else this machine.
        workers: processes; 0 is one a CPU core, 1 with "processes" works in this process. Ray takes what it has.

    Raises:
        DataError: an unknown engine, or Ray is not installed.
    """
    if engine not in ENGINES:
        raise DataError(f"engine is {engine!r}; expected one of {', '.join(ENGINES)}")
    if engine == "ray":
        yield from _with_ray(function, items)
    elif workers == 1 or len(items) <= 1:
        for item in items:
            yield _attempt(function, item)
    else:
        yield from _with_processes(function, items, workers or os.cpu_count() or 1)


def run_in_order(
    function: Callable[[Item], Any], items: Sequence[Item], engine: str = "processes", workers: int = 0
) -> Iterator[Any]:
    """Results of `run_tasks` in the order of the items.

    Raises:
        DataError: a task failed.
    """
    waiting: dict[int, Any] = {}
    following = 0
    for outcome in run_tasks(partial(_numbered, function), list(enumerate(items)), engine, workers):
        if outcome.error:
            raise DataError(outcome.error)
        waiting[outcome.item[0]] = outcome.result
        while following in waiting:
            yield waiting.pop(following)
            following += 1


def _numbered(function: Callable[[Item], Any], item: tuple[int, Item]) -> Any:
    return function(item[1])


def _attempt(function: Callable[[Item], Any], item: Item) -> Outcome[Item]:
    try:
        return Outcome(item, function(item))
    except Exception as e:
        log.debug("task %r failed", item, exc_info=True)
        return Outcome(item, error=f"{type(e).__name__}: {e}")


def _prepare_worker() -> None:
    """Workers share the cores, so libraries get one thread each; workers end with this program."""
    import cv2

    cv2.setNumThreads(1)
    Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """Workers of a killed program are not told."""
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _with_processes(function: Callable[[Item], Any], items: Sequence[Item], workers: int) -> Iterator[Outcome[Item]]:
    pending = list(enumerate(items))[::-1]
    losses = [0] * len(items)
    while pending:
        before = os.environ.get("OMP_NUM_THREADS")
        os.environ["OMP_NUM_THREADS"] = "1"  # for the children
        pool = ProcessPoolExecutor(workers, mp_context=get_context("spawn"), initializer=_prepare_worker)
        running: dict[Future[Outcome[Item]], int] = {}
        try:
            while pending or running:
                while pending and len(running) < workers * IN_FLIGHT_PER_WORKER:
                    number, item = pending[-1]
                    running[pool.submit(_attempt, function, item)] = number
                    pending.pop()  # only now: a broken pool takes nothing more
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    outcome = future.result()
                    del running[future]
                    yield outcome
        except BrokenProcessPool:
            # A worker died (killed, out of memory): any of the running tasks may have been its own.
            for number in running.values():
                losses[number] += 1
                if losses[number] < ATTEMPTS:
                    pending.append((number, items[number]))
                else:
                    yield Outcome(items[number], error=f"its worker process died {ATTEMPTS} times")
        finally:
            pool.shutdown(wait=False, cancel_futures=True)
            if before is None:
                del os.environ["OMP_NUM_THREADS"]
            else:
                os.environ["OMP_NUM_THREADS"] = before


def _with_ray(function: Callable[[Item], Any], items: Sequence[Item]) -> Iterator[Outcome[Item]]:
    try:
        import ray
    except ImportError as e:
        raise DataError("engine: ray needs Ray: pip install 'nsdr[ray]'") from e
    if not ray.is_initialized():
        ray.init(log_to_driver=False)
    remote: Any = ray.remote(num_cpus=1, max_retries=ATTEMPTS)(_attempt)
    most = IN_FLIGHT_PER_WORKER * max(int(ray.cluster_resources().get("CPU", 1)), 1)
    pending = list(items)[::-1]
    running: dict[Any, Item] = {}
    while pending or running:
        while pending and len(running) < most:
            item = pending.pop()
            running[remote.remote(function, item)] = item
        done, _ = ray.wait(list(running), num_returns=1)
        for reference in done:
            item = running.pop(reference)
            try:
                yield ray.get(reference)
            except ray.exceptions.RayError as e:
                yield Outcome(item, error=f"{type(e).__name__}: its worker was lost {ATTEMPTS + 1} times")
