"""The annotated video: masks, names and trails in every frame, and a flash at every collision."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from nsdr.io.video import write_video
from nsdr.types import Scene, VideoProposals, VideoTracks
from nsdr.visualize.annotate import SCALE, annotated_image

__all__ = ["write_annotated_video"]

FLASH_FRAMES = 8
"""Frames over which a collision's flash fades."""
FLASH_RADIUS_PX = 14
"""Radius of the flash in the collision's frame (pixels of the annotated image)."""
FLASH_GROWTH_PX = 5
"""Growth of the flash's radius per frame (pixels of the annotated image)."""
FLASH_LINE_WIDTH_PX = 5
"""Line width of the flash (pixels of the annotated image)."""
FLASH_COLOR = (255, 240, 160)
"""Colour of the flash, RGB."""
FLASH_OPACITY = 0.9
"""Opacity of the flash in the collision's frame."""


def write_annotated_video(
    path: str | Path,
    frames: NDArray[np.uint8],
    proposals: VideoProposals | None,
    tracks: VideoTracks,
    scene: Scene,
    preset: str = "slow",
) -> None:
    """Write an mp4 of twice the video's width and height.

    Args:
        path: file to write.
        frames: (T, 320, 480, 3) uint8 RGB.
        proposals: masks whose outlines are drawn; None draws no outlines.
        tracks: objects whose names and trails are drawn.
        scene: source of the collisions.
        preset: as of `nsdr.io.video.write_video`.

    Raises:
        DataError: PyAV is missing.
    """

    def images() -> Iterator[NDArray[np.uint8]]:
        for index, frame in enumerate(frames):
            image = annotated_image(frame, index, proposals, tracks, scene)
            for event in scene.events:
                age = index - event.frame
                if event.kind == "collision" and 0 <= age < FLASH_FRAMES:
                    _draw_flash(image, [tracks.tracks[i] for i in event.objects], event.frame, age)
            yield image

    write_video(path, images(), preset=preset)


def _draw_flash(image: NDArray[Any], pair: list[Any], frame_index: int, age: int) -> None:
    """Draw the flash of a collision at `frame_index`, `age` frames later."""
    positions = [t.centroid_px[int(np.abs(t.frame_index - frame_index).argmin())] for t in pair]
    center = np.round(np.mean(positions, 0) * SCALE).astype(int).tolist()
    layer = image.copy()
    radius = FLASH_RADIUS_PX + FLASH_GROWTH_PX * age
    cv2.circle(layer, center, radius, FLASH_COLOR, FLASH_LINE_WIDTH_PX, cv2.LINE_AA)
    opacity = FLASH_OPACITY * (1 - age / FLASH_FRAMES)
    image[:] = np.round(layer * opacity + image * (1 - opacity)).astype(np.uint8)
