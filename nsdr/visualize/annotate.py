"""Images of what the system saw."""

import colorsys
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from pycocotools import mask as rle

from nsdr.types import Scene, VideoProposals, VideoTracks
from nsdr.world.camera import HEIGHT_PX, WIDTH_PX
from nsdr.world.vocabulary import COLORS_RGB, attributes_of

__all__ = ["annotated_image"]

SCALE = 2
FONT = cv2.FONT_HERSHEY_SIMPLEX
Box = tuple[int, int, int, int]


def annotated_image(
    frame: NDArray[np.uint8], frame_index: int, proposals: VideoProposals | None, tracks: VideoTracks, scene: Scene
) -> NDArray[np.uint8]:
    """One frame with masks, object names and ids, motion trails up to the frame, and where objects collided until then.

    Args:
        frame: (320, 480, 3) uint8 RGB.
        frame_index: its index in the video.
        proposals: for the masks' outlines; None leaves them out.
        tracks: for trails and names.
        scene: for the collisions.

    Returns:
        (640, 960, 3) uint8 RGB.
    """
    image = cv2.resize(frame, (WIDTH_PX * SCALE, HEIGHT_PX * SCALE), interpolation=cv2.INTER_CUBIC)
    if proposals is not None and proposals.masks is not None:
        for row in np.flatnonzero(proposals.frame_index == frame_index):
            color = _bright(attributes_of(int(proposals.attribute[row]))[0])
            _draw_outline(image, proposals.masks[row], color)
    for t in tracks.tracks:
        until = t.frame_index <= frame_index
        if until.any():
            _draw_trail(image, t.centroid_px[until], _bright(t.object.color))
    taken: list[Box] = []
    for t in sorted(tracks.tracks, key=lambda t: -int(t.box_xyxy_px[-1, 1])):  # nearer ones keep their position
        here = np.flatnonzero(t.frame_index == frame_index)
        if len(here):
            x0, y0 = (t.box_xyxy_px[here[0], :2] * SCALE).tolist()
            text = f"{t.object.id} {t.object.name}"
            _draw_text(image, text, _free_position(image, text, (x0, y0 - 6), taken), _bright(t.object.color))
    for number, event in enumerate((e for e in scene.events if e.kind == "collision"), 1):
        if event.frame <= frame_index:
            _draw_collision(image, event.frame, [tracks.tracks[i] for i in event.objects], number, taken)
    _draw_text(image, f"frame {frame_index}", (8, HEIGHT_PX * SCALE - 10), (255, 255, 255))
    return image  # type: ignore[return-value]


def _bright(color: str) -> tuple[int, int, int]:
    """A light version of an object's colour that can be read on gray."""
    hue, _, saturation = colorsys.rgb_to_hls(*(c / 255 for c in COLORS_RGB[color]))
    red, green, blue = colorsys.hls_to_rgb(hue, 0.72, saturation)
    return round(red * 255), round(green * 255), round(blue * 255)


def _scaled(points_px: Any) -> NDArray[np.int32]:
    return np.round(np.asarray(points_px, float) * SCALE).astype(np.int32)


def _draw_outline(image: NDArray[Any], counts: str, color: tuple[int, int, int]) -> None:
    mask = rle.decode({"size": [HEIGHT_PX, WIDTH_PX], "counts": counts.encode()})
    large = cv2.resize(mask, (WIDTH_PX * SCALE, HEIGHT_PX * SCALE), interpolation=cv2.INTER_LINEAR)
    contours, _ = cv2.findContours(large, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    cv2.drawContours(image, contours, -1, color, 2, cv2.LINE_AA)


def _draw_trail(image: NDArray[Any], centroids_px: NDArray[Any], color: tuple[int, int, int]) -> None:
    points = _scaled(centroids_px)
    cv2.polylines(image, [points.reshape(-1, 1, 2)], False, color, 2, cv2.LINE_AA)
    for point in points[::8]:
        cv2.circle(image, point.tolist(), 3, color, -1, cv2.LINE_AA)


def _draw_collision(image: NDArray[Any], frame: int, pair: list[Any], number: int, taken: list[Box]) -> None:
    positions = [t.centroid_px[int(np.abs(t.frame_index - frame).argmin())] for t in pair]
    centre = _scaled(np.mean(positions, 0)).tolist()
    cv2.drawMarker(image, centre, (255, 255, 255), cv2.MARKER_STAR, 22, 2, cv2.LINE_AA)
    text = f"{number}: hit at {frame}"
    _draw_text(image, text, _free_position(image, text, (centre[0] + 12, centre[1] + 4), taken), (255, 255, 255))


def _draw_text(image: NDArray[Any], text: str, position: tuple[int, int], color: tuple[int, int, int]) -> None:
    x, y = position
    for dx, dy in ((-1, 0), (1, 0), (0, -1), (0, 1), (1, 1)):  # a dark rim: readable on any ground
        cv2.putText(image, text, (x + dx, y + dy), FONT, 0.5, (20, 20, 20), 1, cv2.LINE_AA)
    cv2.putText(image, text, position, FONT, 0.5, color, 1, cv2.LINE_AA)


def _free_position(image: NDArray[Any], text: str, position: tuple[int, int], taken: list[Box]) -> tuple[int, int]:
    """The position for a text, inside the image and moved up until it overlaps no other."""
    (width, height), _ = cv2.getTextSize(text, FONT, 0.5, 1)
    x = min(max(position[0], 2), image.shape[1] - width - 2)
    y = max(position[1], height + 2)
    while y > height + 2 and any(x < b[2] and b[0] < x + width and y - height < b[3] and b[1] < y for b in taken):
        y -= 2
    taken.append((x, y - height - 4, x + width, y + 2))
    return x, y
