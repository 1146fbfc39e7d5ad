"""Rendering options, the lights and ground of CLEVR's base scene, and the camera and lamps of each scene.

The base scene has three square area lamps, a weak sun and a plain grey ground.
"""

import random
from dataclasses import dataclass, field, replace
from typing import Annotated

from msgspec import Meta

from nsdr.errors import DataError
from nsdr.validation import Count, NotNegative, Settings, Size
from nsdr.world.camera import HEIGHT_PX, WIDTH_PX, Camera, check_release_size
from nsdr.world.physics_constants import FPS

MIN_SIDE_PX = 16
"""Smallest image width and height."""
MAX_SIDE_PX = 4096
"""Largest image width and height that H.264 encoders take at every level."""
MAX_FPS, MAX_CRF = 1000, 51
"""Largest frame rate (1/s), and H.264's largest rate factor."""


@dataclass(frozen=True)
class RenderConfig(Settings):
    """How scenes are rendered.

    Attributes:
        width: image width (pixels).
        height: image height (pixels).
        camera: position, target and lens of the camera. Its image size is that of masks and annotations, 480x320.
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

    width: Annotated[int, Meta(ge=MIN_SIDE_PX, le=MAX_SIDE_PX)] = WIDTH_PX
    height: Annotated[int, Meta(ge=MIN_SIDE_PX, le=MAX_SIDE_PX)] = HEIGHT_PX
    camera: Camera = field(default_factory=Camera)
    camera_jitter: NotNegative = 0.0
    light_jitter: NotNegative = 0.0
    samples: Size = 6
    assets: str = ""
    frames: Count = 0
    fps: Annotated[int, Meta(ge=1, le=MAX_FPS)] = FPS
    crf: Annotated[int, Meta(ge=0, le=MAX_CRF)] = 20

    def __post_init__(self) -> None:
        super().__post_init__()
        check_release_size(self.camera)
        if self.width % 2 or self.height % 2:
            raise DataError(
                f"width and height: expected even numbers of at least {MIN_SIDE_PX}, got {self.width}x{self.height}"
            )
        if self.width * HEIGHT_PX != self.height * WIDTH_PX:
            raise DataError(
                f"width and height: expected the release's aspect ratio 3:2, got {self.width}x{self.height}"
            )


@dataclass(frozen=True)
class Lamp:
    """A square area lamp, which faces the origin.

    Attributes:
        name: name of the object in CLEVR's base scene.
        location_world: centre (x, y, z).
        side_world: side length (world units).
        power: radiant power (W).
        color: linear RGB (0-1).
    """

    name: str
    location_world: tuple[float, float, float]
    side_world: float
    power: float
    color: tuple[float, float, float]


LAMPS = (
    Lamp("Lamp_Key", (6.447, -2.905, 4.258), 0.5, 78.54, (1.0, 0.932, 0.817)),
    Lamp("Lamp_Fill", (-4.671, -4.014, 3.011), 0.5, 23.56, (0.762, 0.818, 1.0)),
    Lamp("Lamp_Back", (-1.169, 2.646, 5.816), 1.0, 39.27, (1.0, 1.0, 1.0)),
)
"""The lamps of CLEVR's base scene."""
SUN_STRENGTH = 0.45
"""Irradiance of the sun (W/m², Blender's strength of a sun lamp)."""
SUN_ANGLE = 0.2
"""Angular diameter of the sun (rad)."""
SUN_DIRECTION = (0.4146, -0.1946, 0.889)
"""Unit vector towards the sun."""
GROUND_REFLECTANCE = 0.8
"""Diffuse reflectance of the ground (0-1)."""


@dataclass(frozen=True)
class View:
    """Camera and lamps of one scene.

    Attributes:
        camera: the camera.
        lamp_shift_world: shift (x, y, z) of each lamp from its position in CLEVR's base scene.
    """

    camera: Camera = field(default_factory=Camera)
    lamp_shift_world: tuple[tuple[float, float, float], ...] = ((0.0, 0.0, 0.0),) * len(LAMPS)


def view_of(config: RenderConfig, seed: int) -> View:
    """The view of the scene with this seed, with the jitter of the configuration."""
    rng = random.Random(f"view {seed}")

    def shifted(position: tuple[float, ...], by: float) -> tuple[float, float, float]:
        x, y, z = (p + by * rng.uniform(-1, 1) for p in position)
        return x, y, z

    eye = shifted(config.camera.eye_world, config.camera_jitter)
    lamps = tuple(shifted((0.0, 0.0, 0.0), config.light_jitter) for _ in range(len(LAMPS)))
    return View(replace(config.camera, eye_world=eye, width=config.width, height=config.height), lamps)
