"""Videos as models write them: animated images, folders of frames, other rates; and which of them are judged."""

import json
import os
import shutil
import warnings
from itertools import islice
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import pytest
from PIL import Image

from nsdr import DataError, FrameParser, Pipeline, VideoError, VideoProposals
from nsdr.clevrer.example import VIDEO
from nsdr.cli.main import main
from nsdr.dynamics.sliding import slide
from nsdr.frame_parser import FrameParserConfig, VideoConfig, build_frame_parser
from nsdr.frame_parser.check.video import clip_frames
from nsdr.io.decoding import find_videos
from nsdr.io.fingerprint import fingerprint
from nsdr.io.images import open_images
from nsdr.io.video import (
    even_frames,
    frame_rate,
    read_frames,
    read_video,
    sample_frames,
    video_seconds,
    write_video,
)
from nsdr.laws.judge import judge_proposals as judge
from nsdr.tracking.localization import outline
from nsdr.world.camera import CLEVRER_CAMERA
from nsdr.world.vocabulary import CLEVRER
from nsdr.world.world import CLEVRER_WORLD

from .test_dynamics import LAWS

N = 12
VideoCapture = cv2.VideoCapture


def frame(time: float, size: tuple[int, int] = (480, 320)) -> np.ndarray:
    """A white bar tells the time: 10 of 480 pixels for each 25th of a second."""
    image = np.zeros((320, 480, 3), np.uint8)
    image[:, : round(10 * time)] = 255
    return cv2.resize(image, size)


def times_of(frames) -> np.ndarray:
    return np.array([(f[160, :, 0] > 127).sum() / 10 for f in frames])


def save(path: Path, frames: list[np.ndarray], duration_ms) -> Path:
    images = [Image.fromarray(f) for f in frames]
    options = {"lossless": True} if path.suffix == ".webp" else {}
    images[0].save(path, save_all=True, append_images=images[1:], duration=duration_ms, **options)
    return path


def folder_of(path: Path, names: list[str]) -> Path:
    path.mkdir()
    for k, name in enumerate(names):
        cv2.imwrite(str(path / name), frame(k + 1))
    return path


def read(path: Path, **options) -> tuple[np.ndarray, list[str]]:
    with warnings.catch_warnings(record=True) as given:
        warnings.simplefilter("always")
        frames = np.stack(list(read_frames(path, **options)))
    texts = [str(w.message).removeprefix(f"{path}: ") for w in given]
    return frames, [text for text in texts if "CLEVRER's videos have 128" not in text]


@pytest.mark.parametrize("suffix", [".gif", ".webp", ".png"])
@pytest.mark.parametrize("spacing", [1, 2, 3])
def test_animated_images_are_videos(tmp_path, suffix: str, spacing: int) -> None:
    path = save(tmp_path / f"v{suffix}", [frame(1 + spacing * k) for k in range(N)], 40 * spacing)
    frames, warned = read(path)
    assert warned == ([] if spacing == 1 else [f"{25 / spacing:g} frames per second, resampled to 25"])
    assert times_of(frames).tolist() == [1 + spacing * (k // spacing) for k in range(spacing * N)]
    assert video_seconds(path) == pytest.approx(0.04 * spacing * N)


def test_frames_that_a_writer_joined_keep_their_time(tmp_path) -> None:
    images = [frame(t) for t in (1, 2, 5, 6)]
    frames, warned = read(save(tmp_path / "v.gif", images, [40, 120, 40, 2000]))  # the last one is held
    assert times_of(frames).tolist() == [1, 2, 2, 2, 5, 6]
    assert warned == []


def test_a_variable_frame_rate_of_an_animated_image_is_warned_of(tmp_path) -> None:
    assert (
        "variable frame rate"
        in read(save(tmp_path / "v.gif", [frame(t) for t in (1, 2, 5, 6)], [40, 60, 40, 40]))[1][0]
    )


@pytest.mark.parametrize("duration", [0, 10])
def test_an_animated_image_without_a_rate_is_warned_of(tmp_path, duration: int) -> None:
    path = save(tmp_path / "v.gif", [frame(k + 1) for k in range(N)], duration)
    frames, warned = read(path)
    assert len(frames) == N
    assert "does not say its frame rate; taken as 25 per second; --fps" in warned[0]
    assert video_seconds(path) == pytest.approx(N / 25)
    assert video_seconds(path, fps=12.5) == pytest.approx(N / 12.5)
    frames, warned = read(path, fps=12.5)
    assert len(frames) == 2 * N
    assert warned == ["12.5 frames per second, resampled to 25"]


def test_a_given_rate_holds_in_place_of_the_files(tmp_path) -> None:
    path = save(tmp_path / "v.webp", [frame(1 + 3 * k) for k in range(N)], 100)
    assert times_of(read(path, fps=25 / 3)[0])[[0, 3, 6]].tolist() == [1, 4, 7]
    writer = cv2.VideoWriter(str(tmp_path / "v.mp4"), cv2.VideoWriter_fourcc(*"mp4v"), 10, (480, 320))
    for k in range(N):
        writer.write(frame(k + 1))
    writer.release()
    assert len(read(tmp_path / "v.mp4")[0]) == 2.5 * N
    assert len(read(tmp_path / "v.mp4", fps=25)[0]) == N
    assert video_seconds(tmp_path / "v.mp4", fps=25) == pytest.approx(N / 25)
    for path in (tmp_path / "v.mp4", tmp_path / "v.webp"):
        with pytest.raises(VideoError, match=r"2000 frames per second, expected 1 to 1000"):
            read(path, fps=2000)
    with pytest.raises(DataError, match="fps"):
        VideoConfig(fps=-1)


@pytest.mark.parametrize("rate", ["inf", "1e9"])
@pytest.mark.parametrize("command", [["judge"], ["answer", "How many collisions happen?"]])
def test_a_given_rate_out_of_range_is_refused_with_the_range(tmp_path, rate: str, command: list[str], capsys) -> None:
    assert main([command[0], str(tmp_path / "v.mp4"), *command[1:], "--fps", rate]) == 2
    assert "fps: Expected `float` <= 1000.0" in capsys.readouterr().err


def test_a_folder_of_frames_is_a_video_in_the_order_of_its_numbers(tmp_path) -> None:
    path = folder_of(tmp_path / "v", [f"frame{k}.png" for k in range(8, 20)])
    (path / "notes.txt").write_text("no frame")
    frames, warned = read(path)
    assert times_of(frames).tolist() == list(range(1, 13))
    assert "does not say its frame rate" in warned[0]
    assert read(path, fps=25)[1] == []
    assert video_seconds(path, fps=25) == pytest.approx(N / 25)


@pytest.mark.parametrize(
    ("names", "message"),
    [
        (["a1.png", "a2.png", "a4.png", "a5.png"], r"frames are missing after a2\.png"),
        (["a1.png", "b2.png"], "holds the frames of several videos"),
        (["a1.png", "a01.png"], "holds the frames of several videos"),
        (["a1.png", "cover.png"], r"cover\.png: expected a frame's number"),
        (["a1.jpg", "broken2.gif"], ""),
        ([], "is a folder without images"),
    ],
)
def test_folders_that_are_not_one_video_are_refused(tmp_path, names, message: str) -> None:
    path = folder_of(tmp_path / "v", names)
    if not message:
        assert open_images(path).files == (path / "a1.jpg",)  # other kinds of files are no frames
        return
    with pytest.raises(VideoError, match=message):
        read(path)


def test_frames_that_cannot_be_read_are_named(tmp_path) -> None:
    path = folder_of(tmp_path / "v", ["a1.png", "a2.png"])
    cv2.imwrite(str(path / "a2.png"), frame(2, (240, 160)))
    with pytest.raises(VideoError, match=r"a2\.png: 240x160 px, the first frame 480x320; all need one size"):
        read(path)
    (path / "a2.png").write_bytes((path / "a1.png").read_bytes()[:200])
    with pytest.raises(VideoError, match=r"a2\.png: a damaged image, or cut off"):
        read(path)
    (path / "a2.png").write_text("no image")
    with pytest.raises(VideoError, match=r"a2\.png: a damaged image"):
        read(path)
    noise = np.random.default_rng(0).integers(0, 255, (3, 32, 48, 3)).astype(np.uint8)
    gif = save(tmp_path / "v.gif", list(noise), 40)
    whole = gif.read_bytes()
    gif.write_bytes(whole[:-200])
    with pytest.raises(VideoError, match=r"v\.gif: a damaged image, or cut off"):
        read(gif)
    for size in range(14, 1100, 7):  # wherever it is cut off, as in a table of colours
        gif.write_bytes(whole[:size])
        with pytest.raises(VideoError, match=r"v\.gif: "):
            read(gif)


def test_frames_of_odd_sides_are_not_written(tmp_path) -> None:
    with pytest.raises(DataError, match=r"v\.mp4: expected frames of even sides, as H\.264 wants, got \(33, 48, 3\)"):
        write_video(tmp_path / "v.mp4", [np.zeros((33, 48, 3), np.uint8)])


def gif_of_repeats(path: Path, frames: int, side: int) -> Path:
    """A GIF whose first frame is all of one colour, and whose other frames are a pixel each; Pillow draws all of each frame."""
    Image.new("P", (side, side)).save(path, save_all=True, append_images=[Image.new("P", (1, 1))], duration=40)
    whole = path.read_bytes()
    dot = b"!\xf9\x04\x04\x04\0\0\0,\0\0\0\0\x01\0\x01\0\0\x02\x02\x44\x01\0"
    path.write_bytes(whole[: whole.rindex(b"!\xf9\x04")] + frames * dot + b";")
    return path


@pytest.mark.parametrize("limit", ["", "video_pixels=100000000"])
def test_what_an_animated_image_holds_is_limited_before_it_is_decoded(tmp_path, monkeypatch, limit: str) -> None:
    path, decoded = gif_of_repeats(tmp_path / "v.gif", 6000, 1000 if limit else 3160), []
    monkeypatch.setattr(Image.Image, "load", lambda image: decoded.append(image))
    if limit:
        monkeypatch.setenv("NSDR_LIMITS", limit)
    for function in (read, even_frames, video_seconds, frame_rate):
        with pytest.raises(VideoError, match=r"v\.gif: .* video_pixels, more than"):
            function(path)
    assert decoded == []


@pytest.mark.parametrize("suffix", [".gif", ".webp", ".png"])
def test_the_length_of_an_animated_image_is_known_before_it_is_decoded(tmp_path, monkeypatch, suffix: str) -> None:
    path = save(tmp_path / f"v{suffix}", [frame(1), frame(2), frame(4), frame(5)], [40, 80, 40, 40])
    decoded = []
    monkeypatch.setattr(Image.Image, "load", lambda image: decoded.append(image))
    assert video_seconds(path) == pytest.approx(0.2)
    assert frame_rate(path) == pytest.approx(25)
    assert decoded == []


def test_a_gif_of_comments_is_refused_before_they_are_read(tmp_path) -> None:
    """Pillow's time to read a comment grows with the square of its length."""
    path = save(tmp_path / "v.gif", [frame(1), frame(2)], 40)
    whole = path.read_bytes()
    start = whole.index(b"!")
    path.write_bytes(whole[:start] + b"!\xfe" + 10_000 * (b"\xff" + bytes(255)) + b"\0" + whole[start:])
    with pytest.raises(VideoError, match=r"v\.gif: comments and extensions of more than 1,000,000 bytes"):
        read(path)


@pytest.mark.parametrize(
    ("suffix", "place", "start", "block"),
    [
        (".gif", b"!", b"", b"!\xfe\0"),
        (".gif", b"!", b"", b"\0"),
        (".gif", b"!", b"," + bytes(10), b"\x01\0"),
        (".png", b"\0\0\0\x08acTL", b"", bytes(4) + b"tEXt" + bytes(4)),
        (".webp", b"ANIM", b"", b"ABCD" + bytes(4)),
    ],
    ids=["empty extensions", "bytes between", "blocks of an image", "PNG", "WebP"],
)
def test_blocks_of_animated_images_are_counted(tmp_path, suffix: str, place: bytes, start: bytes, block: bytes) -> None:
    path = save(tmp_path / f"v{suffix}", [frame(1), frame(2)], 40)
    whole = path.read_bytes()
    at = whole.index(place)
    path.write_bytes(whole[:at] + start + 1_000_001 * block + whole[at:])
    with pytest.raises(VideoError, match=rf"v\{suffix}: more than 1,000,000 blocks; convert it"):
        frame_rate(path)


def test_files_of_a_video_that_hold_more_than_their_header_says_are_limited(tmp_path, monkeypatch) -> None:
    write_video(tmp_path / "v.mp4", [frame(k) for k in range(N)])
    monkeypatch.setenv("NSDR_LIMITS", "video_pixels=1000000")
    with pytest.raises(VideoError, match=r"1,843,200 video_pixels, more than 1,000,000"):
        read(tmp_path / "v.mp4")
    monkeypatch.setattr(cv2, "VideoCapture", Headerless)
    with pytest.raises(VideoError, match=r"1,075,200 video_pixels, more than 1,000,000"):
        read(tmp_path / "v.mp4")


class Headerless:
    """A video whose header does not say how many frames it has. (A subclass of OpenCV's class would crash the process.)"""

    def __init__(self, *args: Any) -> None:
        self._video = VideoCapture(*args)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._video, name)

    def get(self, what: int) -> float:
        return 0.0 if what == cv2.CAP_PROP_FRAME_COUNT else self._video.get(what)


@pytest.mark.parametrize("function", [even_frames, lambda path: sample_frames(path, 100, 1), read_video])
def test_frames_that_are_kept_in_memory_are_limited(tmp_path, monkeypatch, function) -> None:
    path = save(tmp_path / "v.gif", [frame(k + 1, (48, 32)) for k in range(5)], 800)
    monkeypatch.setenv("NSDR_LIMITS", f"array_bytes={90 * 48 * 32 * 3}")
    with (
        pytest.raises(VideoError, match=r"v\.gif: .* array_bytes, more than"),
        warnings.catch_warnings(action="ignore"),
    ):
        function(path)


PLAYLIST = "#EXTM3U\n#EXT-X-VERSION:3\n#\x01\n#EXT-X-TARGETDURATION:6\n#EXTINF:5.12,\n{other}\n#EXT-X-ENDLIST\n"


@pytest.mark.parametrize(
    "text",
    [
        PLAYLIST,
        "ffconcat version 1.0\nfile {other}\n#\x01\n",
        "\0\0\0\x01" + PLAYLIST,
        PLAYLIST + "\0" * 9999,
        PLAYLIST.replace("#EXTM3U\n", "#EXTM3U\nAVI \n"),
        "v=0\nfree\nc=IN IP4 127.0.0.1\n#\x01\nm=video 5004 RTP/AVP 96\n",
    ],
    ids=["playlist", "script", "raw video", "long", "as AVI", "session as MP4"],
)
@pytest.mark.parametrize("name", ["v.mp4", "v.m3u8", "v.ffconcat", "v.ts"])
def test_files_that_name_other_files_are_no_videos(tmp_path, text: str, name: str) -> None:
    with av.open(str(tmp_path / "other.ts"), "w", format="mpegts") as container:
        stream = container.add_stream("libx264", rate=25)
        stream.width, stream.height, stream.pix_fmt = 480, 320, "yuv420p"
        for k in range(N):
            container.mux(stream.encode(av.VideoFrame.from_ndarray(frame(k), format="rgb24")))
        container.mux(stream.encode())
    (tmp_path / name).write_text(text.format(other=tmp_path / "other.ts"))
    for function in (read_video, video_seconds, even_frames, frame_rate):
        with pytest.raises(VideoError, match=rf"{name}: does not begin as an MP4"):
            function(tmp_path / name)
    assert len(read(tmp_path / "other.ts")[0]) == N


@pytest.mark.parametrize(
    ("suffix", "kind", "codec"),
    [
        (".mp4", "mp4", "libx264"),
        (".mov", "mov", "libx264"),
        (".mkv", "matroska", "libx264"),
        (".webm", "webm", "libvpx"),
        (".avi", "avi", "mpeg4"),
        (".ts", "mpegts", "libx264"),
        (".mpg", "mpeg", "mpeg2video"),
        (".flv", "flv", "flv"),
        (".wmv", "asf", "wmv2"),
        (".ivf", "ivf", "libvpx"),
        (".y4m", "yuv4mpegpipe", "rawvideo"),
    ],
)
def test_containers_that_are_read(tmp_path, suffix: str, kind: str, codec: str) -> None:
    path = tmp_path / f"v{suffix}"
    with av.open(str(path), "w", format=kind) as container:
        stream = container.add_stream(codec, rate=25)
        stream.width, stream.height, stream.pix_fmt = 480, 320, "yuv420p"
        for k in range(N):
            container.mux(stream.encode(av.VideoFrame.from_ndarray(frame(k), format="rgb24")))
        container.mux(stream.encode())
    assert len(read(path)[0]) == N


def test_images_are_limited_as_videos_are(tmp_path, monkeypatch) -> None:
    gif = save(tmp_path / "v.gif", [frame(k + 1) for k in range(N)], 40)
    folder = folder_of(tmp_path / "v", [f"{k}.png" for k in range(N)])
    for limit in ("frames=10", "image_pixels=1000", "video_pixels=1000000"):
        monkeypatch.setenv("NSDR_LIMITS", limit)
        for path in (gif, folder):
            with pytest.raises(VideoError, match=limit.split("=")[0]):
                read(path)


def test_a_folder_is_another_one_when_a_frame_changes(tmp_path) -> None:
    path = folder_of(tmp_path / "v", ["a1.png", "a2.png"])
    before = fingerprint(inputs=[path])
    assert fingerprint(inputs=[path]) == before
    cv2.imwrite(str(path / "a2.png"), frame(5))
    assert fingerprint(inputs=[path]) != before


def test_folders_are_searched_for_all_kinds(tmp_path) -> None:
    for name in ("b.mp4", "a.GIF", "c.webp", "d.txt", ".hidden.gif"):
        (tmp_path / name).write_bytes(b"x")
    assert [path.name for path in find_videos(tmp_path)] == ["a.GIF", "b.mp4", "c.webp"]


def test_how_late_frames_are_is_told(tmp_path) -> None:
    path, late = save(tmp_path / "v.webp", [frame(1 + 2.5 * k) for k in range(N)], 100), []
    read(path, late=late)
    slots = [0, 2, 5, 7, 10, 12]  # the nearest frame of CLEVRER
    assert [late[s] for s in slots] == pytest.approx([0, 0.5, 0, 0.5, 0, 0.5])


def test_an_empty_start_leaves_the_lateness_of_the_rest(tmp_path) -> None:
    images = [0 * frame(0), *(frame(1 + 2.5 * k) for k in range(1, N))]
    path, late = save(tmp_path / "v.webp", images, 100), []
    with warnings.catch_warnings(action="ignore"):
        frames = list(clip_frames(path, VideoConfig("warn"), late=late))
    assert times_of(frames)[0] == pytest.approx(3.5, abs=0.1)
    assert len(late) == len(frames)
    assert late[0] == pytest.approx(0.5)


def test_repeated_frames_of_another_size_are_processed_once(tmp_path, looked_at) -> None:
    path = save(tmp_path / "v.gif", [frame(1 + 2 * k, (240, 160)) for k in range(N)], 80)
    with warnings.catch_warnings(action="ignore"):
        found = FrameParser(build_frame_parser(FrameParserConfig())).parse(read_frames(path))
    assert found.processed.tolist() == list(range(0, 2 * N, 2))
    assert len(looked_at) == N


def sliding(n_frames: int, processed: np.ndarray, late: np.ndarray) -> VideoProposals:
    """A sphere that slides lawfully, as seen `late` frames after the processed ones."""
    place = -2.0 + slide(LAWS["sphere"], np.array(2.0), (processed + late) * CLEVRER_WORLD.physics.frame_seconds)[0]
    boxes, centres = [], []
    for y in place:
        polygon = outline("sphere", 0.0, float(y), camera=CLEVRER_CAMERA)
        low, high = polygon.min(0), polygon.max(0)
        boxes.append(np.round([*low, *high]).astype(int))
        centres.append((low + high) / 2)
    n = len(processed)
    words = np.full(n, CLEVRER.index("red", "metal", "sphere"))
    area = np.full(n, 900)
    return VideoProposals(
        n_frames, processed, words, np.ones(n), np.array(centres), area, np.array(boxes), None, processed
    )


def test_frames_are_judged_at_their_own_time() -> None:
    """24 frames a second: frames are up to half a frame late or early, and one is repeated each second."""
    taken = np.arange(100) * 25 / 24
    processed = np.ceil(taken - 0.5).astype(int)
    late = np.zeros(processed[-1] + 1)
    late[processed] = taken - processed
    proposals = sliding(len(late), processed, late[processed])
    assert judge(proposals).violations != ()
    assert judge(proposals, late=late).violations == ()


def test_what_shows_too_little_is_not_judged() -> None:
    def seen(frames: np.ndarray) -> VideoProposals:
        return sliding(128, frames, np.zeros(len(frames)))

    assert judge(seen(np.arange(0, 128, 3))).violations == ()
    with pytest.raises(
        VideoError, match=r"6\.25 frames a second are too few to judge; expected 8 or more, and a stride"
    ):
        judge(seen(np.arange(0, 128, 4)))
    with pytest.raises(VideoError, match=r"10 different frames are too few to judge; expected \d+ or more"):
        judge(seen(np.arange(10)))


def test_a_killed_run_goes_on_with_the_videos_that_are_left(tmp_path, monkeypatch, capsys) -> None:
    from nsdr.evaluation import batch

    paths = [save(tmp_path / f"{k}.gif", [frame(1), frame(2 + k)], 40) for k in range(3)]
    report, done = tmp_path / "report.json", []
    command = ["judge", *map(str, paths), "-o", str(report), "--workers", "1"]
    monkeypatch.setattr(batch, "worker_pipeline", lambda *_: None)

    def judged(_, video):
        done.append(video)
        if done == paths[:2]:
            raise KeyboardInterrupt
        return {"video": str(video), "error": f"{video}: no scene"}

    monkeypatch.setattr(batch, "judged", judged)
    assert main(command) == 130
    assert not report.exists()
    assert main(command) == 1
    assert done == [*paths[:2], *paths[1:]]
    assert [row["video"] for row in json.loads(report.read_text())] == [str(path) for path in paths]
    assert "3 of 3 videos failed, such as" in capsys.readouterr().err
    done.clear()
    save(paths[2], [frame(1), frame(9)], 40)
    assert main([*command, "--keep-going"]) == 0
    assert done == [paths[2]]


@pytest.mark.parametrize(
    "command",
    [
        ["answer", "ODD", "How many cubes are there?"],
        ["judge", "ODD"],
        ["parse", "ODD", "-o", "OUT.json"],
        ["parse", str(VIDEO), "-o", "ODD.json"],
        ["answer", str(VIDEO), "How many cubes are there?", "--background", "ODD"],
        ["evaluate", "--questions", "ODD", "--data", "."],
    ],
)  # fmt: skip
def test_a_name_that_is_not_utf8_is_refused_in_one_line(tmp_path, command: list[str], capsys) -> None:
    odd = os.fsdecode(bytes(tmp_path) + b"/s\xff.mp4")
    shutil.copy(VIDEO, odd)
    assert main([word.replace("ODD", odd).replace("OUT", str(tmp_path / "out")) for word in command]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("error: ")
    assert "s\\xff.mp4" in line
    assert "rename" in line


@pytest.mark.filterwarnings("default::UserWarning")
def test_a_folder_with_a_name_that_is_not_utf8_is_parsed_without_it(tmp_path, capsys) -> None:
    shutil.copy(VIDEO, tmp_path / "video_1.mp4")
    shutil.copy(VIDEO, os.fsdecode(bytes(tmp_path) + b"/video_\xff2.mp4"))
    assert main(["parse", str(tmp_path), "-o", str(tmp_path / "out"), "--workers", "1"]) == 0
    printed = capsys.readouterr()
    assert "1 done, 0 kept from before, 0 failed" in printed.out
    assert "video_\\xff2.mp4: left out" in printed.err


def test_videos_that_differ_in_their_ending_are_two(tmp_path) -> None:
    paths = [tmp_path / "v.mp4", save(tmp_path / "v.gif", [frame(1), frame(2)], 40)]
    paths[0].write_bytes(b"x")
    report = tmp_path / "report.json"
    assert main(["judge", *map(str, paths), "-o", str(report), "--workers", "1", "--keep-going"]) == 0
    assert [row["video"] for row in json.loads(report.read_text())] == [str(path) for path in paths]


def test_two_videos_of_one_name_are_not_one(tmp_path, capsys) -> None:
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "v.mp4").write_bytes(b"x")
    paths = [str(tmp_path / name / "v.mp4") for name in ("a", "b")]
    assert main(["judge", *paths, "-o", str(tmp_path / "report.json")]) == 2
    assert "both are v.mp4; rename one" in capsys.readouterr().err
    assert main(["judge", str(tmp_path / "a"), "-o", str(tmp_path / "a.json")]) == 2
    assert "give the report another name" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda frames: frames[:, 20:300, 30:450], "the background"),
        (lambda frames: frames[:, :, 90:390], r"0\.94:1, not 1\.5:1: taken as the middle of one"),
        (lambda frames: np.stack([cv2.GaussianBlur(f, (0, 0), 3) for f in frames]), "it is blurred"),
    ],
    ids=["zoomed", "cut off", "blurred"],
)
def test_videos_whose_places_or_words_are_wrong_are_not_judged(tmp_path, change, message: str) -> None:
    frames = list(islice(read_frames(VIDEO), 64))
    write_video(tmp_path / "v.mp4", change(np.stack(frames)), preset="veryfast")
    pipeline = Pipeline(None, None, None)  # what is not looked at needs no networks
    with pytest.raises(VideoError, match=rf"v\.mp4: cannot be judged: .*{message}.*--force judges it all the same"):
        pipeline.judge(tmp_path / "v.mp4")
