"""One runner for long work: many tasks on processes or a Ray cluster, whose finished outputs are kept between runs."""

import json
import logging
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Generic, TypeVar

from tqdm import tqdm

from nsdr.errors import DataError
from nsdr.io.files import remove_partial_files, sync, write_json, writing
from nsdr.io.lock import locked
from nsdr.io.tasks import run_tasks

__all__ = ["FAILURES", "Job", "Summary", "run_jobs"]

LEDGER = ".fingerprints.jsonl"
FAILURES = "failures.json"
"""File with the error messages of a folder's failed jobs, by name."""
Item = TypeVar("Item")
log = logging.getLogger(__name__)


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
