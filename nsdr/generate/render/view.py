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
MAX_CRF = 51
"""H.264's largest rate factor."""


@dataclass(frozen=True)
class RenderConfig(Settings):
    """How scenes are rendered. Camera, lamps and frame rate are the world's.

    Attributes:
        width: width of the video (pixels); null (None in Python) is the world's, as of masks and annotations always.
        height: height of the video (pixels).
        camera_jitter: max shift of the camera along each axis (world units). CLEVR has 0.5, CLEVRER 0.
        light_jitter: max shift of each lamp along each axis (world units). CLEVR has 1.
        samples: Cycles samples per pixel, before denoising.
        assets: folder of CLEVR's Blender files (`image_generation/data` of facebookresearch/clevr-dataset-gen), which the
            renderer "blender" needs.
        frames: number of frames in the video, evenly spaced from the first to the last; 0 for all. Annotations, masks and truth
            always have all frames.
        crf: H.264 constant rate factor; lower is better quality.
    """

    width: Annotated[int, Meta(ge=MIN_SIDE_PX, le=MAX_SIDE_PX)] | None = None
    height: Annotated[int, Meta(ge=MIN_SIDE_PX, le=MAX_SIDE_PX)] | None = None
    camera_jitter: NotNegative = 0.0
    light_jitter: NotNegative = 0.0
    samples: Size = 6
    assets: str = ""
    frames: Count = 0
    crf: Annotated[int, Meta(ge=0, le=MAX_CRF)] = 20

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


def view_of(config: RenderConfig, seed: int, world: World) -> View:
    """The view of the scene with this seed, with the jitter of the configuration.

    Args:
        config: rendering options.
        seed: of the scene.
        world: the world that the scene is in.
    """
    rng = random.Random(f"view {seed}")

    def shifted(position: tuple[float, ...], by: float) -> tuple[float, float, float]:
        x, y, z = (p + by * rng.uniform(-1, 1) for p in position)
        return x, y, z

    width, height = config.size_in(world)
    eye = shifted(world.camera.eye_world, config.camera_jitter)
    lamps = tuple(shifted((0.0, 0.0, 0.0), config.light_jitter) for _ in world.look.lamps)
    return View(replace(world.camera, eye_world=eye, width=width, height=height), lamps, world)
