"""Videos at other frame rates, and strides: what is counted in frames follows the processed ones."""

import cv2
import numpy as np
import pytest

from nsdr import DataError, FrameParser, VideoProposals
from nsdr.clevrer.files.compact_proposals import read_compact_proposals
from nsdr.clevrer.files.proposals import proposals_document, proposals_from_rows, read_proposals
from nsdr.dynamics.motion_states import detections_in, states_from_tracks
from nsdr.dynamics.sliding import slide
from nsdr.dynamics.track_smoothing import smooth_tracks
from nsdr.frame_parser import FrameParserConfig, build_frame_parser
from nsdr.io.files import write_json
from nsdr.io.video import read_frames
from nsdr.tracking import TrackerConfig
from nsdr.tracking.localization import outline
from nsdr.tracking.speeds import speed_notes
from nsdr.tracking.tracker import track
from nsdr.types import SceneObject, Track, VideoTracks
from nsdr.world.vocabulary import CLEVRER
from nsdr.world.world import CLEVRER_WORLD

from .test_dynamics import LAWS

RED, BLUE, GREEN = (CLEVRER.index(c, "rubber", "sphere") for c in ("red", "blue", "green"))


def detections(frames, attribute: int, x0: float, speed: float, y: float = 0.0):
    """(frame, attribute, centroid, box) of a sphere that moves towards +y at `speed` world units per frame."""
    rows = []
    for f in frames:
        polygon = outline("sphere", x0, y + speed * f)
        low, high = polygon.min(0), polygon.max(0)
        rows.append((f, attribute, (low + high) / 2, np.round([*low, *high]).astype(int)))
    return rows


def proposals(rows, processed=None, n_frames: int = 128) -> VideoProposals:
    rows = sorted(rows, key=lambda r: r[0])
    frame, attribute, centroid, box = (np.array(column) for column in zip(*rows, strict=True))
    ones = np.ones(len(rows))
    return VideoProposals(n_frames, frame, attribute, ones, centroid, (900 * ones).astype(int), box, None, processed)


def every(stride: int, start: int = 0, stop: int = 128) -> np.ndarray:
    """What a frame parser with a stride processes of 128 frames, from `start` on and before `stop`."""
    frames = np.array(sorted({*range(0, 128, stride), 127}))
    return frames[(frames >= start) & (frames < stop)]


@pytest.mark.parametrize("stride", [1, 2, 4, 8, 12])
def test_a_stride_loses_no_object_that_is_long_in_view(stride: int) -> None:
    rows = detections(every(stride, stop=104), RED, -1.0, 0.03, -2.0) + detections(every(stride), BLUE, 1.0, 0.0)
    found = track(proposals(rows, every(stride)))
    assert bool(found.notes) == (stride > 8)
    assert [t.object.color for t in found.tracks] == ["blue", "red"]
    assert [len(t.frame_index) for t in found.tracks] == [len(every(stride)), len(every(stride, stop=104))]


def test_what_is_seen_once_is_no_object_at_any_stride() -> None:
    rows = detections(every(12), BLUE, 1.0, 0.0)
    rows += detections([60], GREEN, -1.0, 0.0)
    assert [t.object.color for t in track(proposals(rows, every(12))).tracks] == ["blue"]
    every_frame = detections(range(128), BLUE, 1.0, 0.0) + detections(range(0, 128, 13), GREEN, -1.0, 0.0)
    assert [t.object.color for t in track(proposals(every_frame)).tracks] == ["blue"]  # as noise at stride 1


def test_wrong_words_are_outvoted_at_any_stride() -> None:
    rows = detections(every(12), RED, 0.0, 0.03, -2.0)
    rows[4] = (rows[4][0], GREEN, *rows[4][2:])
    (found,) = track(proposals(rows, every(12))).tracks
    assert found.object.color == "red"
    assert len(found.frame_index) == len(every(12))


def test_frames_far_apart_are_noted() -> None:
    (note,) = track(proposals(detections(every(12), RED, 0.0, 0.0), every(12))).notes
    assert "one frame in 12" in note
    assert "stride" in note


def test_a_given_threshold_holds_without_a_stride() -> None:
    one = proposals(detections([5], RED, 0.0, 0.0))
    assert track(one).tracks == ()
    assert len(track(one, TrackerConfig(min_frames=0)).tracks) == 1


@pytest.mark.parametrize("stride", [1, 3, 12])
def test_speeds_are_fitted_at_any_stride(stride: int) -> None:
    frames = every(stride)
    distance = slide(LAWS["sphere"], np.array(1.2), frames * CLEVRER_WORLD.physics.frame_seconds)[0]
    location = np.stack([np.zeros(len(frames)), distance], 1)
    box = np.tile([200, 100, 230, 130], (len(frames), 1))
    centre = np.tile([215.0, 115.0], (len(frames), 1))
    sphere = SceneObject(0, "red", "metal", "sphere")
    states = states_from_tracks(VideoTracks(128, (Track(sphere, frames, location, centre, box, np.ones(len(frames))),)))
    assert states.spacing_frames == stride
    smoothed = smooth_tracks(states, [])
    true = slide(LAWS["sphere"], np.array(1.2), np.arange(128) * CLEVRER_WORLD.physics.frame_seconds)
    assert smoothed.location_world[0, :, 1] == pytest.approx(true[0], abs=1e-3)
    assert smoothed.velocity_world_per_s[0, :, 1] == pytest.approx(true[1], abs=1e-3)


def test_lines_beyond_a_track_follow_its_last_frames_at_any_stride() -> None:
    """The object turns a corner at frame 60 and is seen until frame 96."""
    for stride in (1, 12):
        frames = every(stride, stop=97)
        location = np.stack([0.02 * np.maximum(frames - 60, 0), 0.02 * np.minimum(frames, 60)], 1)
        box = np.tile([200, 100, 230, 130], (len(frames), 1))
        cube = SceneObject(0, "red", "metal", "cube")
        seen = Track(cube, frames, location, box[:, :2] + 15.0, box, np.ones(len(frames)))
        states = states_from_tracks(VideoTracks(128, (seen,)))
        assert states.location_world[0, 127] == pytest.approx([0.02 * 67, 1.2], abs=1e-6)


def test_detections_that_reach_over_frames() -> None:
    assert [detections_in(4, spacing) for spacing in (1, 2, 3, 12)] == [4, 3, 2, 2]


def draw(path, frames: int, rate: float) -> None:
    """A video whose white bar tells the time: it grows by 4 pixels each 25th of a second."""
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"mp4v"), rate, (480, 320))
    for f in range(frames):
        image = np.zeros((320, 480, 3), np.uint8)
        image[:, : round(4 * f * 25 / rate)] = 255
        writer.write(image)
    writer.release()


@pytest.mark.filterwarnings("ignore:.*frames per second, resampled", "ignore:.*CLEVRER's videos have 128")
@pytest.mark.parametrize("rate", [50.0, 30.0, 25.0, 15.0, 12.5, 10.0])
def test_frames_are_processed_at_their_own_time(tmp_path, looked_at, rate: float) -> None:
    draw(tmp_path / "v.mp4", round(4 * rate), rate)
    found = FrameParser(build_frame_parser(FrameParserConfig())).parse(read_frames(tmp_path / "v.mp4"))
    assert found.n_frames == 100
    processed = np.arange(100) if found.processed is None else found.processed
    assert len(processed) == len(looked_at) == min(round(4 * rate), 100)
    shown = np.array([(frame[160, :, 0] > 127).sum() / 4 for frame in looked_at])
    assert np.abs(shown - processed).max() < 0.7  # half a frame, and the codec's blur


def test_a_stride_skips_repeated_frames(looked_at) -> None:
    images = [np.full((320, 480, 3), k, np.uint8) for k in range(6)]
    parser = FrameParser(build_frame_parser(FrameParserConfig()), stride=3)
    found = parser.parse([image for image in images for _ in range(2)])
    assert found.n_frames == 12
    assert found.processed is not None
    assert found.processed.tolist() == [0, 4, 8, 10]
    assert [int(frame[0, 0, 0]) for frame in looked_at] == [0, 2, 4, 5]


@pytest.mark.parametrize(
    ("frames", "message"),
    [
        (
            np.zeros((2, 320, 480, 3)),
            r"frame 0: expected an image or an array \(height, width, 3\) of uint8.*got \(320, 480, 3\) float64",
        ),
        (np.zeros((2, 320, 480, 3), np.float32) + 0.5, "got .* float32"),
        (np.zeros((320, 480, 3), np.uint8), r"got \(480, 3\) uint8"),
        ([], "no frames to parse"),
    ],
)
def test_other_frames_are_refused(frames, message: str) -> None:
    with pytest.raises(DataError, match=message):
        FrameParser(build_frame_parser(FrameParserConfig())).parse(frames)


def test_files_keep_which_frames_were_processed(tmp_path) -> None:
    from pycocotools import mask as rle

    mask = np.zeros((320, 480), np.uint8, order="F")
    mask[100:130, 200:230] = 1
    counts = rle.encode(mask)["counts"].decode()
    for processed in ([0, 4, 8, 9], [0, 4, 8]):
        written = proposals_from_rows(10, [(f, RED, 0.9, counts) for f in processed], processed)
        write_json(tmp_path / "proposal_00000.json", proposals_document(written, "video_00000.mp4"))
        assert read_proposals(tmp_path / "proposal_00000.json") == written
    assert proposals_from_rows(3, [], [0, 1, 2]).processed is None


def test_one_longer_video_does_not_spoil_a_compact_file(tiny_motion, tmp_path) -> None:
    compact, _ = tiny_motion
    with np.load(compact) as stored:
        arrays = dict(stored)
    arrays["frame"] = arrays["frame"].copy()
    arrays["frame"][np.flatnonzero(arrays["video"] == 1)[-1]] = 130
    np.savez(tmp_path / "long.npz", **arrays)
    assert {video: p.n_frames for video, p in read_compact_proposals(tmp_path / "long.npz")} == {
        0: 128,
        1: 131,
        2: 128,
        3: 128,
    }


@pytest.mark.parametrize(("left_out", "is_too_fast"), [(1, False), (2, True), (4, True), (16, True)])
def test_frames_that_are_left_out_show_in_the_first_speeds(left_out: int, is_too_fast: bool) -> None:
    moving = detections(range(0, 128 // left_out), RED, -2.0, 0.075 * left_out if left_out < 16 else 0.5)
    found = track(proposals(moving, n_frames=128 // left_out), TrackerConfig(min_frames=0))
    assert bool(speed_notes(found)) == is_too_fast
    assert not is_too_fast or "--fps" in speed_notes(found)[0]
