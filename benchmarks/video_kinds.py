"""Altered, encoded and foreign videos for `benchmarks.videos`: each is made from a clip's frames, or from nothing."""

from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from nsdr.generate.render.geometry import Solid
from nsdr.generate.render.preview import render_preview
from nsdr.generate.render.view import View
from nsdr.types import SceneObject
from nsdr.world.camera import Camera

Frames = NDArray[np.uint8]
"""(F, height, width, 3) RGB."""
Alteration = Callable[[Frames], Frames]
COUNT, SIZE = 128, (320, 480)


def _each(change: Callable[[NDArray[np.uint8]], NDArray[np.uint8]]) -> Alteration:
    return lambda frames: np.stack([change(frame) for frame in frames])


def _resized(width: int, height: int) -> Alteration:
    return _each(lambda frame: cv2.resize(frame, (width, height), interpolation=cv2.INTER_AREA))


def _cut(left: float, top: float, right: float, bottom: float, resize: bool = True) -> Alteration:
    """The part of the image between these shares of its sides, at the size of the image or its own."""

    def change(frame: NDArray[np.uint8]) -> NDArray[np.uint8]:
        h, w = frame.shape[:2]
        part = frame[int(top * h) // 2 * 2 : int(bottom * h) // 2 * 2, int(left * w) // 2 * 2 : int(right * w) // 2 * 2]
        return cv2.resize(part, (w, h), interpolation=cv2.INTER_AREA) if resize else part

    return _each(change)


def _padded(sides: int, ends: int, value: int | None = 0) -> Alteration:
    """Bars of so many pixels at left and right, top and bottom; of the first frame's mean colour if `value` is None."""

    def change(frames: Frames) -> Frames:
        color = frames[0].reshape(-1, 3).mean(0).astype(np.uint8) if value is None else value
        shape = (len(frames), frames.shape[1] + 2 * ends, frames.shape[2] + 2 * sides, 3)
        result = np.full(shape, color, np.uint8)
        result[:, ends : ends + frames.shape[1], sides : sides + frames.shape[2]] = frames
        return result

    return change


def _levels(gain: float, offset: float = 0.0, gamma: float = 1.0) -> Alteration:
    table = np.clip(255 * (np.arange(256) / 255) ** gamma * gain + offset, 0, 255).astype(np.uint8)
    return lambda frames: table[frames]


def _gray(frames: Frames) -> Frames:
    return np.stack([cv2.cvtColor(cv2.cvtColor(f, cv2.COLOR_RGB2GRAY), cv2.COLOR_GRAY2RGB) for f in frames])


def _noisy(sigma: float) -> Alteration:
    def change(frames: Frames) -> Frames:
        rng = np.random.default_rng(0)
        return np.stack([np.clip(f + sigma * rng.standard_normal(f.shape), 0, 255).astype(np.uint8) for f in frames])

    return change


def _hue(shift: int) -> Alteration:
    def change(frame: NDArray[np.uint8]) -> NDArray[np.uint8]:
        hsv = cv2.cvtColor(frame, cv2.COLOR_RGB2HSV)
        hsv[..., 0] = (hsv[..., 0].astype(int) + shift) % 180
        return cv2.cvtColor(hsv, cv2.COLOR_HSV2RGB)

    return _each(change)


def _turned(degrees: float) -> Alteration:
    def change(frame: NDArray[np.uint8]) -> NDArray[np.uint8]:
        h, w = frame.shape[:2]
        matrix = cv2.getRotationMatrix2D((w / 2, h / 2), degrees, 1.0)
        return cv2.warpAffine(frame, matrix, (w, h), borderMode=cv2.BORDER_REPLICATE)

    return _each(change)


def _shaken(frames: Frames) -> Frames:
    rng = np.random.default_rng(0)
    moved = []
    for frame in frames:
        dx, dy = rng.normal(0, 4, 2)
        moved.append(cv2.warpAffine(frame, np.float32([[1, 0, dx], [0, 1, dy]]), SIZE[::-1], borderMode=1))
    return np.stack(moved)


def _captioned(frames: Frames) -> Frames:
    result = frames.copy()
    for frame in result:
        cv2.putText(frame, "sample video", (20, 300), cv2.FONT_HERSHEY_SIMPLEX, 1.2, (255, 255, 255), 2)
    return result


def write(path: Path, frames: Frames, rate: float = 25, crf: int = 23) -> Path:
    """As people encode videos: x264, by default at its default quality; fast, because there are many."""
    with av.open(str(path), "w") as container:
        stream: Any = container.add_stream("libx264", rate=Fraction(rate).limit_denominator(1000))
        stream.height, stream.width = frames.shape[1] // 2 * 2, frames.shape[2] // 2 * 2
        stream.pix_fmt, stream.options = "yuv420p", {"preset": "veryfast", "crf": str(crf)}
        for frame in frames[:, : stream.height, : stream.width]:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(np.ascontiguousarray(frame), format="rgb24")))
        container.mux(stream.encode())
    return path


def at_rate(frames: Frames, rate: float) -> Frames:
    """The frames nearest in time at another rate."""
    index = np.round(np.arange(int(len(frames) * rate / 25)) * 25 / rate).astype(int)
    return frames[np.minimum(index, len(frames) - 1)]


def _mp4(crf: int = 20, change: Alteration = lambda frames: frames) -> Callable[[Path, Frames], Path]:
    return lambda folder, frames: write(folder / "video.mp4", change(frames), crf=crf)


def _animated(suffix: str, every: int = 1) -> Callable[[Path, Frames], Path]:
    def save(folder: Path, frames: Frames) -> Path:
        images = [Image.fromarray(frame) for frame in frames[::every]]
        images[0].save(folder / f"video{suffix}", save_all=True, append_images=images[1:], duration=40 * every)
        return folder / f"video{suffix}"

    return save


def _pngs(folder: Path, frames: Frames) -> Path:
    for k, frame in enumerate(frames):
        cv2.imwrite(str(folder / f"frame_{k}.png"), cv2.cvtColor(frame, cv2.COLOR_RGB2BGR))
    return folder


def _blurred(sigma: float) -> Alteration:
    return _each(lambda frame: np.asarray(cv2.GaussianBlur(frame, (0, 0), sigma), np.uint8))


ENCODED: dict[str, Callable[[Path, Frames], Path]] = {
    "encoded again": _mp4(),
    "GIF": _animated(".gif"),
    "GIF, 12.5 frames a second": _animated(".gif", 2),
    "GIF, 8.3 frames a second": _animated(".gif", 3),
    "GIF, 6.25 frames a second": _animated(".gif", 4),
    "WebP": _animated(".webp"),
    "folder of PNG": _pngs,
    "240x160": _mp4(change=_resized(240, 160)),
    "128x86": _mp4(change=_resized(128, 86)),
    **{f"blurred, {sigma} pixels": _mp4(change=_blurred(sigma)) for sigma in (1, 2, 3)},
    **{f"x264 with crf {crf}": _mp4(crf) for crf in (40, 48)},
}
"""Kind -> what writes a clip's frames below a folder, and gives the path."""

RATES = {"15 fps": 15, "20 fps": 20, "24 fps": 24, "30 fps": 30, "50 fps": 50, "60 fps": 60}
"""Kinds that only change the frame rate: the frames nearest in time."""

ALTERED: dict[str, tuple[str, Alteration]] = {
    "unchanged": ("in", lambda f: f),
    "480x320, blurred": ("in, warned", _blurred(1.5)),
    "240x160": ("in, warned", _resized(240, 160)),
    "720x480": ("in, warned", _resized(720, 480)),
    "first 60 frames": ("in, warned", lambda f: f[:60]),
    "2 frames": ("warned, refused", lambda f: f[:2]),
    "frozen": ("warned, refused", lambda f: np.repeat(f[60:61], COUNT, 0)),
    "looped": ("warned", lambda f: np.concatenate([f, f])),
    "backwards": ("in, warned", lambda f: f[::-1]),
    "black second first": ("warned, refused", lambda f: np.concatenate([0 * f[:25], f])),
    "mirrored": ("warned", lambda f: f[:, :, ::-1]),
    "upside down": ("refused", lambda f: f[:, ::-1]),
    "rotated by 180": ("refused", lambda f: f[:, ::-1, ::-1]),
    "rotated by 90": ("refused", lambda f: np.rot90(f, 1, (1, 2))),
    "turned by 10": ("warned, refused", _turned(10)),
    "grayscale": ("refused", _gray),
    "red and blue exchanged": ("refused", lambda f: f[..., ::-1]),
    "colours inverted": ("refused", lambda f: 255 - f),
    "hues shifted by 60": ("warned, refused", _hue(30)),
    "hues shifted by 120": ("warned, refused", _hue(60)),
    "darker 0.8": ("in, warned", _levels(0.8)),
    "darker 0.5": ("warned", _levels(0.5)),
    "darker 0.25": ("warned, refused", _levels(0.25)),
    "brighter 1.3": ("in, warned", _levels(1.3)),
    "gamma 1.8": ("warned", _levels(1.0, gamma=1.8)),
    "low contrast": ("warned", _levels(0.4, 80)),
    "noise 5": ("in, warned", _noisy(5)),
    "noise 15": ("warned", _noisy(15)),
    "noise 40": ("warned, refused", _noisy(40)),
    "shaken": ("warned, refused", _shaken),
    "caption": ("in, warned", _captioned),
    "pillarbox 640x320": ("warned", _padded(80, 0)),
    "letterbox 480x360": ("warned", _padded(0, 20)),
    "letterbox, white": ("warned", _padded(0, 40, 255)),
    "pillarbox, gray": ("warned", _padded(60, 0, None)),
    "window box": ("warned", _padded(40, 40)),
    "stretched 480x360": ("warned", _resized(480, 360)),
    "stretched 640x360": ("warned", _resized(640, 360)),
    "stretched 480x480": ("warned", _resized(480, 480)),
    "cropped to 4:3": ("warned", _cut(1 / 18, 0, 17 / 18, 1, resize=False)),
    "cropped to 1:1": ("warned", _cut(1 / 6, 0, 5 / 6, 1, resize=False)),
    "cropped to 16:9": ("warned", _cut(0, 0.08, 1, 0.92, resize=False)),
    "cropped by 5 %, resized": ("in, warned", _cut(0.05, 0.05, 0.95, 0.95)),
    "cropped by 10 %, resized": ("warned", _cut(0.1, 0.1, 0.9, 0.9)),
    "cropped by 20 %, resized": ("warned, refused", _cut(0.2, 0.2, 0.8, 0.8)),
}
"""Kind -> (classes that are right for it, how the frames are changed)."""


def _textures(rng: np.random.Generator, sizes: tuple[int, ...]) -> NDArray[np.float32]:
    """A coloured texture (600, 2000, 3), 0-1, with structure of the given sizes (pixels)."""
    image = np.zeros((600, 2000, 3), np.float32)
    for size in sizes:
        coarse = rng.random((600 // size + 2, 2000 // size + 2, 3)).astype(np.float32)
        image += size**0.5 * cv2.resize(coarse, (2000, 600), interpolation=cv2.INTER_CUBIC)
    low, high = np.percentile(image, [1, 99])
    return np.clip((image - low) / (high - low), 0, 1)


def _street(rng: np.random.Generator) -> Frames:
    """Sky, houses, a road and cars of several colours that drive by while the camera pans."""
    walls = (255 * _textures(rng, (8, 40, 160))).astype(np.uint8)
    frames = []
    cars = [(tuple(map(int, rng.integers(0, 255, 3))), rng.uniform(-6, 6), rng.uniform(0, 480)) for _ in range(4)]
    for f in range(COUNT):
        frame = walls[:320, f * 3 : f * 3 + 480].copy()
        frame[:90] = (150, 190, 230)
        frame[220:] = (90, 90, 95)
        for k, (color, speed, start) in enumerate(cars):
            x = int(start + speed * f) % 560 - 80
            cv2.rectangle(frame, (x, 200 + 20 * k), (x + 70, 230 + 20 * k), color, -1)
        frames.append(frame)
    return np.stack(frames)


def _bars(_: np.random.Generator) -> Frames:
    colors = [(191, 191, 191), (191, 191, 0), (0, 191, 191), (0, 191, 0), (191, 0, 191), (191, 0, 0), (0, 0, 191)]
    image = np.zeros((*SIZE, 3), np.uint8)
    for k, color in enumerate(colors):
        image[:, k * 480 // 7 : (k + 1) * 480 // 7] = color
    frames = np.repeat(image[None], COUNT, 0)
    for f, frame in enumerate(frames):
        frame[280:300, (3 * f) % 460 : (3 * f) % 460 + 20] = 255
    return frames


def _slope(_: np.random.Generator) -> Frames:
    """A still grey gradient near CLEVRER's brightness, with a ball that moves."""
    image = np.repeat(np.linspace(100, 160, 320)[:, None], 480, 1)[..., None].repeat(3, 2).astype(np.uint8)
    return _balls_on(image)


def _balls_on(image: NDArray[np.uint8]) -> Frames:
    frames = np.repeat(image[None], COUNT, 0)
    colors = [(200, 30, 30), (30, 160, 40), (40, 60, 200)]
    for f, frame in enumerate(frames):
        for k, color in enumerate(colors):
            cv2.circle(frame, (int(40 + (2 + k) * f) % 480, 110 + 70 * k), 24, color, -1)
    return frames


def _cartoon(rng: np.random.Generator) -> Frames:
    image = np.full((*SIZE, 3), (150, 210, 250), np.uint8)
    image[200:] = (110, 200, 90)
    cv2.circle(image, (400, 60), 35, (250, 220, 60), -1)
    return _balls_on(image)


def _text(_: np.random.Generator) -> Frames:
    image = np.full((*SIZE, 3), 30, np.uint8)
    for row in range(14):
        cv2.putText(image, "def line(): return 42  # text", (10, 20 + 22 * row), 0, 0.6, (200, 220, 200), 1)
    frames = np.repeat(image[None], COUNT, 0)
    for f, frame in enumerate(frames):
        frame[10:24, 400 : 410 if f % 20 < 10 else 400] = 255
    return frames


def _plot(_: np.random.Generator) -> Frames:
    """White ground, axes, and points that move, as an animated figure has."""
    image = np.full((*SIZE, 3), 255, np.uint8)
    cv2.rectangle(image, (40, 20), (460, 290), (0, 0, 0), 1)
    return _balls_on(image)


def _noise(rng: np.random.Generator) -> Frames:
    return rng.integers(0, 256, (COUNT, *SIZE, 3), dtype=np.uint8)


def _flat(value: int) -> Callable[[np.random.Generator], Frames]:
    return lambda _: np.full((COUNT, *SIZE, 3), value, np.uint8)


def _seen_from(*eye: float) -> Callable[[np.random.Generator], Frames]:
    """CLEVRER's ground and lamps with three objects, by the preview renderer, from another place (world units)."""

    def make(_: np.random.Generator) -> Frames:
        view = View(Camera((eye[0], eye[1], eye[2])))
        words = [("red", "rubber", "sphere"), ("cyan", "metal", "cube"), ("green", "rubber", "cylinder")]
        objects = [SceneObject(k, *word) for k, word in enumerate(words)]
        frames = []
        for f in range(0, COUNT, 4):
            places = [(-1.0 + 0.02 * f, -1.0, 0.2), (0.5, 1.5 - 0.01 * f, 0.2), (1.0, 0.0, 0.2)]
            solids = [Solid(o.shape, np.array(p), np.eye(3)) for o, p in zip(objects, places, strict=True)]
            frames.append(render_preview(objects, solids, view))
        return np.repeat(np.stack(frames), 4, 0)

    return make


FOREIGN: dict[str, tuple[str, Callable[[np.random.Generator], Frames]]] = {
    "black": ("refused", _flat(0)),
    "white": ("refused", _flat(255)),
    "grey of CLEVRER's ground": ("refused", _flat(132)),
    "noise": ("refused", _noise),
    "street": ("refused", _street),
    "test bars": ("refused", _bars),
    "grey slope with balls": ("refused", _slope),
    "flat grey with balls": ("refused", lambda rng: _balls_on(_flat(132)(rng)[0])),
    "cartoon": ("refused", _cartoon),
    "text": ("refused", _text),
    "plot": ("refused", _plot),
    "camera from above": ("warned, refused", _seen_from(1.0, 0.0, 5.0)),
    "camera at the side": ("warned, refused", _seen_from(3.0, 3.0, 2.5)),
    "camera nearer": ("warned, refused", _seen_from(3.3, 0.0, 1.9)),
    "camera farther": ("warned, refused", _seen_from(6.0, 0.0, 3.5)),
    "camera a little aside": ("in, warned, refused", _seen_from(4.3, 0.5, 2.6)),
}
"""Kind -> (classes that are right for it, how it is made)."""
