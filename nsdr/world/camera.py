"""Cameras, and conversions between world, pixels and the 100x150 grid of the released prediction files.

World: z up, x towards the camera, y to the right of the image; object centres are at z = 0.2. Pixels: (column, row) of the
480x320 image, pixel centres at +0.5. Grid: (row, column); one grid unit is 3.2 pixels.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nsdr.world.physics import Physics
from nsdr.world.vocabulary import CLEVRER

WIDTH_PX, HEIGHT_PX = 480, 320
"""Size of the released videos (pixels)."""
SENSOR_MM = 32.0
"""Width of the sensor of CLEVR's camera (mm)."""
MIN_HEIGHT_WORLD, MIN_ASIDE_WORLD = 0.5, 0.1
"""The camera's least height, and its least distance from the vertical through its target, where images have no upward direction
(world units)."""
CENTRE_WORLD = CLEVRER.shapes[0].height_world
"""Height of the centres of CLEVRER's objects (world units)."""
FAR_WORLD = 2 * Physics().table_half_width_world
"""The ground is looked at up to this depth: beyond, on the way to the horizon, there are no objects (world units)."""
MIN_POINTS = 4
"""Least number of points from which a camera is found."""
MAX_RESIDUAL_PX = 4.0
"""Largest residual of a camera that is found from points (pixels). Points clicked with 1 pixel of noise leave 1.4 at most on
average, wherever they are."""
MAX_ERROR_WORLD = 0.1
"""Largest error that 1 pixel of noise in the points may cause in positions, by the median over the image (world units): a
quarter of an object's width. A sheet of 0.8 by 1.1 in the middle of the image leaves 0.06, marks 3 apart 0.012."""
DERIVATIVE_STEP, TINY = 1e-5, 1e-9
"""Step of numerical derivatives (world units, radians), and smallest number that is divided by."""
START_LENSES_MM = (12.0, 18.0, 24.0, 35.0, 50.0, 70.0, 100.0)
"""Focal lengths from which a camera is looked for."""
_GRID_PER_PIXEL = 1 / 3.2
"""Grid units per pixel: 320x480 pixels are 100x150 grid units."""

FloatArray = NDArray[np.floating[Any]]
Point = tuple[float, float, float]


@dataclass(frozen=True)
class Camera:
    """A pinhole camera at rest, upright; the defaults are CLEVRER's.

    With these, a render of CLEVR's base scene differs from a released background by 1.8 of 255 on average.

    Attributes:
        eye_world: position (x, y, z) (world units).
        target_world: the point that it looks at, in the middle of the image (world units).
        lens_mm: focal length for a sensor `SENSOR_MM` wide; CLEVR's is 525 px long for a width of 480 px.
        width: image width (pixels).
        height: image height (pixels).

    Raises:
        ValueError: the camera has no place from which it sees the ground, looks above the ground, or has no size.
    """

    eye_world: Point = (4.330127, 0.0, 2.5)
    target_world: Point = (0.0, 0.0, 0.0)
    lens_mm: float = 35.0
    width: int = WIDTH_PX
    height: int = HEIGHT_PX

    def __post_init__(self) -> None:
        (x, y, z), target = self.eye_world, self.target_world
        aside = math.hypot(x - target[0], y - target[1])
        if not (MIN_HEIGHT_WORLD <= z < math.inf and MIN_ASIDE_WORLD <= aside < math.inf and math.isfinite(target[2])):
            raise ValueError(
                f"camera: eye_world {self.eye_world}, target_world {target}: expected the camera's place and the point that it "
                f"looks at as x, y, z, the place at least {MIN_HEIGHT_WORLD} high and not right above the point"
            )
        if not (0 < self.lens_mm < math.inf and self.width > 0 and self.height > 0):
            raise ValueError(
                f"camera: expected lens_mm, width and height above 0, got {self.lens_mm}, {self.width} and {self.height}"
            )
        if self.far_row_px >= self.height:
            raise ValueError(
                f"camera: eye_world {self.eye_world}, target_world {self.target_world}: looks above the ground; expected a "
                f"target whose surroundings on the ground, up to {FAR_WORLD:g} away, are in the image"
            )

    @classmethod
    def from_points(
        cls,
        pixels: ArrayLike,
        world_points: ArrayLike,
        size_px: tuple[int, int] = (WIDTH_PX, HEIGHT_PX),
        images_px: tuple[int, int] = (WIDTH_PX, HEIGHT_PX),
    ) -> tuple["Camera", float]:
        """Find the camera that took an image from points whose places are known, such as marks on a table.

            >>> corners = [(1, -1), (1, 1), (-1, 1), (-1, -1)]
            >>> camera, residual_px = nsdr.Camera.from_points([(113, 224), (367, 224), (329, 115), (151, 115)], corners)

        OpenCV's `solvePnP` gives cameras for several focal lengths. The best of them is the start of a least-squares fit of
        the position, direction and focal length of an upright camera.

        Args:
            pixels: (N, 2) where the points are seen, as (column, row); there are four or more.
            world_points: (N, 2) the same points on the ground as (x, y), at z = 0; or (N, 3) as (x, y, z) (world units).
            size_px: width and height of the image in which the points were seen, in the ratio of `images_px`.
            images_px: width and height of the world's images, to which frames are scaled.

        Returns:
            The camera, for images of that size, and the residual: the root mean squared distance between the points and where
            the camera sees them (pixels of an image that is 480 wide).

        Raises:
            ValueError: there are too few points, they determine no camera, such as points on one line, no upright camera sees
                them there, or the image has another aspect ratio.
        """
        from scipy.optimize import least_squares

        seen, places = _checked_points(pixels, world_points)
        try:
            to_images, scale = image_scale(size_px, images_px), WIDTH_PX / images_px[0]
        except ValueError as e:
            raise ValueError(f"{e}; or, if the world's images have this size, give images_px={tuple(size_px)}") from e
        seen = seen * to_images * scale
        seen[:, 1] += (HEIGHT_PX - images_px[1] * scale) / 2  # the middle row is that of CLEVRER's images
        starts = list(_rolled_cameras(seen, places))
        if not starts:
            raise ValueError(
                "points: no camera above the ground sees them there; give points that are not on one line, each with its own "
                "place (x towards the camera, y to the right of the image)"
            )
        start, roll_degrees = min(starts, key=lambda s: float(np.abs(_projected(s[0], places) - seen).mean()))
        found = least_squares(lambda p: (_projected(p, places) - seen).ravel(), start, x_scale="jac")
        off = np.hypot(*found.fun.reshape(-1, 2).T)
        residual = float(np.sqrt((off**2).mean()))
        if residual > MAX_RESIDUAL_PX:
            worst = int(off.argmax())
            raise ValueError(
                f"points: no upright camera sees them there: in an image 480 wide, they are {residual:.1f} pixels off "
                f"(at most {MAX_RESIDUAL_PX:g}), the most, {off[worst]:.1f}, at point {worst}. Was it exchanged with another, "
                f"is the image not {size_px[0]}x{size_px[1]} (size_px, images_px), does the lens distort, or is the camera "
                f"rolled (by about {abs(roll_degrees):.0f} degrees; turn frames, masks and points upright)?"
            )
        error = _expected_error(found.x, found.jac)
        if not error <= MAX_ERROR_WORLD:
            raise ValueError(
                f"points: they do not determine the camera: clicked 1 pixel off, they would put objects {error:.2g} world "
                f"units off (at most {MAX_ERROR_WORLD:g}); give points that are further apart, and not on one line"
            )
        return replace(_camera_of(found.x), width=images_px[0], height=images_px[1]), residual

    @cached_property
    def axes(self) -> FloatArray:
        """(3, 3): rows are the camera's right, down and forward directions in the world."""
        forward = np.array(self.target_world) - np.array(self.eye_world)
        forward = forward / np.linalg.norm(forward)
        right = np.cross(forward, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        return np.stack([right, np.cross(forward, right), forward])

    @property
    def azimuth_degrees(self) -> float:
        """The direction from the target to the camera, from the x axis to the y axis; CLEVRER's camera is on the x axis."""
        (x, y, _), (to_x, to_y, _) = self.eye_world, self.target_world
        return math.degrees(math.atan2(y - to_y, x - to_x))

    @property
    def focal_px(self) -> float:
        """Focal length (pixels)."""
        return self.width * self.lens_mm / SENSOR_MM

    @property
    def far_row_px(self) -> float:
        """The image row, below the horizon, at which centres of objects on the ground are `FAR_WORLD` deep."""
        (x, y, z), (to_x, to_y, to_z) = self.eye_world, self.target_world
        aside, above = math.hypot(to_x - x, to_y - y), z - CENTRE_WORLD
        tilt = math.atan2(to_z - z, aside)  # upwards
        return self.height / 2 + self.focal_px * (above / FAR_WORLD + math.sin(tilt)) / math.cos(tilt)

    @cached_property
    def matrix(self) -> FloatArray:
        """(3, 4) projection: world (x, y, z, 1) -> (u w, v w, w), with u the column, v the row (pixels) and w the depth."""
        intrinsic = np.array([[self.focal_px, 0, self.width / 2], [0, self.focal_px, self.height / 2], [0, 0, 1]])
        linear = intrinsic @ self.axes
        return np.c_[linear, -linear @ np.array(self.eye_world)]

    @cached_property
    def border_planes(self) -> FloatArray:
        """(4, 4): world points (x, y, z, 1) times a row are positive inside the image's left, top, right and bottom border."""
        across, down, depth = self.matrix
        return np.stack([across, down, self.width * depth - across, self.height * depth - down])

    def depth(self, location_world: ArrayLike) -> FloatArray:
        """Depth (...) of world points (..., 3) along the viewing direction (world units)."""
        return np.asarray((np.asarray(location_world, float) - np.array(self.eye_world)) @ self.axes[2])

    def pixels(self, location_world: ArrayLike) -> FloatArray:
        """World points -> pixels (..., 2) as (column, row); NaN for points behind the camera.

        Args:
            location_world: points (..., 3) as (x, y, z); or positions on the ground (..., 2) as (x, y), which stand for the
                centres of objects there, `CENTRE_WORLD` high, so that `ground` is the inverse (world units).
        """
        xyz = np.asarray(location_world, float)
        if xyz.shape[-1:] == (2,):
            xyz = on_ground(xyz)
        homogeneous = xyz @ self.matrix[:, :3].T + self.matrix[:, 3]
        depth = homogeneous[..., 2:]
        return homogeneous[..., :2] / np.where(depth > 0, depth, np.nan)

    def ground(self, pixels: ArrayLike, z_world: float = CENTRE_WORLD) -> FloatArray:
        """Pixels (..., 2) as (column, row) -> world (..., 2) as (x, y) at a height of `z_world`; NaN above the horizon."""
        p = np.asarray(pixels, float)
        plane = np.c_[self.matrix[:, :2], self.matrix[:, 2] * z_world + self.matrix[:, 3]]
        inverse = np.linalg.inv(plane)
        homogeneous = p @ inverse[:, :2].T + inverse[:, 2]
        inverse_depth = homogeneous[..., 2:]
        return np.asarray(homogeneous[..., :2] / np.where(inverse_depth > 0, inverse_depth, np.nan))

    def rays(self, columns: FloatArray, rows: FloatArray) -> FloatArray:
        """Unit directions (..., 3) in the world from the camera through the pixels at `columns` and `rows` (...)."""
        across = (columns - self.width / 2) / self.focal_px
        down = (rows - self.height / 2) / self.focal_px
        directions = np.stack([across, down, np.ones_like(across)], -1) @ self.axes
        return directions / np.linalg.norm(directions, axis=-1, keepdims=True)


CLEVRER_CAMERA = Camera()
"""The camera of every released video."""


def image_scale(given_px: tuple[int, int], wanted_px: tuple[int, int]) -> FloatArray:
    """What columns and rows of an image are multiplied with (2,) when it is scaled; both sizes are width and height.

    Raises:
        ValueError: the image has another aspect ratio; says how to crop it.
    """
    (width, height), (to_width, to_height) = given_px, wanted_px
    if min(width, height, to_width, to_height) <= 0:
        raise ValueError(f"image: expected widths and heights above 0, got {width}x{height} and {to_width}x{to_height}")
    if abs(height * to_width / width - to_height) > 1:
        wide = width * to_height > height * to_width
        kept = round(height * to_width / to_height) if wide else round(width * to_height / to_width)
        ratio = str(Fraction(to_width, to_height)).replace("/", ":")
        first = ((width if wide else height) - kept) // 2
        part, axis = f"{first}:{first + kept}", "columns" if wide else "rows"
        raise ValueError(
            f"image: expected the aspect ratio {ratio}, got {width}x{height}; crop frames and masks to the {axis} {part}, and "
            f"subtract {first} from the {axis} of clicked points"
        )
    return np.array([to_width / width, to_height / height])


def _checked_points(pixels: ArrayLike, world_points: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Pixels (N, 2) and places (N, 3) of four or more different points."""
    seen, places = np.asarray(pixels, float), np.asarray(world_points, float)
    if seen.ndim != 2 or seen.shape[1] != 2 or places.ndim != 2 or places.shape[1] not in (2, 3):
        shapes = f"{seen.shape} and {places.shape}"
        raise ValueError(f"points: expected pixels (N, 2) and world points (N, 2) or (N, 3), got arrays {shapes}")
    if len(seen) != len(places):
        raise ValueError(f"points: expected one world point for each pixel, got {len(seen)} and {len(places)}")
    if not (np.isfinite(seen).all() and np.isfinite(places).all()):
        raise ValueError("points: expected finite numbers")
    different = min(len(np.unique(p, axis=0)) for p in (seen, places))
    if different < MIN_POINTS:
        raise ValueError(f"points: expected {MIN_POINTS} or more different points, got {different}")
    return seen, np.c_[places, np.zeros((len(places), 3 - places.shape[1]))]


def _rolled_cameras(seen: FloatArray, places: FloatArray) -> Iterator[tuple[FloatArray, float]]:
    """Cameras above the ground that see points (N, 3) near their pixels (N, 2).

    Yields:
        Parameters (6,), see `_projected`, and the roll (degrees), which they leave out.
    """
    import cv2

    for lens_mm in START_LENSES_MM:
        focal = WIDTH_PX * lens_mm / SENSOR_MM
        intrinsic = np.array([[focal, 0, WIDTH_PX / 2], [0, focal, HEIGHT_PX / 2], [0, 0, 1]])
        try:
            _, turns, shifts, _ = cv2.solvePnPGeneric(places, seen, intrinsic, None, flags=cv2.SOLVEPNP_SQPNP)
        except cv2.error:  # the points are on one line
            return
        for turn, shift in zip(turns, shifts, strict=True):
            right, down, forward = axes = cv2.Rodrigues(turn)[0]
            eye = -axes.T @ shift.ravel()
            if eye[2] > 0:
                azimuth, tilt = math.atan2(forward[1], forward[0]), math.asin(np.clip(forward[2], -1, 1))
                yield np.array([*eye, azimuth, tilt, math.log(focal)]), math.degrees(math.atan2(right[2], -down[2]))


def _camera_of(parameters: FloatArray) -> Camera:
    """The camera with parameters (6,), see `_projected`; it looks at the ground, or at a point `FAR_WORLD` away."""
    *eye, azimuth, tilt, log_focal = parameters.tolist()
    away = min(eye[2] / max(-math.sin(tilt), TINY), FAR_WORLD)
    x, y, z = (place + away * along for place, along in zip(eye, _forward(azimuth, tilt), strict=True))
    return Camera((eye[0], eye[1], eye[2]), (x, y, z), math.exp(log_focal) * SENSOR_MM / WIDTH_PX)


def _forward(azimuth: float, tilt: float) -> tuple[float, float, float]:
    return math.cos(tilt) * math.cos(azimuth), math.cos(tilt) * math.sin(azimuth), math.sin(tilt)


def _projected(parameters: FloatArray, places: FloatArray) -> FloatArray:
    """Pixels (N, 2) of points (N, 3) in the image of an upright camera.

    Its parameters (6,) are its position (x, y, z), the direction in which it looks as azimuth and tilt upwards (radians), and
    the logarithm of its focal length (pixels). Any values will do, unlike those of a `Camera`.
    """
    azimuth, tilt, log_focal = parameters[3:].tolist()
    forward = np.array(_forward(azimuth, tilt))
    right = np.array([math.sin(azimuth), -math.cos(azimuth), 0.0])
    x, y, depth = np.stack([right, np.cross(forward, right), forward]) @ (places - parameters[:3]).T
    return np.stack(
        [WIDTH_PX / 2 + math.exp(log_focal) * x / depth, HEIGHT_PX / 2 + math.exp(log_focal) * y / depth], 1
    )


def _expected_error(parameters: FloatArray, jacobian: FloatArray) -> float:
    """Error of positions of objects if the points have 1 pixel of noise, by the median over the image (world units).

    Args:
        parameters: (6,) of the camera.
        jacobian: (2 N, 6) derivatives of the points' pixels.
    """
    columns, rows = np.meshgrid(np.array([1, 2, 3]) * WIDTH_PX / 4, np.array([1, 2, 3]) * HEIGHT_PX / 4)
    pixels = np.stack([columns.ravel(), rows.ravel()], 1)
    steps = DERIVATIVE_STEP * np.eye(len(parameters))
    sides = [[_camera_of(parameters + side * step).ground(pixels) for side in (-1, 1)] for step in steps]
    moved = np.stack([(high - low) / (2 * DERIVATIVE_STEP) for low, high in sides], 2)  # (9, 2, 6)
    _, sizes, directions = np.linalg.svd(jacobian, full_matrices=False)
    noise = directions.T / np.maximum(sizes, TINY)
    variance = ((moved @ noise) ** 2).sum((1, 2))
    seen = np.isfinite(variance)
    return float(np.sqrt(np.median(variance[seen]))) if seen.any() else math.inf


def on_ground(location_world: ArrayLike, height_world: ArrayLike = CENTRE_WORLD) -> FloatArray:
    """Ground-plane positions (..., 2) -> centres (..., 3) of objects standing there, whose centres are so high (...)."""
    xy = np.asarray(location_world, float)
    return np.concatenate([xy, np.broadcast_to(height_world, xy.shape[:-1])[..., None]], -1)


def grid_from_pixels(pixels: ArrayLike) -> FloatArray:
    """Pixels (..., 2) as (column, row) -> grid (..., 2) as (row, column) in 0-100 and 0-150."""
    return np.asarray(pixels, float)[..., ::-1] * _GRID_PER_PIXEL


def pixels_from_grid(grid: ArrayLike) -> FloatArray:
    """Grid (..., 2) as (row, column) -> pixels (..., 2) as (column, row); inverse of `grid_from_pixels`."""
    return np.asarray(grid, float)[..., ::-1] / _GRID_PER_PIXEL
