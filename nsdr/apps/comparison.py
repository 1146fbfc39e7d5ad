"""The video of a simulation: the original and the changed world side by side, from the camera and from above."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from fractions import Fraction
from itertools import chain
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from nsdr.generate.render.preview import render_motion
from nsdr.generate.render.view import View
from nsdr.io.video import write_video
from nsdr.types import Rollout, Simulation
from nsdr.types.interventions import intervention_text
from nsdr.types.scenes import yaws
from nsdr.visualize.plan_frames import draw_plan

HEADER_PX = 48
"""Height of the two lines of text above the images (pixels)."""
FONT = cv2.FONT_HERSHEY_SIMPLEX
TITLE_SCALE, SMALL_SCALE = 0.5, 0.42
"""Sizes of the text's lines, in OpenCV's units."""
INK, PAPER_GREY = (30, 30, 30), 255
GAP_PX = 2
"""Width of the line between the images (pixels)."""


def write_comparison(
    path: str | Path,
    frames: Sequence[NDArray[np.uint8]],
    simulation: Simulation,
    preview: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> None:
    """Write an mp4 of `comparison_frames`, which lasts as long as they do in the world.

    Args:
        path: file to write.
        frames: (height, width, 3) uint8 RGB each: the video, which drawn frames continue.
        simulation: of that video.
        preview: take a fifth of the time: every other frame, rendered at half the resolution.
        progress: called before each frame with the number of frames that are done, and of all.

    Raises:
        DataError: PyAV is missing.
    """
    s, every, scale, preset = simulation, *((2, 2, "ultrafast") if preview else (1, 1, "slow"))
    n_frames = s.changed.visible.shape[1]
    world, camera = s.scene.world, s.scene.world.camera
    view = View(replace(camera, width=camera.width // scale, height=camera.height // scale), world=world)

    size = camera.width, camera.height

    def rendered(rollout: Rollout, first: int) -> Iterator[NDArray[np.uint8]]:
        shown = slice(first, None, every)
        for image in render_motion(s.objects, rollout.location_world[:, shown], yaws(rollout)[:, shown], view):
            yield np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_CUBIC), np.uint8)

    first = -(-s.n_frames // every) * every  # the first shown frame after the video
    shown = chain(frames[::every], rendered(s.original, first))

    def images() -> Iterator[NDArray[np.uint8]]:
        for number, image in enumerate(comparison_frames(s, shown, rendered(s.changed, 0), every)):
            if progress is not None:
                progress(number * every, n_frames)
            yield image

    write_video(path, images(), Fraction(world.timeline.fps, every), preset=preset)


def comparison_frames(
    simulation: Simulation,
    original: Iterable[NDArray[np.uint8]],
    changed: Iterable[NDArray[np.uint8]],
    every: int = 1,
) -> Iterator[NDArray[np.uint8]]:
    """Frames with the original at the left and the changed world at the right: seen by the camera, and below from above.

    The grey outlines in the right plan are the original.

    Args:
        simulation: what was simulated.
        original: (height, width, 3) uint8 RGB: the video, and what follows it.
        changed: as many rendered frames of the changed world.
        every: the frames are 0, `every`, 2 `every`, …

    Yields:
        (2 height + 48, 2 width, 3) uint8 RGB.
    """
    s, world = simulation, simulation.scene.world
    width, height = world.camera.width, world.camera.height
    for number, (left, right) in enumerate(zip(original, changed, strict=True)):
        frame = number * every
        image = np.full((HEADER_PX + 2 * height, 2 * width, 3), PAPER_GREY, np.uint8)
        image[HEADER_PX:-height, :width], image[HEADER_PX:-height, width:] = left, right
        image[-height:, :width] = draw_plan(s.objects, s.original, frame, world)
        image[-height:, width:] = draw_plan(s.objects, s.changed, frame, world, s.original)
        image[HEADER_PX:, width - GAP_PX // 2 : width + GAP_PX // 2] = PAPER_GREY
        image[-height - GAP_PX // 2 : -height + GAP_PX // 2] = PAPER_GREY
        _write_header(image, s, frame)
        yield image


def _write_header(image: NDArray[np.uint8], s: Simulation, frame: int) -> None:
    width = image.shape[1] // 2
    shown = "video" if frame < s.n_frames else "predicted"
    changed = "what if" if frame >= s.from_frame else f"what if, from frame {s.from_frame}"
    what = "; ".join(intervention_text(change) for change in s.interventions)
    for left, title, line in (
        (0, f"original ({shown})", f"frame {frame} of {s.changed.visible.shape[1]}"),
        (width, changed, what),
    ):
        cv2.putText(image, title, (left + 8, 19), FONT, TITLE_SCALE, INK, 1, cv2.LINE_AA)
        cv2.putText(image, _shortened(line, width), (left + 8, 39), FONT, SMALL_SCALE, INK, 1, cv2.LINE_AA)


def _shortened(text: str, width_px: int) -> str:
    """The text, or as much of it as fits over an image of that width; OpenCV writes ASCII only."""
    text = text.replace("°", " degrees")
    while cv2.getTextSize(text, FONT, SMALL_SCALE, 1)[0][0] > width_px - 16:
        text = text.removesuffix("...")[:-1] + "..."
    return text
