"""Jobs: tasks whose finished outputs are kept between runs."""

import logging
import os
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Generic, TypeVar

from tqdm import tqdm

from nsdr.errors import DataError
from nsdr.io.files import locked, remove_partial_files, write_json
from nsdr.io.fingerprint import fingerprint
from nsdr.io.ledger import LEDGER, Entry, append_to_ledger, read_ledger
from nsdr.io.tasks import Item, run_tasks

FAILURES = "failures.json"
"""File with the error messages of a folder's failed jobs, by name."""
Read = TypeVar("Read")
log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Job(Generic[Item]):
    """A task that writes files. `str(job)` is its name.

    Attributes:
        name: for reports and `failures.json`.
        item: what the task works on; picklable.
        output: the file that the task writes last; its presence marks the task as finished.
        fingerprint: of everything the output depends on (`nsdr.io.fingerprint`).
        source: the file or folder from which the output takes its number or name; None if it is named otherwise. An output
            that was made from another source is not replaced.
    """

    name: str
    item: Item
    output: Path
    fingerprint: str
    source: Path | None = None

    def __str__(self) -> str:
        return self.name


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
            text = failed_text(len(self.failed), len(jobs), "", f"{name}: {message}")
            raise DataError(f"{folder}: {text}; {remedy}")
        return left


def failed_text(failed: int, total: int, what: str, example: str) -> str:
    """How many things failed, and one of them: "2 of 9 videos failed, such as a.mp4: …" or "1 of 9 videos failed: a.mp4: …".

    Args:
        failed, total: numbers of things.
        what: what they are, in the plural; may be "".
        example: one of them, with what went wrong.
    """
    return " ".join(
        [f"{failed} of {total}", *([what] if what else []), "failed" + (":" if failed == 1 else ", such as"), example]
    )


def run_jobs(
    function: Callable[[Item, Path], Any],
    jobs: Sequence[Job[Item]],
    folder: str | Path,
    engine: str = "processes",
    workers: int = 0,
    unit: str = "video",
    wait: bool = False,
) -> Summary:
    """Call `function(item, output)` for every job whose output is missing or has another fingerprint.

    Fingerprints are kept in `folder/.fingerprints.jsonl`, error messages in `folder/failures.json`. A killed run goes on
    where it stopped; one failure does not stop the others, and leaves an earlier output as it was. An error of the machine ends
    the work.

    Args:
        function: see `run_tasks`.
        jobs: all of the work, finished or not; outputs lie below `folder`.
        folder: where the outputs are written.
        engine: "processes" or "ray".
        workers: number of processes; 0 is one per CPU core.
        unit: what a job is called in the progress bar.
        wait: wait for another process that works in the folder instead of raising an error.

    Raises:
        DataError: an unknown engine, or another process works in the folder. Or two jobs have one output, an output is a file
            of the folder's own, or it was made from another source, which is still there.
        MachineError, CheckpointError: those of `run_tasks`; or the folder cannot be written.
    """
    folder = Path(folder)
    with locked(folder, wait=wait):
        remove_partial_files(folder)
        entries = read_ledger(folder)
        made = {job.output: _entry(job, folder) for job in jobs}
        _check_outputs(jobs, folder)
        skipped = [job for job in jobs if job.output.exists() and _is_of(made[job.output], entries)]
        kept = {job.output for job in skipped}
        left = [job for job in jobs if job.output not in kept]
        for job in left:
            _check_source(job, entries.get(made[job.output].output))
        done: list[str] = []
        failed: dict[str, str] = {}
        outcomes = run_tasks(partial(_do, function), left, engine, workers)
        # From here on no earlier line vouches for what a kill may leave half replaced.
        append_to_ledger(folder, [replace(made[job.output], fingerprint="") for job in left])
        try:
            with closing(outcomes):
                for outcome in tqdm(outcomes, total=len(jobs), initial=len(skipped), unit=unit, desc=f"{unit}s"):
                    job = outcome.item
                    if outcome.error:
                        failed[job.name] = outcome.error
                        continue
                    done.append(job.name)
                    append_to_ledger(folder, [made[job.output]])
        finally:
            remove_partial_files(folder)  # of workers that were killed
        if failed:
            write_json(folder / FAILURES, dict(sorted(failed.items())), indent=1)
        else:
            (folder / FAILURES).unlink(missing_ok=True)
    return Summary(tuple(sorted(done)), tuple(job.name for job in skipped), failed)


def read_output(job: Job[Item], read: Callable[[Path], Read], function: Callable[[Item, Path], Any]) -> Read:
    """Read what a finished job wrote. An output that has been damaged since then is made again in this process.

    Args:
        job: a job that `run_jobs` has done or kept.
        read: reads the output; raises `DataError` where it is damaged.
        function: the function of `run_jobs`.

    Raises:
        DataError: the job fails when it is done again.
    """
    try:
        return read(job.output)
    except DataError as e:
        log.warning("%s; it is made again", e)
    for outcome in run_tasks(partial(_do, function), [job], workers=1):
        if outcome.error:
            raise DataError(outcome.error)
    return read(job.output)


def _do(function: Callable[[Item, Path], Any], job: Job[Item]) -> None:
    function(job.item, job.output)


def _entry(job: Job[Item], folder: Path) -> Entry:
    source = "" if job.source is None else os.path.realpath(job.source)
    return Entry(str(job.output.relative_to(folder)), job.fingerprint, source)


def _is_of(made: Entry, entries: Mapping[str, Entry]) -> bool:
    """Whether an output is still what its job would make."""
    return made.output in entries and entries[made.output].fingerprint == made.fingerprint


def _check_outputs(jobs: Sequence[Job[Item]], folder: Path) -> None:
    """No two jobs write the same file, and none writes the folder's own."""
    names: dict[Path, str] = {folder / FAILURES: "the list of failures", folder / LEDGER: "the list of what is done"}
    for job in jobs:
        if job.output in names:
            raise DataError(
                f"{job.output}: would be written by {names[job.output]} and by {job.name}; rename the latter"
            )
        names[job.output] = job.name


def _check_source(job: Job[Item], before: Entry | None) -> None:
    """Refuse to replace an output that was made from another source if that still exists and has another content."""
    if before is None or job.source is None or not job.output.exists():
        return
    source = Path(before.source)
    if before.source in ("", os.path.realpath(job.source)) or not source.exists():
        return
    if fingerprint(inputs=[source]) != fingerprint(inputs=[job.source]):
        raise DataError(f"{job.output}: was made from {source}; {job.source} would replace it: choose another folder")
