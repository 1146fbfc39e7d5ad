"""Frames and videos annotated with masks, object names, trails and collisions; and a video as a stroboscopic image."""

import colorsys
from itertools import product
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from pycocotools import mask as rle

from nsdr.errors import DataError
from nsdr.io.files import write_file
from nsdr.io.video import write_video
from nsdr.tracking.tracker import rows_of
from nsdr.types import Event, Scene, VideoProposals, VideoTracks
from nsdr.world.vocabulary import Color as ObjectColor

IMAGE_SUFFIXES = (".png", ".jpg")
"""Endings of image files."""

SCALE = 2
"""Size of an annotated image relative to the video's frames. All sizes below are pixels of the annotated image."""
LIGHTNESS = 0.72
"""HLS lightness of the annotation colours; the hue is the object's."""
LINE_WIDTH_PX, RIM_WIDTH_PX, STAR_SIZE_PX = 2, 2, 22
"""Width of outlines and trails, width of the rim of text, and size of the star that marks a collision."""
TRAIL_DOT_EVERY, TRAIL_DOT_RADIUS_PX = 8, 3
"""Frames between two dots on a trail, and their radius."""
FONT, FONT_SCALE = cv2.FONT_HERSHEY_SIMPLEX, 0.8
WHITE, RIM_COLOR = (255, 255, 255), (20, 20, 20)
"""Colours of text, and of the rim that keeps it readable on any background."""
TEXT_MARGIN_PX = 2
"""Minimum distance of a text from the image border, and step by which overlapping texts are moved up."""

STROBE_EVERY = 12
"""Frames between two copies of a stroboscopic image."""
MIN_DISPLACEMENT_PX = 6.0
"""A copy closer than this to the next one is left out, because it would only blur it (pixels of the video)."""
MIN_OPACITY, OPACITY_RANGE = 0.35, 0.5
"""Opacity of a copy of the first frame, and how much more a copy of the last one has."""
SOFT_EDGE_PX = 3
"""Width of the Gaussian kernel that softens the edge of a copy (pixels of the video)."""

Box = tuple[int, int, int, int]
"""x0, y0, x1, y1 in pixels of the annotated image."""
Color = tuple[int, int, int]
"""Red, green, blue; 0 to 255."""


def annotated_image(
    frame: NDArray[np.uint8], frame_index: int, proposals: VideoProposals | None, tracks: VideoTracks, scene: Scene
) -> NDArray[np.uint8]:
    """One frame with masks, object names and ids, and the trails and collisions up to that frame.

    Args:
        frame: (height, width, 3) uint8 RGB.
        frame_index: the frame's index in the video.
        proposals: masks whose outlines are drawn; None draws no outlines.
        tracks: objects whose names and trails are drawn.
        scene: source of the collisions.

    Returns:
        uint8 RGB of twice the height and width.
    """
    words, (height, width) = tracks.world.vocabulary, frame.shape[:2]
    image = cv2.resize(frame, (width * SCALE, height * SCALE), interpolation=cv2.INTER_CUBIC)
    if proposals is not None and proposals.masks is not None:
        for row in np.flatnonzero(proposals.frame_index == frame_index):
            color = _annotation_color(words.color(words.triple(int(proposals.attribute[row]))[0]))
            _draw_outline(image, proposals.masks[row], color)
    for t in tracks.tracks:
        until_now = t.frame_index <= frame_index
        if until_now.any():
            _draw_trail(image, t.centroid_px[until_now], _annotation_color(words.color(t.object.color)))
    occupied: list[Box] = []
    # Nearer objects, which are lower in the image, are labelled first and so keep the position above their box.
    for t in sorted(tracks.tracks, key=lambda t: -int(t.box_xyxy_px[-1, 1])):
        now = np.flatnonzero(t.frame_index == frame_index)
        if len(now):
            x0, y0 = (t.box_xyxy_px[now[0], :2] * SCALE).tolist()
            text = f"{t.object.id} {t.object.name}"
            position = _free_position(image, text, (x0, y0 - 6), occupied)
            _draw_text(image, text, position, _annotation_color(words.color(t.object.color)))
    for number, event in enumerate((e for e in scene.events if e.kind == "collision"), 1):
        if event.frame <= frame_index:
            _draw_collision(image, event, tracks, number, occupied)
    _draw_text(image, f"frame {frame_index}", (8, height * SCALE - 10), WHITE)
    return image  # type: ignore[return-value]


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
        frames: (T, height, width, 3) uint8 RGB.
        proposals, tracks, scene: see `annotated_image`.
        preset: see `nsdr.io.video.write_video`.

    Raises:
        DataError: PyAV is missing.
    """

    images = (annotated_image(frame, f, proposals, tracks, scene) for f, frame in enumerate(frames))
    write_video(path, images, scene.world.timeline.fps, preset=preset)


def write_image(path: str | Path, image: NDArray[np.uint8]) -> None:
    """Write an RGB image (H, W, 3), atomically; missing folders are created.

    Args:
        path: file ending in .png or .jpg; what is no regular file gets a PNG.
        image: uint8 RGB.

    Raises:
        DataError: another ending.
        MachineError: the file cannot be written.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in IMAGE_SUFFIXES:
        if Path(path).is_file() or not Path(path).exists():
            raise DataError(f"{path}: cannot write an image; expected a name ending in {' or '.join(IMAGE_SUFFIXES)}")
        suffix = IMAGE_SUFFIXES[0]
    done, encoded = cv2.imencode(suffix, image[..., ::-1])
    if not done:
        raise DataError(f"{path}: the image of shape {image.shape} cannot be encoded as {suffix}")
    write_file(path, encoded.tobytes())


def _annotation_color(color: ObjectColor) -> Color:
    """A light version of an object's colour, readable on the gray ground."""
    hue, _, saturation = colorsys.rgb_to_hls(*(c / 255 for c in color.srgb))
    red, green, blue = colorsys.hls_to_rgb(hue, LIGHTNESS, saturation)
    return round(red * 255), round(green * 255), round(blue * 255)


def _scaled(points_px: Any) -> NDArray[np.int32]:
    """Frame pixels as integer pixels of the annotated image."""
    return np.round(np.asarray(points_px, float) * SCALE).astype(np.int32)


def _draw_outline(image: NDArray[Any], counts: str, color: Color) -> None:
    height, width = image.shape[0] // SCALE, image.shape[1] // SCALE
    mask = rle.decode({"size": [height, width], "counts": counts.encode()})
    large = cv2.resize(mask, (width * SCALE, height * SCALE), interpolation=cv2.INTER_LINEAR)
    contours, _ = cv2.findContours(large, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    cv2.drawContours(image, contours, -1, color, LINE_WIDTH_PX, cv2.LINE_AA)


def _draw_trail(image: NDArray[Any], centroids_px: NDArray[Any], color: Color) -> None:
    points = _scaled(centroids_px)
    cv2.polylines(image, [points.reshape(-1, 1, 2)], False, color, LINE_WIDTH_PX, cv2.LINE_AA)
    for point in points[::TRAIL_DOT_EVERY]:
        cv2.circle(image, point.tolist(), TRAIL_DOT_RADIUS_PX, color, -1, cv2.LINE_AA)


def _draw_collision(image: NDArray[Any], event: Event, tracks: VideoTracks, number: int, occupied: list[Box]) -> None:
    pair = [tracks.tracks[i] for i in event.objects]
    places = [t.centroid_px[int(np.abs(t.frame_index - event.frame).argmin())] for t in pair]
    center = _scaled(np.mean(places, 0)).tolist()
    cv2.drawMarker(image, center, WHITE, cv2.MARKER_STAR, STAR_SIZE_PX, LINE_WIDTH_PX, cv2.LINE_AA)
    text = f"{number}: hit at {event.frame}"
    _draw_text(image, text, _free_position(image, text, (center[0] + 12, center[1] + 4), occupied), WHITE)


def _draw_text(image: NDArray[Any], text: str, position: tuple[int, int], color: Color) -> None:
    x, y = position
    for dx, dy in product((-RIM_WIDTH_PX, 0, RIM_WIDTH_PX), repeat=2):
        cv2.putText(image, text, (x + dx, y + dy), FONT, FONT_SCALE, RIM_COLOR, 1, cv2.LINE_AA)
    cv2.putText(image, text, position, FONT, FONT_SCALE, color, 1, cv2.LINE_AA)


def _free_position(image: NDArray[Any], text: str, position: tuple[int, int], occupied: list[Box]) -> tuple[int, int]:
    """The text's lower left corner: inside the image, and moved up until it overlaps no earlier text.

    Adds the text's box to `occupied`.
    """
    (width, height), _ = cv2.getTextSize(text, FONT, FONT_SCALE, 1)
    x = min(max(position[0], TEXT_MARGIN_PX), image.shape[1] - width - TEXT_MARGIN_PX)
    top = height + TEXT_MARGIN_PX
    y = max(position[1], top)
    while y > top and any(x < b[2] and b[0] < x + width and y - height < b[3] and b[1] < y for b in occupied):
        y -= TEXT_MARGIN_PX
    occupied.append((x, y - height - 2 * TEXT_MARGIN_PX, x + width, y + TEXT_MARGIN_PX))
    return x, y


def stroboscopic_image(frames: NDArray[np.uint8], proposals: VideoProposals, tracks: VideoTracks) -> NDArray[np.uint8]:
    """The last frame with earlier copies of all moving objects; older copies are fainter.

    Args:
        frames: (T, height, width, 3) uint8 RGB.
        proposals: masks of the objects; without masks no copies are drawn.
        tracks: of the same video.

    Returns:
        uint8 RGB of twice the height and width.
    """
    image: NDArray[Any] = frames[-1].astype(float)
    masks = _masks_by_frame(proposals, tracks)
    last = len(frames) - 1
    for frame in range(last % STROBE_EVERY, last, STROBE_EVERY):
        opacity = MIN_OPACITY + OPACITY_RANGE * frame / last
        for track, counts in zip(tracks.tracks, masks, strict=True):
            now, later = _position_px(track, frame), _position_px(track, min(frame + STROBE_EVERY, last))
            if frame not in counts or now is None or later is None:
                continue
            if np.linalg.norm(now - later) >= MIN_DISPLACEMENT_PX:
                image = _blended(image, frames[frame], counts[frame], opacity)
    for track, counts in zip(tracks.tracks, masks, strict=True):  # the last frame's objects are on top
        if last in counts and track.frame_index[-1] == last:
            image = _blended(image, frames[last], counts[last], 1.0)
    size = (image.shape[1] * SCALE, image.shape[0] * SCALE)
    return np.asarray(cv2.resize(image.round().astype(np.uint8), size, interpolation=cv2.INTER_CUBIC), np.uint8)


def _position_px(track: Any, frame_index: int) -> NDArray[Any] | None:
    """The track's interpolated centroid at a frame; None before its first and after its last frame."""
    if not track.frame_index[0] <= frame_index <= track.frame_index[-1]:
        return None
    return np.array([np.interp(frame_index, track.frame_index, track.centroid_px[:, k]) for k in range(2)])


def _masks_by_frame(proposals: VideoProposals, tracks: VideoTracks) -> list[dict[int, str]]:
    """For each track its run-length masks by frame, as far as the proposals have its detections."""
    if proposals.masks is None:
        return [{} for _ in tracks.tracks]
    rows = ((t.frame_index.tolist(), rows_of(t, proposals).tolist()) for t in tracks.tracks)
    return [{f: proposals.masks[row] for f, row in zip(*seen, strict=True) if row >= 0} for seen in rows]


def _blended(image: NDArray[Any], frame: NDArray[Any], counts: str, opacity: float) -> NDArray[Any]:
    """The image with the masked part of a frame laid over it."""
    mask = np.asarray(rle.decode({"size": list(frame.shape[:2]), "counts": counts.encode()}), np.float32)
    alpha = cv2.GaussianBlur(mask, (SOFT_EDGE_PX, SOFT_EDGE_PX), 0)[..., None] * opacity
    return np.asarray(image * (1 - alpha) + frame * alpha)
