"""Ground-plane positions of objects from their masks, and whether objects look as large there as they should.

The centroid of an object's outline is not the projection of its centre, and the centroid of an outline that is cut by the
image border or by a nearer object is biased. Both corrections follow from the known camera and shapes: outlines are projected
for a grid of positions, and polynomials in the pixel coordinates are fitted to the offsets. No constant is measured on data.
"""

from functools import lru_cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from nsdr.tracking.visibility import cut_sides
from nsdr.types import VideoTracks
from nsdr.validation import FloatArray
from nsdr.world.camera import CLEVRER_CAMERA, WIDTH_PX, Camera, on_ground
from nsdr.world.shapes import shape_of, surface_points
from nsdr.world.vocabulary import Shape

GRID_COLUMNS, GRID_ROWS = 15, 12
"""Number of columns and rows of the grid of object centres that the offsets are fitted on."""
GRID_MARGIN_PX = 20
"""Distance of the grid's left, right and bottom edges outside the image (pixels of images as wide as CLEVRER's)."""
GRID_TOP_PX = 10
"""Image row of the grid's top edge (pixels of images as wide as CLEVRER's), where the ground is not already far away there."""
YAWS = 6
"""Number of yaws in each quarter turn that a box's outline is averaged over."""
POLYNOMIAL_DEGREE = 3
"""Total degree of the polynomials that are fitted to the offsets."""
CLIP_MARGIN_PX = 40
"""Centres are clipped to this distance outside the image before the offsets are evaluated (pixels of images as wide as
CLEVRER's)."""
CUT_ITERATIONS = 8
"""Fixed-point iterations for the centre of a partly hidden object: the offsets of its sides depend on the centre."""

SIZE_QUANTILE = 0.75
"""Quantile of the ratios of sizes over an object's frames, and over the objects. It is high because objects that others partly
hide look smaller."""
MIN_WHOLE_FRAMES, MIN_WHOLE_OBJECTS = 5, 2
"""Least number of frames in which an object is seen whole, and of such objects, for a ratio of sizes."""
TYPICAL_RATIO = np.array([1.02, 1.0])
"""Ratios of width and height of official proposals, see `MAX_RATIO`."""
MAX_RATIO = 1.08
"""Largest ratio, relative to the typical one, and inverse of the smallest. `python -m benchmarks.objects`
prints the typical ones and the largest deviation: below 1.05 in 288 training videos."""


def outline(shape: Shape | str, x: float, y: float, yaw: float = 0.0, camera: Camera = CLEVRER_CAMERA) -> FloatArray:
    """Outline of an object at (x, y) on the ground as a convex polygon (N, 2) in pixels."""
    points = surface_points(shape, yaw) + np.array([x, y, shape_of(shape).height_world])
    return cv2.convexHull(camera.pixels(points).astype(np.float32))[:, 0].astype(float)


def _centroid(polygon: FloatArray) -> FloatArray:
    following = np.roll(polygon, -1, axis=0)
    cross = polygon[:, 0] * following[:, 1] - following[:, 0] * polygon[:, 1]
    return ((polygon + following) * cross[:, None]).sum(0) / (3 * cross.sum())


def _terms(pixels: FloatArray, camera: Camera) -> FloatArray:
    """Polynomial terms (N, 10) of pixels (N, 2), which are centred and divided by the image size."""
    width, height = camera.width, camera.height
    u, v = (pixels[:, 0] - width / 2) / width, (pixels[:, 1] - height / 2) / height
    exponents = range(POLYNOMIAL_DEGREE + 1)
    return np.stack([u**i * v**j for i in exponents for j in exponents if i + j <= POLYNOMIAL_DEGREE], 1)


@lru_cache(maxsize=64)
def _calibration(shape: Shape, camera: Camera) -> tuple[FloatArray, FloatArray]:
    """Polynomial coefficients of a shape; boxes are averaged over their yaw.

    The first array (10, 2) gives the projected centre minus the centroid, as a function of the centroid. The second (10, 4)
    gives the sides of the bounding box (left, top, right, bottom) minus the projected centre, as a function of the centre.
    """
    scale = camera.width / WIDTH_PX
    margin, top = GRID_MARGIN_PX * scale, max(GRID_TOP_PX * scale, camera.far_row_px)
    columns, rows = np.meshgrid(
        np.linspace(-margin, camera.width + margin, GRID_COLUMNS), np.linspace(top, camera.height + margin, GRID_ROWS)
    )
    centres = np.stack([columns.ravel(), rows.ravel()], 1)
    turns = (1 if shape.is_square else 2) if shape.solid == "box" else 0  # quarter turns after which it looks the same
    yaws = np.linspace(0, turns * np.pi / 2, YAWS * turns, endpoint=False) if turns else [0.0]
    centroids, edges = [], []
    for x, y in camera.ground(centres, shape.height_world):
        polygons = [outline(shape, x, y, yaw, camera) for yaw in yaws]
        centroids.append(np.mean([_centroid(p) for p in polygons], 0))
        edges.append(np.mean([[*p.min(0), *p.max(0)] for p in polygons], 0))
    to_centre = np.linalg.lstsq(_terms(np.array(centroids), camera), centres - centroids, rcond=None)[0]
    to_edges = np.linalg.lstsq(_terms(centres, camera), np.array(edges) - np.tile(centres, 2), rcond=None)[0]
    return to_centre, to_edges


def expected_size(shape: Shape | str, location_world: FloatArray, camera: Camera) -> FloatArray:
    """Width and height (N, 2) in pixels of the bounding boxes of objects of a shape at (x, y) (N, 2) on the ground.

    Boxes are averaged over their yaw.
    """
    shape = shape_of(shape)
    _, to_edges = _calibration(shape, camera)
    edges = _terms(camera.pixels(on_ground(location_world, shape.height_world)), camera) @ to_edges
    return edges[:, 2:] - edges[:, :2]


def ground_location(
    shape: Shape | str,
    centroid_px: FloatArray,
    box_xyxy_px: NDArray[Any],
    hidden: NDArray[np.bool_],
    camera: Camera = CLEVRER_CAMERA,
    stretch: FloatArray | None = None,
) -> FloatArray:
    """Ground-plane positions of objects of one shape.

    Where a side of the box is hidden, the centroid is biased: the position then follows from the visible sides and the size
    of the shape's outline there. Along an axis with both sides hidden, the centroid is used all the same.

    Args:
        shape: a shape, or the word of one of CLEVRER's.
        centroid_px: (N, 2) mask centroids (column, row).
        box_xyxy_px: (N, 4) mask bounds.
        hidden: (N, 4) bool from `hidden_sides`.
        camera: the camera that took the image.
        stretch: (N, 4) distances of the outline's sides from the centre, as multiples of those of the shape's mean outline;
            None for 1.

    Returns:
        (N, 2) world (x, y) of the objects' centres; NaN where an outline lies above the horizon.
    """
    shape = shape_of(shape)
    to_centre, to_edges = _calibration(shape, camera)
    centroid, size = np.asarray(centroid_px, float), np.array([camera.width, camera.height])
    margin = CLIP_MARGIN_PX * camera.width / WIDTH_PX
    centre = centroid + _terms(centroid, camera) @ to_centre
    cut = hidden.any(1)
    box = box_xyxy_px[cut]
    times = 1.0 if stretch is None else stretch[cut]
    low_hidden, high_hidden = hidden[cut, :2], hidden[cut, 2:]
    for _ in range(CUT_ITERATIONS if cut.any() else 0):
        offset = _terms(np.clip(centre[cut], -margin, size + margin), camera) @ to_edges * times
        from_high, from_low = box[:, 2:] - offset[:, 2:], box[:, :2] - offset[:, :2]
        from_sides = np.where(low_hidden, from_high, np.where(high_hidden, from_low, (from_high + from_low) / 2))
        centre[cut] = np.where(low_hidden & high_hidden, centre[cut], from_sides)
    return camera.ground(centre, shape.height_world)


def turned_location(
    shape: Shape,
    frame_index: NDArray[Any],
    centroid_px: FloatArray,
    box_xyxy_px: NDArray[Any],
    hidden: NDArray[np.bool_],
    camera: Camera,
) -> FloatArray:
    """Ground-plane positions (T, 2) of one object of a shape whose outline depends on how it is turned.

    Where sides are hidden, the outline is taken from the frames before and after in which the object is seen whole.

    Args:
        shape: a box that is longer than wide.
        frame_index: (T,) ascending frames.
        centroid_px, box_xyxy_px, hidden, camera: see `ground_location`.
    """
    seen = centroid_px, box_xyxy_px, hidden, camera
    location, whole = ground_location(shape, *seen), ~hidden.any(1)
    if not whole.any() or whole.all():
        return location
    centre = camera.pixels(on_ground(location[whole], shape.height_world))
    stretch = (box_xyxy_px[whole] - np.tile(centre, 2)) / (_terms(centre, camera) @ _calibration(shape, camera)[1])
    stretch = np.stack([np.interp(frame_index, frame_index[whole], side) for side in stretch.T], 1)
    return ground_location(shape, *seen, stretch)


def size_ratio(tracks: VideoTracks) -> NDArray[np.float64] | None:
    """Width and height (2,) of objects relative to what is expected at their places; None if too little is seen whole.

    Boxes do not count: how wide they look depends on how they are turned.
    """
    ratios, shape_of_word = [], tracks.world.vocabulary.shape
    for track in (t for t in tracks.tracks if shape_of_word(t.object.shape).solid != "box"):
        whole = ~cut_sides(track.box_xyxy_px, tracks.camera).any(1)
        if whole.sum() >= MIN_WHOLE_FRAMES:
            box = track.box_xyxy_px[whole].astype(float)
            shape = shape_of_word(track.object.shape)
            expected = expected_size(shape, track.location_world[whole], tracks.camera)
            ratios.append(np.quantile((box[:, 2:] - box[:, :2]) / expected, SIZE_QUANTILE, axis=0))
    return np.asarray(np.quantile(ratios, SIZE_QUANTILE, axis=0)) if len(ratios) >= MIN_WHOLE_OBJECTS else None


def size_notes(tracks: VideoTracks) -> tuple[str, ...]:
    """A note if objects look too large or too small for their positions, as in zoomed or stretched videos."""
    ratio = size_ratio(tracks)
    if ratio is None:
        return ()
    width, height = ratio / TYPICAL_RATIO
    if max(width, height, 1 / width, 1 / height) <= MAX_RATIO:
        return ()
    return (
        f"objects look {width:.2f} times as wide and {height:.2f} times as high as they should at their places: cropped, "
        "zoomed, stretched, or another camera; positions and collisions may be wrong",
    )
