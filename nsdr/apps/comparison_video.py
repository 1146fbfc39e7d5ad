"""The video of a simulation, side by side with the original."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import chain
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from nsdr.generate.render import View, render_motion
from nsdr.io.video import write_video
from nsdr.types import Simulation
from nsdr.visualize.comparison import comparison_frames
from nsdr.world.camera import CLEVRER_CAMERA, Camera

__all__ = ["write_comparison"]

T = TypeVar("T")


def write_comparison(
    path: str | Path,
    frames: Sequence[NDArray[np.uint8]],
    simulation: Simulation,
    preset: str = "slow",
    progress: Callable[[int, int], None] | None = None,
    camera: Camera = CLEVRER_CAMERA,
) -> None:
    """Write an mp4 with the original at the left and the changed world at the right, from the camera and from above.

    Args:
        path: file to write.
        frames: (320, 480, 3) uint8 RGB each: the video, which drawn frames continue.
        simulation: of that video.
        preset: as of `nsdr.io.video.write_video`.
        progress: called before each frame with the number of frames that are done, and of all.
        camera: that took the video.

    Raises:
        DataError: PyAV is missing.
    """
    s = simulation
    later = slice(s.n_frames, None)
    following = render_motion(s.objects, s.original.location_world[:, later], s.original_yaw[:, later], View(camera))
    changed = render_motion(s.objects, s.changed.location_world, s.changed_yaw, View(camera))
    images = comparison_frames(s, chain(frames, following), changed, camera)
    write_video(path, _counted(images, s.changed.visible.shape[1], progress), preset=preset)


def _counted(items: Iterable[T], total: int, progress: Callable[[int, int], None] | None) -> Iterator[T]:
    for done, item in enumerate(items):
        if progress is not None:
            progress(done, total)
        yield item
