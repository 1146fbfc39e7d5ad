"""Is a video one of CLEVRER's scenes? Classes, layouts, cuts, and the messages about files that are no videos."""

import os
import warnings
import wave

import cv2
import numpy as np
import pytest

from nsdr import DataError, VideoError
from nsdr.clevrer.example import VIDEO
from nsdr.cli.main import main
from nsdr.frame_parser import VideoConfig
from nsdr.frame_parser.check.ground import CELL_COLUMNS, CELL_ROWS, fit_ground, read_background, references
from nsdr.frame_parser.check.layout import content_box
from nsdr.frame_parser.check.reasons import camera_motion, marked_px
from nsdr.frame_parser.check.shots import first_shot
from nsdr.frame_parser.check.video import check_video, clip_frames, look
from nsdr.generate.render.preview import render_preview
from nsdr.generate.render.view import View
from nsdr.io.video import VideoSample, read_frames, read_video, write_video
from nsdr.world.camera import Camera
from nsdr.world.world import CLEVRER_WORLD

KNOWN = list(references().values())


@pytest.fixture(scope="module")
def clip() -> np.ndarray:
    return read_video(VIDEO)[:60:3]


def seen(frames, size: tuple[int, int] | None = None):
    frames = np.ascontiguousarray(frames)
    return look(VideoSample(frames, size or (frames.shape[2], frames.shape[1])), KNOWN, CLEVRER_WORLD)


def resized(frames, width: int, height: int) -> np.ndarray:
    return np.stack([cv2.resize(f, (width, height), interpolation=cv2.INTER_AREA) for f in frames])


def padded(frames, sides: int, ends: int, value: int = 0) -> np.ndarray:
    return np.pad(frames, ((0, 0), (ends, ends), (sides, sides), (0, 0)), constant_values=value)


def shaken(frames, sigma: float) -> np.ndarray:
    shifts = np.random.default_rng(0).normal(0, sigma, (len(frames), 2))
    moves = [np.float32([[1, 0, dx], [0, 1, dy]]) for dx, dy in shifts]
    size = frames.shape[2], frames.shape[1]
    return np.stack([cv2.warpAffine(f, m, size, borderMode=1) for f, m in zip(frames, moves, strict=True)])


def captioned(frames) -> np.ndarray:
    font = cv2.FONT_HERSHEY_SIMPLEX
    return np.stack([cv2.putText(f.copy(), "a video", (20, 300), font, 1.2, (255, 255, 255), 2) for f in frames])


def noisy(frames, sigma: float) -> np.ndarray:
    noise = np.random.default_rng(0).normal(0, sigma, frames.shape)
    return np.clip(frames + noise, 0, 255).astype(np.uint8)


def read(frames) -> tuple[np.ndarray, list[str]]:
    """Frames of an iterator, and the warnings that it gave."""
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        found = np.stack(list(frames))
    return found, [str(w.message) for w in warned]


def test_clevrers_videos_are_in(clip) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert sum(1 for _ in clip_frames(VIDEO)) == 128
    assert check_video(VIDEO).kind == "in"
    assert seen(resized(clip, 240, 160)).kind == "in"


def test_the_preview_renderers_images_are_in() -> None:
    frames = np.stack([render_preview([], [], View(Camera(width=240, height=160)))] * 4)
    frames[:, 60:80, 100:120] = np.arange(4)[:, None, None, None] * 40
    assert seen(frames).kind == "in"


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda f: f[:, ::-1, ::-1], "not the empty scene"),
        (lambda f: f[:, ::-1], "not the empty scene"),
        (lambda f: np.rot90(f, 1, (1, 2)), "not the empty scene"),
        (lambda f: np.rot90(f, 3, (1, 2)), "not the empty scene"),
        (lambda f: f.mean(3, keepdims=True).repeat(3, 3).astype(np.uint8), "colours of the background"),
        (lambda f: f[..., ::-1], "colours of the background"),
        (lambda f: 255 - f, "not the empty scene"),
        (lambda f: 0 * f, "the background is black"),
        (lambda f: 0 * f + 255, "the background is white"),
        (lambda f: 0 * f + 132, "one flat colour"),
        (lambda f: f // 12, "darker"),
        (lambda f: noisy(f, 60), "noisy"),
        (lambda f: shaken(f, 4), "the camera moves, by"),
        (lambda f: np.random.default_rng(0).integers(0, 256, f.shape, dtype=np.uint8), "not the empty scene"),
        (
            lambda f: np.random.default_rng(0).integers(0, 256, (1, 8, 12, 3), dtype=np.uint8).repeat(9, 0),
            "not the empty",
        ),
    ],
)
def test_other_videos_are_out(clip, change, reason: str) -> None:
    found = seen(change(clip))
    assert found.kind == "refused"
    assert any(reason in text for text in found.refused), found.refused


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda f: f[:, :, ::-1], "mirrored"),
        (lambda f: (0.5 * f).astype(np.uint8), "darker than CLEVRER's videos by 6"),
        (lambda f: np.minimum(1.3 * f, 255).astype(np.uint8), "brighter"),
        (lambda f: (80 + 0.4 * f).astype(np.uint8), "% of the contrast"),
        (lambda f: (f * [1, 1, 0.9]).astype(np.uint8), "its tint is reddish"),
        (lambda f: noisy(f, 15), "noisy"),
        (lambda f: shaken(f, 1.5), "the camera moves, by"),
        (lambda f: captioned(f), "a caption, logo or other marks"),
        (lambda f: (255 * (f / 255.0) ** 1.8).astype(np.uint8), "corrected"),
        (lambda f: f[:1].repeat(9, 0), "nothing moves"),
        (lambda f: resized(f[:, 32:-32, 48:-48], 480, 320), "differs from the empty scene"),
        (lambda f: padded(f, 80, 0), "480x320 of 640x320 px are left"),
        (lambda f: padded(f, 60, 0, 132), "480x320 of 600x320 px are left"),
        (lambda f: padded(f, 0, 20), "480x320 of 480x360 px are left"),
        (lambda f: resized(f, 480, 270), "taken as stretched"),
        (lambda f: f[:, :, 26:-26], "taken as the middle"),
    ],
)
def test_unusual_videos_say_why(clip, change, reason: str) -> None:
    found = seen(change(clip))
    assert found.kind == "warned"
    assert any(reason in text for text in found.warned), found.warned


def test_bars_are_found_to_the_pixel(clip) -> None:
    assert content_box(np.median(padded(clip, 33, 17), 0)) == (33, 17, 513, 337)
    assert content_box(np.median(clip, 0)) == (0, 0, 480, 320)
    assert content_box(np.zeros((20, 30, 3))) == (0, 0, 30, 20)


def test_layouts_are_in_the_videos_own_pixels(clip) -> None:
    found = seen(resized(padded(clip, 120, 0), 480, 213), (1440, 640))
    assert found.layout.box_xyxy_px == pytest.approx((240, 0, 1200, 640), abs=6)


def test_frames_are_cut_out_and_stretched_back(clip, tmp_path) -> None:
    for name, frames in (("bars", padded(clip, 80, 0)), ("stretched", resized(clip, 480, 480))):
        write_video(tmp_path / f"{name}.mp4", frames)
        found, warned = read(clip_frames(tmp_path / f"{name}.mp4"))
        assert found.shape == clip.shape
        assert np.abs(found.astype(int) - clip).mean() < 2
        assert any("cut off" in text or "stretched back" in text for text in warned)


@pytest.mark.parametrize(
    "change",
    [lambda f: 0.5 * f, lambda f: 80 + 0.4 * f, lambda f: 255 * (f / 255) ** 1.8, lambda f: np.minimum(1.3 * f, 255)],
)
def test_exposure_and_contrast_are_corrected(clip, change) -> None:
    changed = change(clip.astype(float)).astype(np.uint8)
    levels = seen(changed).levels
    assert levels is not None
    assert np.abs(levels[changed].astype(int) - clip).mean() < 4 < np.abs(changed.astype(int) - clip).mean()
    assert seen(clip).levels is None


def test_cropped_videos_keep_their_levels(clip) -> None:
    found = seen(resized(clip[:, 32:-32, 48:-48], 480, 320))
    assert found.kind == "warned"
    assert found.levels is None


def test_empty_frames_at_the_start_are_left_out(clip, tmp_path) -> None:
    write_video(tmp_path / "v.mp4", np.concatenate([np.zeros_like(clip[:5]), clip]))
    found, warned = read(clip_frames(tmp_path / "v.mp4"))
    assert len(found) == len(clip)
    assert any("the first 5 frames show nothing; they are left out" in text for text in warned)


def test_a_video_that_shows_nothing_is_named(clip, tmp_path) -> None:
    write_video(tmp_path / "v.mp4", np.zeros_like(clip[:5]), preset="veryfast")
    with (
        warnings.catch_warnings(action="ignore"),
        pytest.raises(VideoError, match=r"v\.mp4: shows nothing; each of its 5"),
    ):
        next(clip_frames(tmp_path / "v.mp4", VideoConfig("warn")))


def test_objects_are_no_camera_motion_and_no_marks(clip) -> None:
    for frames in (clip, clip[::-1], clip[:5], clip[:2]):
        assert camera_motion(frames) < 0.1
    still = np.median(clip, 0).astype(np.uint8)
    ground, reference = min(((fit_ground(still, r), r) for r in KNOWN), key=lambda f: f[0].distance)
    assert marked_px(still, reference, ground) < 50 < 500 < marked_px(captioned(still[None])[0], reference, ground)


def test_out_is_an_error_unless_forced(clip, tmp_path) -> None:
    write_video(tmp_path / "v.mp4", clip[:, ::-1])
    with pytest.raises(
        VideoError,
        match=r"v\.mp4: not a video of CLEVRER's scene: the background is not the empty scene.*upright.*--force",
    ):
        next(clip_frames(tmp_path / "v.mp4"))
    found, warned = read(clip_frames(tmp_path / "v.mp4", VideoConfig("warn")))
    assert len(found) == len(clip)
    assert any("the background is not the empty scene" in text for text in warned)
    found, warned = read(clip_frames(tmp_path / "v.mp4", VideoConfig("off")))
    assert len(found) == len(clip)
    assert warned == [f"{tmp_path / 'v.mp4'}: 20 frames, CLEVRER's videos have 128"]


def test_an_own_background(tmp_path) -> None:
    empty = render_preview([], [], View(Camera(eye_world=(3.0, 3.0, 2.5))))
    cv2.imwrite(str(tmp_path / "empty.png"), empty[..., ::-1])
    frames = np.stack([empty] * 4)
    frames[:, 150:180, 200:230] = np.arange(4)[:, None, None, None] * 60
    write_video(tmp_path / "v.mp4", frames.repeat(3, 0))
    assert check_video(tmp_path / "v.mp4", VideoConfig("warn")).kind == "refused"
    config = VideoConfig("warn", background=str(tmp_path / "empty.png"))
    assert check_video(tmp_path / "v.mp4", config).kind == "in"
    cv2.imwrite(str(tmp_path / "empty.png"), empty[::-1])
    assert check_video(tmp_path / "v.mp4", config).kind == "refused"
    cv2.imwrite(str(tmp_path / "empty.png"), empty[..., ::-1])
    assert check_video(tmp_path / "v.mp4", config).kind == "in"
    with pytest.raises(DataError, match=r"none\.png: no such file; expected an image"):
        read_background(tmp_path / "none.png")
    with pytest.raises(DataError, match=r"v\.mp4: not an image"):
        read_background(tmp_path / "v.mp4")


def test_the_fit_undoes_exposure_and_ignores_objects() -> None:
    reference = references()["clevrer"]
    image = 0.7 * reference + 10
    image[:10, :20] = 255
    found = fit_ground(image, reference)
    assert image.shape == (CELL_ROWS, CELL_COLUMNS, 3)
    assert found.gain == pytest.approx(0.7, abs=1e-3)
    assert found.distance == pytest.approx(0, abs=1e-2)
    assert found.color == pytest.approx(1, abs=1e-3)


@pytest.mark.parametrize("settings", [{"check": "maybe"}, {"max_frames": 0}])
def test_settings_are_checked(settings) -> None:
    with pytest.raises(DataError, match=next(iter(settings))):
        VideoConfig(**settings)


def ball(x: float) -> np.ndarray:
    image = np.full((320, 480, 3), 130, np.uint8)
    cv2.circle(image, (int(x), 160), 30, (200, 30, 30), -1)
    return image


def shot(positions, max_frames: int = 512) -> tuple[int, list[str]]:
    """How many frames of a ball's positions are used, and the notes about them."""
    notes: list[str] = []
    return sum(1 for _ in first_shot(iter([ball(x) for x in positions]), max_frames, 25, notes.append)), notes


def test_a_clip_that_is_repeated_ends_at_the_jump() -> None:
    once = [40 + 5 * f for f in range(40)]
    n, (note,) = shot(once * 2)
    assert n == 40
    assert "a cut after 40 frames (1.6 s)" in note


def test_motion_is_no_cut() -> None:
    slow_then_fast = [40 + f for f in range(20)] + [60 + 12 * f for f in range(20)]
    repeated = [40 + 8 * (f * 3 // 5) for f in range(60)]  # 15 frames per second, written as 25
    stops = [40 + 10 * min(f, 15) for f in range(30)]
    for positions in (slow_then_fast, repeated, stops):
        assert shot(positions) == (len(positions), [])


def test_long_videos_are_ended() -> None:
    n, (note,) = shot([40 + 5 * f for f in range(30)], max_frames=10)
    assert n == 10
    assert "longer than 10 frames (0.4 s)" in note
    assert shot([40 + 5 * f for f in range(10)], max_frames=10) == (10, [])


def write_kind(path, kind: str) -> None:
    if kind == "folder":
        path.mkdir()
    elif kind == "image":
        path.write_bytes(cv2.imencode(".png", ball(90))[1].tobytes())
    elif kind == "sound":
        with wave.open(str(path), "wb") as file:
            file.setparams((1, 2, 8000, 0, "NONE", ""))
            file.writeframes(bytes(8000))
    elif kind != "missing":
        path.write_bytes({"empty": b"", "text": b"hello\n" * 10, "zip": b"PK\x03\x04 and so on\0"}[kind])


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("missing", "no such file"),
        ("folder", "is a folder without images; expected a video"),
        ("empty", r"is empty \(0 bytes\)"),
        ("text", "is a text file"),
        ("image", "is an image"),
        ("sound", "does not begin as an MP4"),
        ("zip", r"is an archive \(ZIP or NPZ\)"),
    ],
)
def test_what_is_no_video_is_named(tmp_path, kind: str, message: str) -> None:
    write_kind(tmp_path / "v.mp4", kind)
    for function in (read_video, check_video):
        with pytest.raises(VideoError, match=rf"v\.mp4: {message}"):
            function(tmp_path / "v.mp4")


def test_a_codec_that_opencv_lacks_is_told_how_to_be_converted(tmp_path) -> None:
    import av

    with av.open(str(tmp_path / "v.mp4"), "w", format="mp4") as container:
        stream = container.add_stream("libsvtav1", rate=25)
        stream.width, stream.height, stream.pix_fmt = 64, 64, "yuv420p"
        frame = av.VideoFrame.from_ndarray(np.zeros((64, 64, 3), np.uint8), format="rgb24")
        for packet in (*stream.encode(frame), *stream.encode(None)):
            container.mux(packet)
    # SVT-AV1, run by root, made this a real-time process, beside which others starve.
    if hasattr(os, "sched_setscheduler"):
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    with pytest.raises(VideoError, match=r"v\.mp4: not a video that OpenCV can read, .* convert it to H\.264: ffmpeg"):
        read_video(tmp_path / "v.mp4")


def test_a_variable_frame_rate_keeps_the_time(tmp_path) -> None:
    import av

    with av.open(str(tmp_path / "v.mp4"), "w") as container:
        stream = container.add_stream("libx264", rate=25, options={"crf": "10"})
        stream.width, stream.height, stream.pix_fmt = 480, 320, "yuv420p"
        times = [*range(20), *range(20, 60, 4), *range(60, 80)]
        for time in times:
            frame = av.VideoFrame.from_ndarray(np.full((320, 480, 3), 40 + 2 * time, np.uint8), format="rgb24")
            frame.pts = time
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    found, warned = read(read_frames(tmp_path / "v.mp4"))
    assert any("variable frame rate" in text for text in warned)
    assert len(found) == pytest.approx(80, abs=2)
    shown = (found[:, 160, 240, 0].astype(float) - 40) / 2
    assert np.abs(shown - np.arange(len(found)))[:20].max() < 2
    assert np.abs(shown - np.arange(len(found)))[60:78].max() < 2


@pytest.mark.parametrize("command", ["answer", "parse", "visualize"])
def test_commands_refuse_before_the_weights_are_loaded(clip, tmp_path, monkeypatch, capsys, command: str) -> None:
    from nsdr import Pipeline

    monkeypatch.setattr(Pipeline, "from_pretrained", lambda *_, **__: pytest.fail("the weights are loaded"))
    write_video(tmp_path / "v.mp4", 0 * clip[:4])
    options = {"answer": ["How many spheres are moving?"], "parse": ["-o", str(tmp_path / "s.json")]}
    output = options.get(command, ["-o", str(tmp_path / "v.png")])
    assert main([command, str(tmp_path / "v.mp4"), *output]) == 2
    assert "the background is black" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("output", "package"),
    [(["v.mp4"], "PyAV"), (["r.html"], "matplotlib"), (["p.png", "--image", "plan"], "matplotlib")],
)
def test_missing_extras_are_found_before_the_work(tmp_path, monkeypatch, capsys, output, package: str) -> None:
    from nsdr.cli import perceive

    monkeypatch.setattr("importlib.util.find_spec", lambda _: None)
    monkeypatch.setattr(perceive, "make_pipeline", lambda _: pytest.fail("the work has begun"))
    assert main(["visualize", str(VIDEO), "-o", str(tmp_path / output[0]), *output[1:]]) == 2
    assert f"need{'s' if package == 'PyAV' else ''} {package}: pip install 'nsdr[visualize]'" in capsys.readouterr().err
