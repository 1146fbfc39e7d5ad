"""The stroboscopic image of the paper's figures: one frame in which every object leaves copies of itself along its way."""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from pycocotools import mask as rle

from nsdr.types import VideoProposals, VideoTracks
from nsdr.world.camera import HEIGHT_PX, WIDTH_PX

__all__ = ["stroboscopic_image"]

MIN_MOVE_PX = 6.0
"""Copies nearer to the next one than this would only blur it."""


def stroboscopic_image(
    frames: NDArray[np.uint8], proposals: VideoProposals, tracks: VideoTracks, every: int = 12, scale: int = 2
) -> NDArray[np.uint8]:
    """The last frame with earlier copies of all moving objects, the older the fainter.

    Args:
        frames: (T, 320, 480, 3) uint8 RGB.
        proposals: with masks.
        tracks: of the same video.
        every: frames between two copies.
        scale: of the image's size.

    Returns:
        (320 scale, 480 scale, 3) uint8 RGB.
    """
    image: NDArray[Any] = frames[-1].astype(float)
    masks = _masks_of(proposals, tracks)
    last = len(frames) - 1
    for frame in range(last % every, last, every):
        strength = 0.35 + 0.5 * frame / last
        for track, rows in zip(tracks.tracks, masks, strict=True):
            here, later = _position(track, frame), _position(track, min(frame + every, last))
            if frame not in rows or here is None or later is None or np.linalg.norm(here - later) < MIN_MOVE_PX:
                continue
            image = _laid_on(image, frames[frame], rows[frame], strength)
    for track, rows in zip(tracks.tracks, masks, strict=True):  # the present lies on top
        if last in rows and track.frame_index[-1] == last:
            image = _laid_on(image, frames[last], rows[last], 1.0)
    size = (WIDTH_PX * scale, HEIGHT_PX * scale)
    return np.asarray(cv2.resize(image.round().astype(np.uint8), size, interpolation=cv2.INTER_CUBIC), np.uint8)


def _position(track: Any, frame: int) -> NDArray[Any] | None:
    if not track.frame_index[0] <= frame <= track.frame_index[-1]:
        return None
    return np.array([np.interp(frame, track.frame_index, track.centroid_px[:, k]) for k in range(2)])


def _masks_of(proposals: VideoProposals, tracks: VideoTracks) -> list[dict[int, str]]:
    """For each track its masks by frame: the proposal at the same box."""
    if proposals.masks is None:
        return [{} for _ in tracks.tracks]
    by_position = {
        (int(f), *map(int, box)): mask
        for f, box, mask in zip(proposals.frame_index, proposals.box_xyxy_px, proposals.masks, strict=True)
    }
    found = []
    for t in tracks.tracks:
        keys = [(int(f), *map(int, box)) for f, box in zip(t.frame_index, t.box_xyxy_px, strict=True)]
        found.append({key[0]: by_position[key] for key in keys if key in by_position})
    return found


def _laid_on(image: NDArray[Any], frame: NDArray[Any], counts: str, strength: float) -> NDArray[Any]:
    """The image with the masked part of a frame on it, as strong as given."""
    mask = np.asarray(rle.decode({"size": [HEIGHT_PX, WIDTH_PX], "counts": counts.encode()}), np.float32)
    cover = cv2.GaussianBlur(mask, (3, 3), 0)[..., None] * strength
    return np.asarray(image * (1 - cover) + frame * cover)
