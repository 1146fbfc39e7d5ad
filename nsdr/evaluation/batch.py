"""Whole folders of videos or proposals: many processes, resumable, one failure does not stop the others."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

from nsdr import laws
from nsdr.clevrer.files.predictions import predictions_document
from nsdr.clevrer.files.proposals import find_proposals, proposals_document, read_proposals
from nsdr.errors import DataError, VideoError
from nsdr.io import storage
from nsdr.io.decoding import SUFFIXES, find_frame_folders, find_videos
from nsdr.io.device import resolve_device, workers_on
from nsdr.io.files import by_number, write_json
from nsdr.io.fingerprint import fingerprint
from nsdr.io.jobs import Job, Summary, read_output, run_jobs
from nsdr.io.reading import read_json
from nsdr.pipeline import Pipeline, PipelineConfig
from nsdr.question_parser.loading import GRAMMAR
from nsdr.types import VideoProposals

FORMS = ("predictions", "scenes")


def parse_videos(
    videos: str | Path,
    output: str | Path,
    checkpoint: str = "default",
    settings: PipelineConfig | None = None,
    engine: str = "processes",
    workers: int = 0,
    device: str = "auto",
) -> Summary:
    """Write `scene_N.json` and `proposal_N.json` for every video of a folder.

    What an earlier run wrote is kept while its video, the settings, the weights and the code are the same.

    Args:
        videos: folder with MP4, GIF or WebP files, searched recursively; or, if it has none of these, with a folder of PNG or
            JPEG files for each video.
        output: folder to write; `failures.json` in it names what failed and why.
        checkpoint: weights.
        settings: of perception; None for the defaults.
        engine, workers: see `nsdr.io.tasks.run_tasks`; on CUDA, 0 is at most as many as the GPU's memory is enough for.
        device: where the networks of every process run, as in `Pipeline.from_pretrained`.

    Raises:
        DataError: the folder holds no videos, or two that would be written to the same file; or another process writes to
            `output`, or it holds the scenes of other videos with the same numbers.
    """
    paths = find_videos(videos) or find_frame_folders(videos)
    if not paths:
        raise DataError(
            f"{videos}: holds no {', '.join(f'*{suffix}' for suffix in SUFFIXES)}, and no folders of frames"
        )
    found = by_number({str(p.relative_to(videos)): p for p in paths})
    return _run("videos", videos, found, output, checkpoint, settings, engine, workers, device)


def predict_dynamics(
    proposals: str | Path,
    output: str | Path,
    form: str = "predictions",
    checkpoint: str = "default",
    settings: PipelineConfig | None = None,
    engine: str = "processes",
    workers: int = 0,
    device: str = "auto",
) -> Summary:
    """Write the motion and collisions of every proposal file: observed, after the video, and with each object removed.

    Args:
        proposals: folder with `proposal_N.json` or `sim_N.json` (also gzipped), one such file, or a compact NPZ.
        output: folder to write, as in `parse_videos`, like the other arguments.
        form: "predictions" writes the research code's `sim_N.json`, which the released executor reads; "scenes" writes our
            `scene_N.json`.

    Raises:
        DataError: an unknown form, no proposals, or two files that would be written to the same one; or another process
            writes to `output`.
    """
    if form not in FORMS:
        raise DataError(f"form is {form!r}; expected one of {', '.join(FORMS)}")
    found = find_proposals(proposals)
    return _run(form, proposals, found, output, checkpoint, settings, engine, workers, device)


def judge_videos(
    videos: Sequence[str | Path],
    report: str | Path,
    checkpoint: str = "default",
    settings: PipelineConfig | None = None,
    engine: str = "processes",
    workers: int = 0,
    device: str = "auto",
) -> list[dict[str, Any]]:
    """Judge videos and write all that `judged` says of each to `report`, in their order.

    A folder beside the report, of its name without `.json`, keeps `judgement_NAME.json` of each video; what an earlier run
    wrote is kept while the video, the settings, the weights and the code are the same.

    Args:
        videos: files, animated images or folders of frames.
        report: file to write, .json.
        checkpoint, settings, engine, workers, device: see `parse_videos`.

    Raises:
        DataError: two videos have one name, or one has the folder's; or another process writes to the folder.
    """
    folder, settings = Path(report).with_suffix(""), settings or PipelineConfig()
    common = settings.fingerprint(checkpoint, "judgements", str(laws.VERSION)).encode()
    jobs: dict[str, Job[Path]] = {}
    for video in map(Path, videos):
        name = video.name
        if name in jobs and jobs[name].item != video:
            raise DataError(f"{jobs[name].item} and {video}: both are {name}; rename one, or write two reports")
        if video.resolve() == folder.resolve():
            raise DataError(f"{report}: {video} would get the judgements; give the report another name")
        key = fingerprint(inputs=[video if video.is_file() or video.is_dir() else str(video).encode(), common])
        jobs[name] = Job(str(video), video, folder / f"judgement_{name}.json", key)
    place = resolve_device(device)
    function = partial(_judge, checkpoint, settings, str(place))
    summary = run_jobs(function, list(jobs.values()), folder, engine, workers_on(place, workers))
    failed = summary.failed
    rows = [
        {"video": j.name, "error": failed[j.name]}
        if j.name in failed
        else read_output(j, partial(read_json, kind=dict[str, Any]), function)
        for j in jobs.values()
    ]
    write_json(report, rows, indent=1)
    return rows


def _judge(checkpoint: str, settings: PipelineConfig, device: str, video: Path, output: Path) -> None:
    write_json(output, judged(worker_pipeline(checkpoint, settings, device), video))


def judged(pipeline: Pipeline, video: str | Path) -> dict[str, Any]:
    """A row of a report: `video`, and the fields of its `Judgement` or, where it cannot be judged, the reason (`error`)."""
    try:
        found = asdict(pipeline.judge(video))
    except VideoError as e:
        found = {"error": str(e)}
    return {"video": str(video), **found}


def _run(
    form: str,
    source: str | Path,
    found: Mapping[str, tuple[str, Any]],
    output: str | Path,
    checkpoint: str,
    settings: PipelineConfig | None,
    engine: str,
    workers: int,
    device: str,
) -> Summary:
    settings = settings or PipelineConfig()
    common = settings.fingerprint(checkpoint, form).encode()
    stem = "sim" if form == "predictions" else "scene"
    jobs = [
        Job(
            name,
            item,
            Path(output) / f"{stem}_{number}.json",
            fingerprint(inputs=[item, common]),
            item if isinstance(item, Path) else Path(source),
        )
        for number, (name, item) in found.items()
    ]
    place = resolve_device(device)
    function = partial(_write, checkpoint, settings, str(place), form)
    return run_jobs(function, jobs, output, engine, workers_on(place, workers))


@lru_cache(maxsize=1)
def worker_pipeline(checkpoint: str, settings: PipelineConfig, device: str) -> Pipeline:
    """The pipeline of a worker process, loaded once. It is asked no questions, so it parses none."""
    settings = replace(settings, question_parser=GRAMMAR, extensions=False)
    return Pipeline.from_pretrained(checkpoint, config=settings, device=device)


def _write(
    checkpoint: str, settings: PipelineConfig, device: str, form: str, source: Path | VideoProposals, path: Path
) -> None:
    """Write what `form` says of a video, a file of proposals, or proposals; last the file that marks it as done."""
    pipeline = worker_pipeline(checkpoint, settings, device)
    if form == "videos":
        assert isinstance(source, Path)
        perception = pipeline.perceive(source)
        assert perception.proposals is not None
        proposals_path = path.with_name(path.name.replace("scene_", "proposal_"))
        write_json(proposals_path, proposals_document(perception.proposals, source.name))
    else:
        proposals = read_proposals(source) if isinstance(source, Path) else source
        perception = pipeline.perceive(proposals=proposals)
    if form == "predictions":
        assert perception.explanation is not None
        write_json(path, predictions_document(perception.explanation.prediction))
    else:
        storage.save(path, perception.scene)
