"""Whole folders of videos or proposals -> scenes: many processes, resumable, one failure does not stop the rest."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

from tqdm import tqdm

from nsdr.clevrer.predictions import predictions_document
from nsdr.clevrer.proposals import proposals_document, read_compact_proposals, read_proposals
from nsdr.errors import DataError
from nsdr.io import storage
from nsdr.io.files import write_json
from nsdr.io.tasks import run_tasks
from nsdr.pipeline import Pipeline
from nsdr.types import VideoProposals

__all__ = ["Summary", "parse_videos", "predict_dynamics"]

FORMATS = ("predictions", "scenes")


@dataclass(frozen=True)
class Summary:
    """What became of the inputs: names done now, names done before, and the errors of those that failed."""

    done: tuple[str, ...]
    skipped: tuple[str, ...]
    failed: Mapping[str, str]


def parse_videos(
    videos: str | Path,
    output: str | Path,
    checkpoint: str = "default",
    stride: int = 1,
    engine: str = "processes",
    workers: int = 0,
    dynamics: str = "physics",
) -> Summary:
    """Write `scene_N.json` and `proposal_N.json` for every video of a folder; those that are there already are skipped.

    Args:
        videos: folder with `*.mp4`, searched below, too.
        output: folder to write; `failures.json` in it names what failed and why.
        checkpoint: weights.
        stride: of the frame parser.
        engine: "processes" or "ray".
        workers: processes, 0 for one a CPU core.
        dynamics: backend of the dynamics predictor, or its YAML file.

    Raises:
        DataError: the folder holds no videos.
    """
    paths = sorted(Path(videos).rglob("*.mp4"))
    if not paths:
        raise DataError(f"{videos}: holds no *.mp4")
    jobs = {p.name: (p, Path(output) / f"scene_{_number(p)}.json") for p in paths}
    return _each(partial(_parse_video, checkpoint, dynamics, stride), jobs, Path(output), engine, workers)


def predict_dynamics(
    proposals: str | Path,
    output: str | Path,
    form: str = "predictions",
    checkpoint: str = "default",
    engine: str = "processes",
    workers: int = 0,
    dynamics: str = "physics",
) -> Summary:
    """Write the motion and collisions of every proposal file: observed, after the video, and with each object removed.

    Args:
        proposals: folder with `proposal_N.json` or `sim_N.json` (also gzipped), or a compact NPZ.
        output: folder to write; what is there already is skipped, and `failures.json` names what failed and why.
        form: "predictions" writes the research code's `sim_N.json`, which the released executor reads; "scenes" writes our
            `scene_N.json`.
        checkpoint, engine, workers, dynamics: as of `parse_videos`.

    Raises:
        DataError: an unknown form, or there are no proposals.
    """
    if form not in FORMATS:
        raise DataError(f"form is {form!r}; expected one of {', '.join(FORMATS)}")
    stem = "sim" if form == "predictions" else "scene"
    source = Path(proposals)
    if source.is_file():
        found: dict[str, Any] = {f"{video:05d}": (video, p) for video, p in read_compact_proposals(source)}
    else:
        names = ("proposal_*.json", "proposal_*.json.gz", "sim_*.json", "sim_*.json.gz")
        found = {_number(p): p for name in names for p in sorted(source.rglob(name))}
    if not found:
        raise DataError(f"{proposals}: holds no proposal_N.json and no sim_N.json")
    jobs = {number: (item, Path(output) / f"{stem}_{number}.json") for number, item in found.items()}
    return _each(partial(_predict, checkpoint, dynamics, form), jobs, Path(output), engine, workers)


def _number(path: Path) -> str:
    return path.name.split(".")[0].split("_")[-1]


def _each(
    function: Callable[[tuple[Any, Path]], None],
    jobs: Mapping[str, tuple[Any, Path]],
    output: Path,
    engine: str,
    workers: int,
) -> Summary:
    """Do `function((input, file to write))` for all jobs whose file is not there yet."""
    skipped = [name for name, (_, path) in jobs.items() if path.exists()]
    left: Sequence[tuple[Any, Path]] = [job for name, job in jobs.items() if name not in set(skipped)]
    names = {path: name for name, (_, path) in jobs.items()}
    done, failed = [], {}
    outcomes = run_tasks(function, left, engine, workers)
    for outcome in tqdm(outcomes, total=len(jobs), initial=len(skipped), unit="video", desc="videos"):
        name = names[outcome.item[1]]
        if outcome.error:
            failed[name] = outcome.error
        else:
            done.append(name)
    write_json(output / "failures.json", dict(sorted(failed.items())), indent=1)
    return Summary(tuple(sorted(done)), tuple(skipped), failed)


@lru_cache(maxsize=1)
def _pipeline(checkpoint: str, dynamics: str, stride: int = 1) -> Pipeline:
    pipeline = Pipeline.from_pretrained(checkpoint, dynamics)
    pipeline.frame_parser.stride = stride
    return pipeline


def _parse_video(checkpoint: str, dynamics: str, stride: int, job: tuple[Path, Path]) -> None:
    video, path = job
    perception = _pipeline(checkpoint, dynamics, stride).perceive(video)
    digits = "".join(c for c in video.stem if c.isdigit())
    assert perception.proposals is not None
    document = proposals_document(perception.proposals, int(digits or 0), video.name)
    write_json(path.with_name(path.name.replace("scene_", "proposal_")), document)
    storage.save(perception.scene, path)  # last: it marks the video as done


def _predict(checkpoint: str, dynamics: str, form: str, job: tuple[Path | tuple[int, VideoProposals], Path]) -> None:
    source, path = job
    proposals = read_proposals(source) if isinstance(source, Path) else source[1]
    perception = _pipeline(checkpoint, dynamics).perceive(proposals=proposals)
    if form == "scenes":
        storage.save(perception.scene, path)
    else:
        assert perception.dynamics is not None
        write_json(path, predictions_document(perception.dynamics))
