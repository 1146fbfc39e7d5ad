"""The annotated video: masks, names, trails, and a flash at every collision."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from nsdr.types import Scene, VideoProposals, VideoTracks
from nsdr.visualize.picture import SCALE, annotated_picture

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
    from nsdr.generate.encode import write_video

    def pictures() -> Iterator[NDArray[np.uint8]]:
        for index, frame in enumerate(frames):
            picture = annotated_picture(frame, index, proposals, tracks, scene)
            for event in scene.events:
                age = index - event.frame
                if event.kind == "collision" and 0 <= age < FLASH_FRAMES:
                    _flash(picture, [tracks.tracks[i] for i in event.objects], event.frame, age)
            yield picture

    write_video(path, pictures())


def _flash(picture: NDArray[Any], pair: list[Any], frame: int, age: int) -> None:
    places = [t.centroid_px[int(np.abs(t.frame_index - frame).argmin())] for t in pair]
    centre = np.round(np.mean(places, 0) * SCALE).astype(int).tolist()
    layer = picture.copy()
    cv2.circle(layer, centre, 14 + 5 * age, (255, 240, 160), 5, cv2.LINE_AA)
    strength = 0.9 * (1 - age / FLASH_FRAMES)
    picture[:] = np.round(layer * strength + picture * (1 - strength)).astype(np.uint8)
