"""Values of files and types that are out of range, unknown, repeated or contradictory are refused by name."""

import json
from contextlib import suppress
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from pycocotools import mask as rle

from nsdr import DataError, Event, Rollout, SceneObject, VideoError, VideoProposals
from nsdr.clevrer.example import QUESTIONS
from nsdr.clevrer.files.annotations import check_truth_blocks
from nsdr.clevrer.files.compact_proposals import read_compact_proposals
from nsdr.clevrer.files.masks import ObjectRuns, encoded_runs, numbers_of_runs, object_runs, runs_of_mask
from nsdr.clevrer.files.questions import read_questions
from nsdr.frame_parser.frame_files import read_frame_records
from nsdr.io.limits import VARIABLE
from nsdr.io.video import read_video, write_video
from nsdr.world.world import CLEVRER_WORLD
from tests.robustness import good

RED, BLUE = (
    {"color": "red", "material": "metal", "shape": "cube"},
    {"color": "blue", "material": "metal", "shape": "cube"},
)


def counts(mask: np.ndarray) -> str:
    return str(rle.encode(np.asfortranarray(mask.astype(np.uint8)))["counts"].decode())


def test_truth_blocks_of_irregular_videos_have_events_after_their_frames() -> None:
    block = {"video": 1, "n_frames": 3, **good.block(), "in_outs": []}
    late = {**block, "video": 7648, "collisions": [{"object": [0, 1], "frame": 116}]}
    assert check_truth_blocks([late], "b.json")[7648] is late
    with pytest.raises(DataError, match=r"b\.json: \[0\].*frame: .* got 116"):
        check_truth_blocks([{**late, "video": 1}], "b.json")


def test_question_files_end_after_their_list(tmp_path) -> None:
    (tmp_path / "q.json").write_text(QUESTIONS.read_text() + "[]")
    with pytest.raises(DataError, match=r"q\.json: .*trailing characters"):
        read_questions(tmp_path / "q.json")
    (tmp_path / "q.json").write_bytes(b"\xef\xbb\xbf" + QUESTIONS.read_bytes())
    assert read_questions(tmp_path / "q.json") == read_questions(QUESTIONS)


def test_compact_files_are_compared_with_the_lengths_of_their_videos(tmp_path) -> None:
    good.compact_proposals(tmp_path / "c.npz")
    assert [v for v, _ in read_compact_proposals(tmp_path / "c.npz", {good.SCENE: good.FRAMES})] == [good.SCENE]
    with pytest.raises(DataError, match=r"c\.npz: .*video 10000 has 3 frames, row 383 frame 127"):
        list(read_compact_proposals(tmp_path / "c.npz", {good.SCENE: 3}))


def test_masks_give_the_same_numbers_and_texts_from_runs_and_pixels() -> None:
    rng = np.random.default_rng(0)
    small = [rng.random((7, 5)) < share for share in (0.1, 0.5, 0, 0.9, 1)]
    large = [cv2.circle(np.zeros((320, 480), np.uint8), (x, 300), 30, 1, -1) for x in (0, 200, 479)]
    for masks in (small, large, [np.zeros((7, 5))], []):
        height, width = masks[0].shape if masks else (7, 5)
        texts = [counts(mask) for mask in masks]
        lengths = [runs_of_mask(text, height, width, "x") for text in texts]
        assert [of_mask.sum() for of_mask in lengths] == [height * width] * len(masks)
        runs = object_runs(lengths)
        assert encoded_runs(runs, len(masks), height, width) == texts
        by_column = [np.flatnonzero(np.diff(np.pad(mask, 1).T.ravel())) for mask in masks]  # column by column, unjoined
        places = [(p // (height + 2) - 1) * height + p % (height + 2) for p in by_column]
        index = np.repeat(np.arange(len(masks)), [len(p) // 2 for p in places])
        split = np.concatenate([np.zeros(0, np.int64), *places]).reshape(-1, 2).T
        assert encoded_runs(ObjectRuns(index, *split), len(masks), height, width) == texts
        seen = np.unique(runs.mask)
        for of in (runs, ObjectRuns(index, *split)):
            numbers = numbers_of_runs(of._replace(mask=np.searchsorted(seen, of.mask)), height)
            for i, centroid, area, box in zip(seen, *numbers, strict=True):
                rows, columns = np.nonzero(masks[i])
                assert area == len(rows)
                assert centroid.tolist() == [columns.mean() + 0.5, rows.mean() + 0.5]
                assert box.tolist() == [columns.min(), rows.min(), columns.max() + 1, rows.max() + 1]


@settings(max_examples=300, deadline=None)
@given(text=st.text(st.characters(min_codepoint=40, max_codepoint=130), max_size=12))
def test_any_text_is_a_mask_or_an_error(text) -> None:
    with suppress(DataError):
        runs = runs_of_mask(text, 4, 3, "x")
        assert runs.sum() == 12
        assert rle.decode({"size": [4, 3], "counts": text.encode()}).shape == (4, 3)


def test_types_refuse_values_out_of_range() -> None:
    ints, floats = np.zeros(1, int), np.zeros(1)
    box, centre = np.zeros((1, 4), int), np.zeros((1, 2))
    for score, place, message in (
        (2.0, 0.0, "score: expected 0 to 1, got 2.0"),
        (1.0, np.nan, "centroid_px: expected finite"),
    ):
        with pytest.raises(DataError, match=message):
            VideoProposals(1, ints, ints, floats + score, centre + place, ints, box)
    with pytest.raises(DataError, match="processed: expected frames from 0 to 0, got 5 to 5"):
        VideoProposals(1, ints, ints, floats, centre, ints, box, processed=np.array([5]))
    with pytest.raises(DataError, match=r"SceneObject: .*id"):
        SceneObject("0", "red", "metal", "cube")  # type: ignore[arg-type]
    with pytest.raises(DataError, match=r"frame"):
        Event("in", 1.5, (0,))  # type: ignore[arg-type]
    where, seen = np.full((1, 2, 2), np.nan), np.zeros((1, 2), bool)
    Rollout(where, seen, ())  # NaN is where an object is absent
    with pytest.raises(DataError, match="location_world: expected finite numbers, got inf"):
        Rollout(np.full_like(where, np.inf), seen, ())
    with pytest.raises(DataError, match="predicted_scores: expected 0 to 1, got nan"):
        Rollout(where, seen, (), np.array([[np.nan]]))


def test_videos_that_are_too_long_large_or_slow(tmp_path, monkeypatch) -> None:
    path = tmp_path / "v.mp4"
    write_video(path, [np.zeros((320, 480, 3), np.uint8)] * 6)
    for limit, message in (
        ("frames=5", "6 frames, more than 5"),
        ("image_pixels=1000", "153,600 image_pixels, more than 1,000"),
        ("array_bytes=1000000", "array_bytes, more than 1,000,000"),
    ):
        monkeypatch.setenv(VARIABLE, limit)
        with pytest.raises(VideoError, match=rf"v\.mp4: .*{message}"):
            read_video(path)
    monkeypatch.delenv(VARIABLE)
    writer = cv2.VideoWriter(str(tmp_path / "slow.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 0.1, (480, 320))
    for _ in range(3):
        writer.write(np.zeros((320, 480, 3), np.uint8))
    writer.release()
    with pytest.raises(VideoError, match=r"slow\.avi: 0.1 frames per second, expected 1 to 1000"):
        read_video(tmp_path / "slow.avi")


def frame_line(**changes: Any) -> dict[str, Any]:
    mask = np.zeros((4, 6), np.uint8)
    mask[1:3, 1:4] = 1
    o = {**RED, "segmentation": {"size": [4, 6], "counts": counts(mask)}}
    return {"file_name": "a.jpg", "scene": 1, "objects": [o], **changes}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"file_name": "../../a.jpg"}, "file_name: expected a file below images/"),
        ({"file_name": "/a.jpg"}, "file_name: expected a file below images/"),
        ({"scene": -1}, "scene`"),
        ({"objects": [{**RED, "segmentation": {"size": [10**6, 10**6], "counts": "1"}}]}, "image_pixels, more than"),
        ({"objects": [{**RED, "segmentation": {"size": [4, 6], "counts": "11"}}]}, "expected runs of the image's 4x6"),
        ({"objects": [{**RED, "segmentation": {"size": [4, 6], "counts": 5}}]}, "counts`"),
    ],
)
def test_bad_frame_records(changes, message, tmp_path) -> None:
    path = tmp_path / "annotations_0.jsonl"
    path.write_text(json.dumps(frame_line()) + "\n")
    assert [r["scene"] for r in read_frame_records(tmp_path, CLEVRER_WORLD.vocabulary.words)] == [1]
    path.write_text(json.dumps(frame_line()) + "\n" + json.dumps(frame_line(**changes)) + "\n")
    with pytest.raises(DataError, match=rf"annotations_0\.jsonl, line 2.*{message}"):
        list(read_frame_records(tmp_path, CLEVRER_WORLD.vocabulary.words))
