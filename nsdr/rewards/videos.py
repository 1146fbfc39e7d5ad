"""The judge as a reward for models that make videos of CLEVRER's world."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from nsdr.errors import VideoError
from nsdr.io.images import VideoSource, video_of
from nsdr.pipeline import Pipeline
from nsdr.tracking.tracker import track
from nsdr.types import LAWS, VideoTracks

ENOUGH_MOTION = 4.0
"""Motion for the whole reward (the sum over objects; world units in CLEVRER): each of 80 simulated scenes of CLEVRER's kind has
more."""
LEAST_MOTION = 0.4
"""An object that moves less than the width of the narrowest one is at rest (world units in CLEVRER)."""


@dataclass(frozen=True)
class Lawfulness:
    """What a video earns, and why.

    Attributes:
        reward: the probability that no law is broken, times `motion` (0-1); 0 where the video cannot be judged.
        laws: for each of `nsdr.types.LAWS`, 1 less the probability of its most probable violation. Violations that are less
            probable than not count in `reward` alone.
        motion: how far objects move, as a share of `ENOUGH_MOTION` (0-1).
        problem: why the video cannot be judged, such as objects that are not CLEVRER's; "" if it can.
    """

    reward: float
    laws: Mapping[str, float]
    motion: float
    problem: str = ""


def lawfulness(frames: VideoSource, pipeline: Pipeline | None = None) -> float:
    """What a video earns (0-1): `Lawfulness.reward`.

    Args:
        frames: (F, height, width, 3) uint8 RGB at 25 frames a second, in memory; or a video's path.
        pipeline: perceives the video; the shipped one, on the CPU, if None.

    Raises:
        DataError: frames of another shape or dtype.
    """
    return lawfulness_parts([frames], pipeline)[0].reward


def lawfulness_parts(videos: Iterable[VideoSource], pipeline: Pipeline | None = None) -> list[Lawfulness]:
    """What each of several videos earns, law by law. Arguments and errors are those of `lawfulness`."""
    pipeline = pipeline or _shipped()
    return [_earned(video, pipeline) for video in videos]


def _earned(source: VideoSource, pipeline: Pipeline) -> Lawfulness:
    video = video_of(source)
    try:
        judgement = pipeline.judge(video)
    except VideoError as e:
        return Lawfulness(0.0, dict.fromkeys(LAWS, 0.0), 0.0, str(e))
    moved, size = track(pipeline.proposals(video)[0], pipeline.tracker), pipeline.world.scales.size
    motion = min(_motion(moved) / (ENOUGH_MOTION * size), 1.0)
    laws = dict.fromkeys(LAWS, 1.0)
    for violation in judgement.violations:
        laws[violation.law] = min(laws[violation.law], 1 - violation.probability)
    return Lawfulness((1 - judgement.probability) * motion, laws, motion)


def _motion(tracks: VideoTracks) -> float:
    """The sum of the distances between each object's first place and the place farthest from it (world units)."""
    moved = [np.linalg.norm(t.location_world - t.location_world[:1], axis=1).max(initial=0) for t in tracks.tracks]
    return float(sum(distance for distance in moved if distance >= LEAST_MOTION * tracks.world.scales.size))


@lru_cache(maxsize=1)
def _shipped() -> Pipeline:
    return Pipeline.from_pretrained()
