"""Rendering options, the sun of CLEVR's base scene, and the camera and lamps of each scene."""

import random
from dataclasses import dataclass, field, replace
from typing import Annotated

from msgspec import Meta

from nsdr.errors import DataError
from nsdr.validation import Count, NotNegative, Settings, Size
from nsdr.world.camera import Camera
from nsdr.world.consistency import MAX_SIDE_PX
from nsdr.world.world import CLEVRER_WORLD, World

MIN_SIDE_PX = 16
"""Smallest image width and height."""
MAX_FPS, MAX_CRF = 1000, 51
"""Largest frame rate (1/s), and H.264's largest rate factor."""


@dataclass(frozen=True)
class RenderConfig(Settings):
    """How scenes are rendered. What is null (None in Python) is the world's.

    Attributes:
        width: image width (pixels).
        height: image height (pixels).
        camera: position, target and lens of the camera. Its image size is that of masks and annotations, CLEVRER's 480x320.
        camera_jitter: max shift of the camera along each axis (world units). CLEVR has 0.5, CLEVRER 0.
        light_jitter: max shift of each lamp along each axis (world units). CLEVR has 1.
        samples: Cycles samples per pixel, before denoising.
        assets: folder of CLEVR's Blender files (`image_generation/data` of facebookresearch/clevr-dataset-gen), which the
            renderer "blender" needs.
        frames: number of frames in the video, evenly spaced from the first to the last; 0 for all. Annotations, masks and truth
            always have all frames.
        fps: frame rate of the video (1/s).
        crf: H.264 constant rate factor; lower is better quality.
    """

    width: Annotated[int, Meta(ge=MIN_SIDE_PX, le=MAX_SIDE_PX)] | None = None
    height: Annotated[int, Meta(ge=MIN_SIDE_PX, le=MAX_SIDE_PX)] | None = None
    camera: Camera | None = None
    camera_jitter: NotNegative = 0.0
    light_jitter: NotNegative = 0.0
    samples: Size = 6
    assets: str = ""
    frames: Count = 0
    fps: Annotated[int, Meta(ge=1, le=MAX_FPS)] | None = None
    crf: Annotated[int, Meta(ge=0, le=MAX_CRF)] = 20

    def camera_in(self, world: World) -> Camera:
        """The camera in a world, with the image size of masks and annotations, which is the world's.

        Raises:
            DataError: the camera has another image size.
        """
        camera, size = self.camera or world.camera, (world.camera.width, world.camera.height)
        if (camera.width, camera.height) != size:
            raise DataError(
                f"camera: expected images of {size[0]}x{size[1]}, the size of the world's, got "
                f"{camera.width}x{camera.height}; width and height are the size of the video"
            )
        return camera

    def size_in(self, world: World) -> tuple[int, int]:
        """Width and height of the video in a world (pixels).

        Raises:
            DataError: an odd number, or another aspect ratio than the world's.
        """
        full, high = world.camera.width, world.camera.height
        width, height = self.width or full, self.height or high
        if width % 2 or height % 2:
            raise DataError(f"width and height: expected even numbers of at least {MIN_SIDE_PX}, got {width}x{height}")
        if width * high != height * full:
            raise DataError(
                f"width and height: expected the aspect ratio of the world's camera, {full}x{high}, got {width}x{height}"
            )
        return width, height


SUN_STRENGTH = 0.45
"""Irradiance of the sun (W/m², Blender's strength of a sun lamp)."""
SUN_ANGLE = 0.2
"""Angular diameter of the sun (rad)."""
SUN_DIRECTION = (0.4146, -0.1946, 0.889)
"""Unit vector towards the sun."""


@dataclass(frozen=True)
class View:
    """Camera and lamps of one scene.

    Attributes:
        camera: the camera.
        lamp_shift_world: shift (x, y, z) of each lamp from its position in the world's look; left out, there is none.
        world: the world, which has the looks of the table, the lamps and the objects.
    """

    camera: Camera = field(default_factory=Camera)
    lamp_shift_world: tuple[tuple[float, float, float], ...] = ()
    world: World = CLEVRER_WORLD

    def __post_init__(self) -> None:
        if not self.lamp_shift_world:
            object.__setattr__(self, "lamp_shift_world", ((0.0, 0.0, 0.0),) * len(self.world.look.lamps))


def view_of(config: RenderConfig, seed: int, world: World = CLEVRER_WORLD) -> View:
    """The view of the scene with this seed, with the jitter of the configuration.

    Args:
        config: rendering options.
        seed: of the scene.
        world: the world that the scene is in; what the options leave out is the world's.
    """
    rng = random.Random(f"view {seed}")

    def shifted(position: tuple[float, ...], by: float) -> tuple[float, float, float]:
        x, y, z = (p + by * rng.uniform(-1, 1) for p in position)
        return x, y, z

    camera, (width, height) = config.camera_in(world), config.size_in(world)
    eye = shifted(camera.eye_world, config.camera_jitter)
    lamps = tuple(shifted((0.0, 0.0, 0.0), config.light_jitter) for _ in world.look.lamps)
    return View(replace(camera, eye_world=eye, width=width, height=height), lamps, world)
