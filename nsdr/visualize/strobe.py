"""The stroboscopic image of the paper's figures: one frame with earlier copies of every moving object."""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from pycocotools import mask as rle

from nsdr.types import VideoProposals, VideoTracks
from nsdr.world.camera import HEIGHT_PX, WIDTH_PX

__all__ = ["stroboscopic_image"]

EVERY = 12
"""Default number of frames between two copies."""
MIN_DISPLACEMENT_PX = 6.0
"""A copy closer than this to the next one is left out, because it would only blur it (pixels of the video)."""
MIN_OPACITY = 0.35
"""Opacity of a copy of the first frame."""
OPACITY_RANGE = 0.5
"""Increase of a copy's opacity from the first to the last frame."""
SOFT_EDGE_PX = 3
"""Width of the Gaussian kernel that softens the edge of a copy (pixels of the video)."""


def stroboscopic_image(
    frames: NDArray[np.uint8], proposals: VideoProposals, tracks: VideoTracks, every: int = EVERY, scale: int = 2
) -> NDArray[np.uint8]:
    """The last frame with earlier copies of all moving objects; older copies are fainter.

    Args:
        frames: (T, 320, 480, 3) uint8 RGB.
        proposals: masks of the objects; without masks no copies are drawn.
        tracks: of the same video.
        every: frames between two copies.
        scale: size of the image relative to the frames.

    Returns:
        (320 scale, 480 scale, 3) uint8 RGB.
    """
    image: NDArray[Any] = frames[-1].astype(float)
    masks = _masks_by_frame(proposals, tracks)
    last = len(frames) - 1
    for frame in range(last % every, last, every):
        opacity = MIN_OPACITY + OPACITY_RANGE * frame / last
        for track, counts in zip(tracks.tracks, masks, strict=True):
            now, later = _position_px(track, frame), _position_px(track, min(frame + every, last))
            if frame not in counts or now is None or later is None:
                continue
            if np.linalg.norm(now - later) >= MIN_DISPLACEMENT_PX:
                image = _blended(image, frames[frame], counts[frame], opacity)
    for track, counts in zip(tracks.tracks, masks, strict=True):  # the last frame's objects are on top
        if last in counts and track.frame_index[-1] == last:
            image = _blended(image, frames[last], counts[last], 1.0)
    size = (WIDTH_PX * scale, HEIGHT_PX * scale)
    return np.asarray(cv2.resize(image.round().astype(np.uint8), size, interpolation=cv2.INTER_CUBIC), np.uint8)


def _position_px(track: Any, frame_index: int) -> NDArray[Any] | None:
    """The track's interpolated centroid at a frame; None before its first and after its last frame."""
    if not track.frame_index[0] <= frame_index <= track.frame_index[-1]:
        return None
    return np.array([np.interp(frame_index, track.frame_index, track.centroid_px[:, k]) for k in range(2)])


def _masks_by_frame(proposals: VideoProposals, tracks: VideoTracks) -> list[dict[int, str]]:
    """For each track its run-length masks by frame: those of the proposals with the same frame and box."""
    if proposals.masks is None:
        return [{} for _ in tracks.tracks]
    by_frame_and_box = {
        (int(f), *map(int, box)): mask
        for f, box, mask in zip(proposals.frame_index, proposals.box_xyxy_px, proposals.masks, strict=True)
    }
    masks = []
    for t in tracks.tracks:
        keys = [(int(f), *map(int, box)) for f, box in zip(t.frame_index, t.box_xyxy_px, strict=True)]
        masks.append({key[0]: by_frame_and_box[key] for key in keys if key in by_frame_and_box})
    return masks


def _blended(image: NDArray[Any], frame: NDArray[Any], counts: str, opacity: float) -> NDArray[Any]:
    """The image with the masked part of a frame laid over it."""
    mask = np.asarray(rle.decode({"size": [HEIGHT_PX, WIDTH_PX], "counts": counts.encode()}), np.float32)
    alpha = cv2.GaussianBlur(mask, (SOFT_EDGE_PX, SOFT_EDGE_PX), 0)[..., None] * opacity
    return np.asarray(image * (1 - alpha) + frame * alpha)
