"""`compare_videos`: the comparison of a folder of continuations with the truth of a generated data set."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from nsdr.clevrer.dataset import CLEVRER
from nsdr.clevrer.files.annotations import read_truth_file
from nsdr.clevrer.files.proposals import read_proposals
from nsdr.continuations import VERSION
from nsdr.continuations.candidates import BASELINES, baselines, bullet_runs, perceived
from nsdr.continuations.score import (
    MEASURES,
    Continuation,
    Measure,
    PossibleFutures,
    Sums,
    TrueFuture,
    add,
    score,
    true_future,
)
from nsdr.dynamics import physics, propnet
from nsdr.errors import DataError, VideoError
from nsdr.evaluation.batch import worker_pipeline
from nsdr.evaluation.measures import ratio_interval, wilson_interval
from nsdr.generate.dataset import Files
from nsdr.generate.manifest import made_with
from nsdr.generate.physics.bullet import BulletConfig
from nsdr.generate.render.view import RenderConfig, view_of
from nsdr.io.checkpoint import find_checkpoint
from nsdr.io.device import resolve_device
from nsdr.io.files import check_installed, find_files, write_json
from nsdr.io.fingerprint import code_revision, fingerprint
from nsdr.io.jobs import Job, read_output, run_jobs
from nsdr.io.reading import read_json
from nsdr.io.video import RATE_TOLERANCE, frame_rate
from nsdr.io.worlds import check_world_of_data
from nsdr.pipeline import Perception, Pipeline, PipelineConfig
from nsdr.pipeline_config import pipeline_settings
from nsdr.types import VideoProposals

MIN_FOLLOWING_FRAMES = 8
"""Smallest number of frames after the cut in a video that is scored."""
GENERATED, TRUTH = "generated videos", "truth, as perceived"
"""Rows of the table for the continuations, and for the true videos as seen by the same perception."""
FLOORS = {"Bullet, known to 0.001": 0.001, "Bullet, known to 0.01": 0.01}
"""Rows of the table for runs of Bullet, with the errors of positions in the last given frame (world units). The runs of the
last row are the possible futures, because a video shows positions with about this error."""
ROWS = (GENERATED, TRUTH, *FLOORS, *BASELINES)
"""Names of all rows of the table."""
BY_FRAME = ("error", "nearest", "log_likelihood", "missing", "identity")
"""Names of the measures that are also reported by frame."""


@dataclass(frozen=True)
class _Video:
    """The files of one video.

    Attributes:
        truth: path of the truth file.
        seen: path of the true video or, if there is none, of its proposals.
        generated: path of the continuation.
    """

    truth: Path
    seen: Path
    generated: Path


@dataclass(frozen=True)
class _Settings:
    """All settings that the scores depend on."""

    given_frames: int
    runs: int
    physics: BulletConfig
    render: RenderConfig
    pipeline: PipelineConfig
    checkpoint: str
    device: str


def compare_videos(
    truth: str | Path,
    generated: str | Path,
    output: str | Path,
    given_frames: int = 32,
    runs: int = 20,
    split: str = "",
    checkpoint: str = "default",
    settings: PipelineConfig | None = None,
    engine: str = "processes",
    workers: int = 0,
    device: str = "auto",
) -> dict[str, Any]:
    """Score continuations of the videos of a data set. Scores of an earlier run are kept.

    Args:
        truth: folder of a data set made by `nsdr generate dataset`.
        generated: folder with continuations, named `video_N.mp4` like the videos of the data set, at the same frame rate and
            starting with the given frames.
        output: folder for the scores, one file for each video.
        given_frames: number of frames that the video model was given.
        runs: number of runs of Bullet with each of the errors in `FLOORS`.
        split: split whose videos are compared; "" for all splits.
        checkpoint: checkpoint with the weights, of the data set's world.
        settings: settings of perception; None for those of the checkpoint. The camera is that of the data set.
        engine, workers: see `nsdr.io.tasks.run_tasks`.
        device: device on which the networks of every process run, as in `Pipeline.from_pretrained`.

    Returns:
        The report: `table` by row and measure (`value`, 95 % `interval` or None, number of `videos`), `curves` of measures by
        frame after the cut, `videos` with the values of each video, and `not_scored` with the reason for each video.

    Raises:
        DataError: `truth` is not a generated data set, PyBullet is not installed, or no video could be scored.
    """
    check_installed("pybullet", "the possible futures need PyBullet", "generate")
    if given_frames < 2 or runs < 2:
        raise DataError(f"expected at least 2 given frames and 2 runs, got {given_frames} and {runs}")
    root = Path(truth)
    common = _settings(
        root, given_frames, runs, settings or pipeline_settings(checkpoint=checkpoint), checkpoint, device
    )
    found, not_scored = _videos(root, Path(generated), split)
    key = [VERSION, physics.VERSION, propnet.VERSION, given_frames, runs, asdict(common.physics), asdict(common.render)]
    key.append(common.pipeline.fingerprint(checkpoint, "continuations"))
    jobs = []
    for name, v in found.items():
        value = fingerprint(inputs=[v.truth, v.seen, v.generated], config=key)
        jobs.append(Job(name, v, Path(output) / "scores" / f"{name}.json", value))
    function = partial(_compare, common)
    summary = run_jobs(function, jobs, output, engine, workers)
    not_scored |= summary.failed
    finished, read = [job for job in jobs if job.name not in summary.failed], partial(read_json, kind=dict[str, Any])
    scored = {job.name: read_output(job, read, function) for job in finished}
    if not scored:
        name, reason = min(not_scored.items())
        raise DataError(f"{generated}: none of {len(not_scored)} videos could be scored, such as {name}: {reason}")
    rows = [row for row in ROWS if any(row in v["rows"] for v in scored.values())]
    return {
        "given_frames": given_frames,
        "runs": runs,
        "fps": common.pipeline.video.fps,
        "revision": code_revision(),
        "table": {row: _measured([v["rows"][row] for v in scored.values()]) for row in rows},
        "curves": {row: _curves(add(v["rows"][row] for v in scored.values())) for row in rows},
        "videos": [_row(name, found[name], v) for name, v in scored.items()],
        "not_scored": dict(sorted(not_scored.items())),
    }


def _settings(
    root: Path, given_frames: int, runs: int, pipeline: PipelineConfig, checkpoint: str, device: str
) -> _Settings:
    """Settings completed from the manifest of the data set. No video is refused for its looks, which are the model's errors."""
    data = CLEVRER(root)
    manifest = data.manifest
    if manifest is None:
        raise DataError(f"{root}: has no manifest.json; expected a data set of `nsdr generate dataset`")
    check_world_of_data(root, data.world, checkpoint, pipeline.world)
    if pipeline.video.check == "refuse":
        pipeline = replace(pipeline, video=replace(pipeline.video, check="warn"))
    return _Settings(given_frames, runs, *made_with(manifest, root), pipeline, checkpoint, str(resolve_device(device)))


def _videos(root: Path, generated: Path, split: str) -> tuple[dict[str, _Video], dict[str, str]]:
    """By name, the videos of the truth that have a continuation, and the reasons why the others are not compared."""
    truths = find_files(root / "truth" / split, "truth_*.json")
    if not truths:
        raise DataError(f"{root / 'truth' / split}: holds no truth_*.json")
    if not generated.is_dir():
        raise DataError(f"{generated}: no such folder; expected one with a video_N.mp4 for each of the truth's videos")
    files: dict[str, Path] = {}
    for path in find_files(generated, "*.mp4"):
        if path.stem in files:
            raise DataError(f"{path} and {files[path.stem]} have one name; expected each video once")
        files[path.stem] = path
    found, missing = {}, {}
    for path in truths:
        name = f"video_{path.stem.removeprefix('truth_')}"
        of_truth = Files(root, path.parent.name, int(path.stem.removeprefix("truth_")))
        seen = next((p for p in (of_truth.video, of_truth.proposals) if p.is_file()), None)
        if name not in files:
            missing[name] = f"{generated} has no {name}.mp4"
        elif seen is None:
            missing[name] = f"{root} has neither the video nor its proposals, which the baselines see"
        else:
            found[name] = _Video(path, seen, files[name])
    return found, missing


def _compare(settings: _Settings, video: _Video, output: Path) -> None:
    """Write the sums of every row for one video to `output`."""
    document, cut = read_truth_file(video.truth), settings.given_frames
    if "violation" in document:
        raise DataError(f"{video.truth}: breaks a law, so its true future is not known")
    if any("mass" not in o for o in document["objects"]):
        raise DataError(f"{video.truth}: has no masses, which Bullet needs")
    rate = settings.pipeline.video.fps or frame_rate(video.generated)
    fps = settings.pipeline.world.timeline.fps
    if abs(rate - fps) > RATE_TOLERANCE:
        remedy = f"write it at {fps}, or give --set video.fps={fps} if its frames are those of the truth, one by one"
        raise VideoError(
            f"{video.generated}: {rate:g} frames per second; expected {fps}, the rate of the truth; {remedy}"
        )
    pipeline = worker_pipeline(settings.checkpoint, settings.pipeline, settings.device)
    world = settings.pipeline.world
    camera = view_of(settings.render, document["seed"], world).camera
    pipeline.world = replace(world, camera=replace(camera, width=world.camera.width, height=world.camera.height))
    generated, seen = (_proposals(pipeline, path) for path in (video.generated, video.seen))
    end = min(generated.n_frames, seen.n_frames)
    if end < cut + MIN_FOLLOWING_FRAMES:
        least = f"expected at least {cut + MIN_FOLLOWING_FRAMES}, of which the first {cut} are given"
        raise VideoError(f"{video.generated}: only {end} frames; {least}")
    true = true_future(document, cut, end)
    if not true.known:
        raise DataError(f"{video.truth}: no object of the first {cut} frames is in the image later")
    perceptions = {GENERATED: pipeline.perceive(proposals=generated), TRUTH: pipeline.perceive(proposals=seen)}
    found = {row: _perceived(p, true) for row, p in perceptions.items()}
    weights = find_checkpoint(settings.checkpoint)
    found |= baselines(seen, pipeline.tracker, weights, true, settings.device)
    runs = {row: bullet_runs(document, true, error, settings.runs, settings.physics) for row, error in FLOORS.items()}
    *others, nearest = runs
    futures = PossibleFutures(runs[nearest], true)
    rows = {row: score(one, true, futures) for row, one in found.items()}
    rows |= {row: add(score(one, true, futures) for one in runs[row]) for row in others}
    rows[nearest] = add(score(one, true, futures, leave_out=r) for r, one in enumerate(runs[nearest]))
    distance = np.linalg.norm(found[GENERATED].location_world - true.location_world, axis=-1)
    off = np.where(true.asked, distance, np.nan).round(4)
    objects = {true.objects[i].name: [None if np.isnan(d) else d for d in off[i].tolist()] for i in true.known}
    notes = {row: list(p.scene.notes) for row, p in perceptions.items() if p.scene.notes}
    write_json(output, {"rows": rows, "objects": objects, "notes": notes})


def _proposals(pipeline: Pipeline, path: Path) -> VideoProposals:
    """Proposals of a video, including frames after jumps that look like cuts, or proposals read from a file."""
    if path.suffix != ".mp4":
        return read_proposals(path)
    return pipeline.proposals(path)[0]


def _perceived(p: Perception, true: TrueFuture) -> Continuation:
    """The continuation that a perceived video shows."""
    assert p.proposals is not None
    assert p.tracks is not None
    collisions = [e for e in p.scene.events if e.kind == "collision"]
    return perceived(p.proposals, p.tracks, collisions, true)


def _summed(sums: Sums) -> dict[str, float]:
    """The sums over all frames."""
    return {name: sum(value) if isinstance(value, list) else value for name, value in sums.items()}


def _value(measure: Measure, sums: Mapping[str, Any]) -> float | None:
    """The value of a measure; None if its denominator is 0."""
    above, below = float(measure.above(sums)), float(measure.below(sums))
    return above / below if below else None


def _measured(videos: Sequence[Sums]) -> dict[str, dict[str, Any]]:
    """Each measure of a row over all videos, with its 95 % interval and the number of videos."""
    summed = [_summed(one) for one in videos]
    table = {}
    for name, measure in MEASURES.items():
        above, below = (np.array([part(one) for one in summed], float) for part in (measure.above, measure.below))
        n, value = int((below > 0).sum()), _value(measure, add(summed))
        intervals = [ratio_interval(above, below)] if n > 1 else []
        if measure.is_share and value is not None:
            # Frames and pairs of one video are not independent, so the number of trials is that of videos.
            intervals += [wilson_interval(value, n), (value, value)]
        interval = (min(low for low, _ in intervals), max(high for _, high in intervals)) if intervals else None
        table[name] = {"value": value, "interval": interval, "videos": n}
    return table


def _curves(sums: Sums) -> dict[str, list[float | None]]:
    """Measures by frame after the cut; None where the denominator is 0."""
    curves = {}
    for name in BY_FRAME:
        above, below = np.broadcast_arrays(MEASURES[name].above(sums), MEASURES[name].below(sums))
        curves[name] = [
            float(a / b) if b else None for a, b in zip(np.atleast_1d(above), np.atleast_1d(below), strict=True)
        ]
    return curves


def _row(name: str, video: _Video, scored: Mapping[str, Any]) -> dict[str, Any]:
    """The entry of a video in the report."""
    values = {row: {m: _value(MEASURES[m], _summed(sums)) for m in MEASURES} for row, sums in scored["rows"].items()}
    return {"name": name, **{k: str(v) for k, v in asdict(video).items()}, **scored, "rows": values}
