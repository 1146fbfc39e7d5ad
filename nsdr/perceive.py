"""Whole folders of videos -> scenes: many processes, resumable, one failure does not stop the rest."""

from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path

from tqdm import tqdm

from nsdr import storage
from nsdr.clevrer.proposals import proposals_document
from nsdr.errors import DataError
from nsdr.files import write_json
from nsdr.parallel import run_tasks
from nsdr.pipeline import Pipeline

__all__ = ["Summary", "parse_videos"]


@dataclass(frozen=True)
class Summary:
    """What became of the videos: names done now, names done before, and the errors of those that failed."""

    done: tuple[str, ...]
    skipped: tuple[str, ...]
    failed: dict[str, str]


def parse_videos(
    videos: str | Path,
    output: str | Path,
    checkpoint: str = "default",
    stride: int = 1,
    engine: str = "processes",
    workers: int = 0,
) -> Summary:
    """Write `scene_N.json` and `proposal_N.json` for every video of a folder; those that are there already are skipped.

    Args:
        videos: folder with `*.mp4`, searched below, too.
        output: folder to write; `failures.json` in it names what failed and why.
        checkpoint: weights.
        stride: of the frame parser.
        engine: "processes" or "ray".
        workers: processes, 0 for one a CPU core.

    Raises:
        DataError: the folder holds no videos.
    """
    output = Path(output)
    paths = sorted(Path(videos).rglob("*.mp4"))
    if not paths:
        raise DataError(f"{videos}: holds no *.mp4")
    skipped = [p for p in paths if _scene_path(output, p).exists()]
    left = [p for p in paths if p not in set(skipped)]
    done, failed = [], {}
    outcomes = run_tasks(partial(_parse_video, str(output), checkpoint, stride), left, engine, workers)
    for outcome in tqdm(outcomes, total=len(paths), initial=len(skipped), unit="video", desc="videos"):
        if outcome.error:
            failed[outcome.item.name] = outcome.error
        else:
            done.append(outcome.item.name)
    write_json(output / "failures.json", dict(sorted(failed.items())), indent=1)
    return Summary(tuple(sorted(done)), tuple(p.name for p in skipped), failed)


def _scene_path(output: Path, video: Path) -> Path:
    return output / f"scene_{video.stem.removeprefix('video_')}.json"


@lru_cache(maxsize=1)
def _pipeline(checkpoint: str, stride: int) -> Pipeline:
    pipeline = Pipeline.from_pretrained(checkpoint)
    pipeline.frame_parser.stride = stride
    return pipeline


def _parse_video(output: str, checkpoint: str, stride: int, video: Path) -> None:
    perception = _pipeline(checkpoint, stride).perception(video)
    number = "".join(c for c in video.stem if c.isdigit())
    assert perception.proposals is not None
    document = proposals_document(perception.proposals, int(number or 0), video.name)
    write_json(Path(output) / f"proposal_{video.stem.removeprefix('video_')}.json", document)
    storage.save(perception.scene, _scene_path(Path(output), video))  # last: it marks the video as done
