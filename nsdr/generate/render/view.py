"""How scenes are rendered, and the camera and lamps of each."""

import random
from dataclasses import dataclass, field

from nsdr.errors import DataError
from nsdr.world.camera import EYE_WORLD, HEIGHT_PX, WIDTH_PX, Camera

__all__ = ["RenderConfig", "View", "view_of"]


@dataclass(frozen=True)
class RenderConfig:
    """How scenes are rendered.

    Attributes:
        width: of the image in pixels.
        height: of the image in pixels.
        camera_jitter: greatest shift of the camera along each axis, world units (CLEVR has 0.5, CLEVRER none).
        light_jitter: greatest shift of each lamp along each axis, world units (CLEVR has 1).
        samples: Cycles' samples per pixel, before the denoiser.
        assets: folder of CLEVR's Blender files (`image_generation/data` of facebookresearch/clevr-dataset-gen); "" for
            plain substitutes.
        fps: frames per second of the video.
        crf: H.264 quality, less is better.
    """

    width: int = WIDTH_PX
    height: int = HEIGHT_PX
    camera_jitter: float = 0.0
    light_jitter: float = 0.0
    samples: int = 6
    assets: str = ""
    fps: int = 25
    crf: int = 20

    def __post_init__(self) -> None:
        if self.width < 16 or self.height < 16 or self.width % 2 or self.height % 2:
            raise DataError(f"width and height: expected even numbers of at least 16, got {self.width}x{self.height}")
        if self.width * HEIGHT_PX != self.height * WIDTH_PX:
            raise DataError(f"width and height: expected the release's shape, 3:2, got {self.width}x{self.height}")


@dataclass(frozen=True)
class View:
    """How one scene is seen.

    Attributes:
        camera: the camera.
        lamp_shift_world: shift (x, y, z) of each of the three lamps.
    """

    camera: Camera = field(default_factory=Camera)
    lamp_shift_world: tuple[tuple[float, float, float], ...] = ((0.0, 0.0, 0.0),) * 3


def view_of(config: RenderConfig, seed: int) -> View:
    """The view of the scene with a seed: jittered where the configuration says so."""
    rng = random.Random(f"view {seed}")

    def shifted(position: tuple[float, ...], by: float) -> tuple[float, float, float]:
        x, y, z = (p + by * rng.uniform(-1, 1) for p in position)
        return x, y, z

    eye = shifted(EYE_WORLD, config.camera_jitter)
    lamps = tuple(shifted((0.0, 0.0, 0.0), config.light_jitter) for _ in range(3))
    return View(Camera(eye, config.width, config.height), lamps)
