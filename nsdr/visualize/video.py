"""The annotated video: masks, names, trails, and a flash at every collision."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from nsdr.types import Scene, VideoProposals, VideoTracks
from nsdr.visualize.annotate import SCALE, annotated_image

__all__ = ["write_annotated_video"]

FLASH_FRAMES = 8


def write_annotated_video(
    path: str | Path, frames: NDArray[np.uint8], proposals: VideoProposals, tracks: VideoTracks, scene: Scene
) -> None:
    """Write an mp4 of twice the video's size.

    Args:
        path: file to write.
        frames: (T, 320, 480, 3) uint8 RGB.
        proposals, tracks, scene: what was found out.

    Raises:
        DataError: PyAV is missing.
    """
    from nsdr.io.video import write_video

    def images() -> Iterator[NDArray[np.uint8]]:
        for index, frame in enumerate(frames):
            image = annotated_image(frame, index, proposals, tracks, scene)
            for event in scene.events:
                age = index - event.frame
                if event.kind == "collision" and 0 <= age < FLASH_FRAMES:
                    _flash(image, [tracks.tracks[i] for i in event.objects], event.frame, age)
            yield image

    write_video(path, images())


def _flash(image: NDArray[Any], pair: list[Any], frame: int, age: int) -> None:
    positions = [t.centroid_px[int(np.abs(t.frame_index - frame).argmin())] for t in pair]
    centre = np.round(np.mean(positions, 0) * SCALE).astype(int).tolist()
    layer = image.copy()
    cv2.circle(layer, centre, 14 + 5 * age, (255, 240, 160), 5, cv2.LINE_AA)
    strength = 0.9 * (1 - age / FLASH_FRAMES)
    image[:] = np.round(layer * strength + image * (1 - strength)).astype(np.uint8)
