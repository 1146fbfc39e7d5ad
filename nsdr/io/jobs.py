"""One runner for long work: many tasks on processes or a Ray cluster, whose finished outputs are kept between runs."""

import json
import logging
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context, parent_process, resource_tracker
from multiprocessing.connection import wait
from pathlib import Path
from signal import SIG_BLOCK, SIG_SETMASK, SIGINT, Signals, pthread_sigmask
from threading import Thread
from typing import Any, Generic, TypeVar

from tqdm import tqdm

from nsdr.errors import DataError
from nsdr.io.device import available_cores, child_threads
from nsdr.io.files import locked, remove_partial_files, sync, write_json, writing

__all__ = ["ENGINES", "FAILURES", "Job", "Outcome", "Summary", "run_in_order", "run_jobs", "run_tasks"]

ENGINES = ("processes", "ray")
RAY_RETRIES = 3
"""Times that Ray does the task of a lost worker again."""
RAY_TASKS_PER_CORE = 2
"""Tasks handed to Ray per core, so that none waits for the next one."""

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

    A task whose process died is done again at the end, with no other task beside it; it fails if its process dies again.

    Args:
        function: importable (or a `functools.partial` of such a function), as it travels to other processes.
        items: picklable.
        engine: "processes" of this machine, or "ray": the cluster that `RAY_ADDRESS` names or this program is connected
            to, or else this machine.
        workers: processes, which share the available CPU cores; 0 is one per core, 1 with "processes" works in this process.
            With "ray", tasks at a time, each on one core; 0 keeps all of the cluster's cores busy.

    Raises:
        DataError: an unknown engine, Ray is not installed, or a worker process cannot start.
    """
    if engine not in ENGINES:
        raise DataError(f"engine is {engine!r}; expected one of {', '.join(ENGINES)}")
    if workers < 0:
        raise DataError(f"workers is {workers}; expected 0 for one per CPU core, or more")
    if engine == "ray":
        yield from _with_ray(function, items, workers)
    elif workers == 1 or len(items) <= 1:
        for item in items:
            yield _attempt(function, item)
    else:
        yield from _with_processes(function, items, workers or available_cores())


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


def _with_processes(function: Callable[[Item], Any], items: Sequence[Item], workers: int) -> Iterator[Outcome[Item]]:
    """All tasks side by side; then those whose process died once more, each with nothing beside it."""
    died: list[Item] = []
    for item, ended in _in_processes(function, items, workers):
        if isinstance(ended, _Death):
            log.warning("a worker process died (%s); its task is done again, alone", ended.how)
            died.append(item)
        else:
            yield ended
    for item in died:
        for _, ended in _in_processes(function, [item], 1):
            yield ended.outcome(item) if isinstance(ended, _Death) else ended


def _in_processes(
    function: Callable[[Item], Any], items: Sequence[Item], workers: int
) -> "Iterator[tuple[Item, Outcome[Item] | _Death]]":
    """What became of each task. A process has one task at a time, so none but its own can kill it."""
    pending = list(items)[::-1]
    workers = min(workers, len(items))
    threads = max(available_cores() // workers, 1)
    running: dict[_Worker, Item] = {}
    starting = [_Worker(function, threads) for _ in range(workers)]
    try:
        while pending or running:
            ended: list[tuple[Item, Outcome[Item] | _Death]] = []
            for worker in _ready([*starting, *running]):
                message = worker.receive()
                if worker in starting:
                    starting.remove(worker)
                    if isinstance(message, _Death):
                        raise DataError(
                            f"a worker process ended before its first task ({message.how}); "
                            'call it below `if __name__ == "__main__":`, or with fewer workers'
                        )
                else:
                    item = running.pop(worker)
                    ended.append((item, message if isinstance(message, _Death) else Outcome(item, *message)))
                if not pending:
                    worker.end()
                elif isinstance(message, _Death):
                    starting.append(_Worker(function, threads))
                else:
                    running[worker] = pending.pop()
                    worker.send(running[worker])
            yield from ended
    finally:
        for worker in (*starting, *running):
            worker.process.terminate()
            worker.end()


@dataclass(frozen=True)
class _Death:
    """A worker process that ended without a result; `how` names its signal or exit code."""

    how: str

    def outcome(self, item: Item) -> Outcome[Item]:
        memory = "; it may need more memory than there is" if "SIGKILL" in self.how else ""
        return Outcome(item, error=f"its worker process died twice, the second time alone ({self.how}){memory}")


class _Worker:
    """A process that does one task at a time.

    Args:
        function: that does a task.
        threads: that its libraries use at most.
    """

    def __init__(self, function: Callable[[Any], Any], threads: int) -> None:
        context = get_context("spawn")
        self.connection, theirs = context.Pipe()
        self.process = context.Process(target=_serve, args=(theirs, function, threads), daemon=True)
        resource_tracker.ensure_running()  # by the first start otherwise, which would unblock Ctrl-C
        with child_threads(threads), _blocked(SIGINT):
            self.process.start()
        theirs.close()

    def send(self, item: Any) -> None:
        """Begin a task; a process that has died meanwhile is found by `receive`."""
        with suppress(BrokenPipeError, ConnectionResetError):
            self.connection.send(item)

    def receive(self) -> Any:
        """None once it has started, then (result, error) of each task; `_Death` if the process ended instead."""
        with suppress(EOFError, OSError):
            if self.connection.poll():
                return self.connection.recv()
        self.process.join()
        code = self.process.exitcode or 0
        return _Death(f"killed by {Signals(-code).name}" if code < 0 else f"exit code {code}")

    def end(self) -> None:
        """A process without a task ends when it is no longer connected."""
        self.connection.close()


@contextmanager
def _blocked(number: Signals) -> Iterator[None]:
    """Keep a signal from this thread, and from the processes that it starts meanwhile: Ctrl-C is for the program alone."""
    before = pthread_sigmask(SIG_BLOCK, {number})
    try:
        yield
    finally:
        pthread_sigmask(SIG_SETMASK, before)


def _ready(workers: Sequence[_Worker]) -> list[_Worker]:
    """Wait for messages or deaths of workers."""
    of_handle: dict[Any, _Worker] = {}
    for worker in workers:
        of_handle |= {worker.connection: worker, worker.process.sentinel: worker}
    return list(dict.fromkeys(of_handle[handle] for handle in wait(list(of_handle))))


def _serve(connection: Any, function: Callable[[Any], Any], threads: int) -> None:
    """The program of a worker process."""
    import cv2

    cv2.setNumThreads(threads)
    Thread(target=_end_with_parent, daemon=True).start()
    with suppress(EOFError, BrokenPipeError, ConnectionResetError):  # the program has ended
        connection.send(None)
        while True:
            outcome = _attempt(function, connection.recv())
            try:
                connection.send((outcome.result, outcome.error))
            except (BrokenPipeError, ConnectionResetError):
                raise
            except Exception as e:
                connection.send((None, f"its result cannot be sent: {type(e).__name__}: {e}"))


def _end_with_parent() -> None:
    """Workers of a killed program are not told."""
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _with_ray(function: Callable[[Item], Any], items: Sequence[Item], workers: int) -> Iterator[Outcome[Item]]:
    try:
        import ray
    except ImportError as e:
        raise DataError("engine: ray needs Ray: pip install 'nsdr[ray]'") from e
    if not ray.is_initialized():
        ray.init(log_to_driver=False)
    remote: Any = ray.remote(num_cpus=1, max_retries=RAY_RETRIES)(_attempt_in)
    most = workers or RAY_TASKS_PER_CORE * max(int(ray.cluster_resources().get("CPU", 1)), 1)
    pending = list(items)[::-1]
    running: dict[Any, Item] = {}
    folder = os.getcwd()
    try:
        while pending or running:
            while pending and len(running) < most:
                item = pending.pop()
                running[remote.remote(folder, function, item)] = item
            done, _ = ray.wait(list(running), num_returns=1)
            for reference in done:
                item = running.pop(reference)
                try:
                    yield ray.get(reference)
                except (ray.exceptions.RayTaskError, ray.exceptions.RaySystemError) as e:
                    why = str(e).strip().splitlines()[-1]
                    remedy = "install the same packages on all machines"
                    yield Outcome(item, error=f"it cannot be sent to or from its worker ({why}); {remedy}")
                except ray.exceptions.RayError as e:
                    yield Outcome(item, error=f"{type(e).__name__}: its worker was lost {RAY_RETRIES + 1} times")
    finally:
        for reference in running if ray.is_initialized() else ():
            ray.cancel(reference, force=True)


def _attempt_in(folder: str, function: Callable[[Item], Any], item: Item) -> Outcome[Item]:
    """`_attempt` in this program's folder, for relative paths: Ray's workers start in that in which Ray was started."""
    with suppress(OSError):  # machines that lack it share other, absolute, folders
        os.chdir(folder)
    return _attempt(function, item)


LEDGER = ".fingerprints.jsonl"
FAILURES = "failures.json"
"""File with the error messages of a folder's failed jobs, by name."""


@dataclass(frozen=True)
class Job(Generic[Item]):
    """A task that writes files.

    Attributes:
        name: for reports and `failures.json`.
        item: what the task works on; picklable.
        output: the file that the task writes last; its presence marks the task as finished.
        fingerprint: of everything the output depends on (`nsdr.io.fingerprint`).
    """

    name: str
    item: Item
    output: Path
    fingerprint: str


@dataclass(frozen=True)
class Summary:
    """What became of the jobs.

    Attributes:
        done: names of jobs done in this run.
        skipped: names of jobs whose outputs were kept from an earlier run.
        failed: error messages by name.
    """

    done: tuple[str, ...]
    skipped: tuple[str, ...]
    failed: Mapping[str, str]

    def succeeded(self, jobs: Sequence[Job[Item]], folder: str | Path, keep_going: bool) -> list[Job[Item]]:
        """The jobs that did not fail.

        Raises:
            DataError: some failed and `keep_going` is False, or all did; names how many, and the first one with its error.
        """
        left = [job for job in jobs if job.name not in self.failed]
        if self.failed and not (keep_going and left):
            name, message = min(self.failed.items())
            remedy = "run the command again, or with --keep-going" if left else "nothing is left to go on with"
            raise DataError(f"{folder}: {len(self.failed)} of {len(jobs)} failed, such as {name}: {message}; {remedy}")
        return left


def run_jobs(
    function: Callable[[Item, Path], Any],
    jobs: Sequence[Job[Item]],
    folder: str | Path,
    engine: str = "processes",
    workers: int = 0,
    unit: str = "video",
    wait: bool = False,
) -> Summary:
    """Do `function(item, output)` for every job whose output is missing or was made under another fingerprint.

    Fingerprints are kept in `folder/.fingerprints.jsonl`, error messages in `folder/failures.json`. A killed run goes on
    where it stopped; one failure does not stop the others, and leaves an earlier output as it was. With several processes,
    call it below `if __name__ == "__main__":`, because workers import the main module.

    Args:
        function: importable, or a `functools.partial` of such a function.
        jobs: all of the work, finished or not; outputs lie below `folder`.
        folder: where the outputs are written.
        engine: "processes" or "ray".
        workers: number of processes; 0 is one per CPU core.
        unit: what a job is called in the progress bar.
        wait: wait for another process that works in the folder, in place of an error.

    Raises:
        DataError: an unknown engine, another process works in the folder, or it cannot be written (no space left).
    """
    with locked(folder, wait=wait):
        remove_partial_files(Path(folder))
        return _run_jobs(function, jobs, Path(folder), engine, workers, unit)


def _run_jobs(
    function: Callable[[Item, Path], Any], jobs: Sequence[Job[Item]], folder: Path, engine: str, workers: int, unit: str
) -> Summary:
    known = dict(_ledger(folder))
    keys = {job.output: str(job.output.relative_to(folder)) for job in jobs}
    skipped = [job for job in jobs if job.output.exists() and known.get(keys[job.output]) == job.fingerprint]
    kept = {job.output for job in skipped}
    left = [job for job in jobs if job.output not in kept]
    done: list[str] = []
    failed: dict[str, str] = {}
    outcomes = run_tasks(partial(_do, function), left, engine, workers)
    bar = tqdm(outcomes, total=len(jobs), initial=len(skipped), unit=unit, desc=f"{unit}s")
    # From here on no earlier line vouches for what a kill may leave half replaced.
    _append(folder, {keys[job.output]: "" for job in left})
    for outcome in bar:
        job = outcome.item
        if outcome.error:
            failed[job.name] = outcome.error
            log.debug("%s failed: %s", job.name, outcome.error)
            continue
        done.append(job.name)
        _append(folder, {keys[job.output]: job.fingerprint})
    if failed:
        write_json(folder / FAILURES, dict(sorted(failed.items())), indent=1)
        log.info("%d of %d %ss failed; see %s", len(failed), len(jobs), unit, folder / FAILURES)
    else:
        (folder / FAILURES).unlink(missing_ok=True)
    return Summary(tuple(sorted(done)), tuple(job.name for job in skipped), failed)


def _do(function: Callable[[Item, Path], Any], job: Job[Item]) -> None:
    function(job.item, job.output)


def _append(folder: Path, fingerprints: Mapping[str, str]) -> None:
    """Write lines of the ledger to the disk, after what a kill or a full disk left unfinished."""
    path = folder / LEDGER
    lines = "".join(json.dumps([output, value]) + "\n" for output, value in fingerprints.items())
    with writing(path):
        with path.open("ab+") as ledger:
            end = ledger.tell()
            ledger.seek(max(end - 1, 0))
            ledger.write((b"\n" if ledger.read() not in (b"", b"\n") else b"") + lines.encode())
        sync(path)


def _ledger(folder: Path) -> Iterator[tuple[str, str]]:
    """(output, fingerprint) pairs, the newest last; a line that a kill left unfinished is passed over."""
    path = folder / LEDGER
    for line in path.read_text(encoding="utf-8", errors="replace").splitlines() if path.exists() else ():
        try:
            output, value = json.loads(line)
        except (TypeError, ValueError):
            continue
        yield output, value
