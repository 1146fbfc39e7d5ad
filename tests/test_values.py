"""Values of files and types that are out of range, unknown, repeated or contradictory are refused by name."""

import copy
import json
from contextlib import suppress
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings, strategies as st
from pycocotools import mask as rle

from nsdr import DataError, Event, Rollout, Scene, SceneObject, VideoError, VideoProposals, load
from nsdr.clevrer.answers.answer_files import read_submission
from nsdr.clevrer.dataset import CLEVRER
from nsdr.clevrer.example import QUESTIONS, TRUTH
from nsdr.clevrer.files.annotations import check_truth, check_truth_blocks
from nsdr.clevrer.files.compact_proposals import read_compact_proposals
from nsdr.clevrer.files.masks import ObjectRuns, encoded_runs, numbers_of_runs, object_runs, runs_of_mask
from nsdr.clevrer.files.predictions import PredictionFile
from nsdr.clevrer.files.proposals import ground_truth_of, parse_proposals
from nsdr.clevrer.files.questions import read_questions
from nsdr.frame_parser.frame_files import read_frame_records
from nsdr.io.limits import VARIABLE
from nsdr.io.video import read_video, write_video
from nsdr.validation import convert

RED, BLUE = (
    {"color": "red", "material": "metal", "shape": "cube"},
    {"color": "blue", "material": "metal", "shape": "cube"},
)


def counts(mask: np.ndarray) -> str:
    return str(rle.encode(np.asfortranarray(mask.astype(np.uint8)))["counts"].decode())


def proposals() -> dict[str, Any]:
    mask = np.zeros((320, 480), np.uint8)
    mask[10:20, 30:50] = 1
    row = {"mask": {"size": [320, 480], "counts": counts(mask)}, **RED, "score": 0.9}
    frames = [{"frame_index": f, "objects": [copy.deepcopy(row)]} for f in range(3)]
    truth = {"objects": [{"id": 0, **RED}, {"id": 1, **BLUE}], "in_outs": [], "collisions": []}
    return {"frames": frames, "ground_truth": truth}


def truth() -> dict[str, Any]:
    row = {key: [0, 0, 0] for key in ("location", "orientation", "velocity", "angular_velocity")}
    rows = [{"object_id": i, "inside_camera_view": True, **row} for i in (0, 1)]
    hit = {"object_ids": [0, 1], "frame_id": 40}
    objects = [{"object_id": 0, **RED}, {"object_id": 1, **BLUE}]
    frames = [{"frame_id": f, "objects": copy.deepcopy(rows)} for f in range(128)]
    what_if = {"0": [], "1": []}
    return {
        "scene_index": 0,
        "seed": 0,
        "objects": objects,
        "frames": frames,
        "collisions": [hit],
        "counterfactual": what_if,
    }


def predictions() -> dict[str, Any]:
    samples = [{"frame_index": f, "objects": [{"x": 1.0, "y": 2, **RED}, {"x": 1.0, "y": 2, **BLUE}]} for f in (0, 5)]
    hits = [{"frame": 5, "objects": [RED, BLUE]}]
    rows = [{"what_if": i, "trajectory": copy.deepcopy(samples), "collisions": hits} for i in (-1, 0, 1)]
    return copy.deepcopy({"objects": [{"id": 0, **RED}, {"id": 1, **BLUE}], "predictions": rows})


def question_file() -> list[dict[str, Any]]:
    return list(json.loads(QUESTIONS.read_text()))


def test_the_good_documents_are_accepted() -> None:
    assert parse_proposals(json.dumps(proposals()).encode(), "p").n_frames == 3
    assert ground_truth_of(proposals(), "p")["collisions"] == []
    check_truth(truth())
    convert(predictions(), PredictionFile)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d: d.update(frames=[]), "frames: expected at least 1, got none"),
        (lambda d: d["frames"][2].update(frame_index=100_000), "expected a frame from 0 to 9999, got 100000"),
        (lambda d: d["frames"][0].update(frame_index=-1), "frame_index: expected 0, as frames are numbered from 0, got -1"),
        (lambda d: d.update(n_frames=10**9), r"n_frames: expected 3 to 10000, got 1000000000"),
        (lambda d: d.update(n_frames=2), "n_frames: expected 3 to 10000, got 2"),
        (lambda d: d["frames"][0]["objects"].extend(d["frames"][0]["objects"] * 240), "241 frame_objects, more than 100"),
        (lambda d: d["frames"][1]["objects"][0].update(score=2), "score`"),
        (lambda d: d["frames"][1]["objects"][0].update(score=10**400), "score`"),
        (lambda d: d["frames"][1]["objects"][0]["mask"].update(size=[10**6, 10**6]), r"size: expected \[320, 480\]"),
        (lambda d: d["frames"][1]["objects"][0]["mask"].update(counts="zebra"), "counts: expected .*run"),
        (lambda d: d["frames"][1]["objects"][0]["mask"].update(counts=""), "counts: expected COCO run lengths"),
        (lambda d: d["frames"][1]["objects"][0]["mask"].update(counts="\u00e9"), "counts: expected COCO run lengths"),
        (lambda d: d["frames"][1]["objects"][0]["mask"].update(counts="oooo1"), "counts: expected runs of the image"),
        (lambda d: d["frames"][1]["objects"][0]["mask"].update(counts="oooooooooo1"), "found a larger number"),
    ],
)  # fmt: skip
def test_bad_proposals(change, message) -> None:
    document = proposals()
    change(document)
    with pytest.raises(DataError, match=f"p.json.*{message}"):
        parse_proposals(json.dumps(document).encode(), "p.json")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda b: b.update(objects=[]), "objects: expected at least 1 object"),
        (lambda b: b.update(collisions=[{"object": [0, 1], "frame": 3}]), "frame: expected a frame from 0 to 2, got 3"),
        (lambda b: b.update(collisions=[{"object": [0, 7], "frame": 1}]), "expected object ids from 0 to 1, got 7"),
        (lambda b: b.update(in_outs=[{"object": 0, "frame": 1, "type": "in"}] * 2), "is there twice"),
    ],
)
def test_bad_ground_truth(change, message) -> None:
    document = proposals()
    change(document["ground_truth"])
    with pytest.raises(DataError, match=message):
        ground_truth_of(document, "p.json")
    rows = [{"video": 1, "n_frames": 3, **document["ground_truth"]}]
    with pytest.raises(DataError, match=rf"b\.json: \[0\].*{message}"):
        check_truth_blocks(rows, "b.json")


def test_bad_lists_of_truth_blocks() -> None:
    block = {"video": 1, "n_frames": 3, **proposals()["ground_truth"]}
    for rows, message in (
        ([], "at least one block"),
        ([block, block], r"\[1\]\.video: 1 is there twice"),
        ([{**block, "n_frames": 0}], "n_frames`"),
        ([{**block, "video": -1}], "video`"),
    ):
        with pytest.raises(DataError, match=message):
            check_truth_blocks(rows, "b.json")
    # The released block of this video has 115 frames, and events after them.
    late = {**block, "video": 7648, "collisions": [{"object": [0, 1], "frame": 116}]}
    assert check_truth_blocks([late], "b.json")[7648] is late


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d: d["frames"].pop(), "n_frames: expected at most 127, the number of frames, got 128"),
        (lambda d: d.update(n_frames=129), "n_frames: expected at most 128, the number of frames, got 129"),
        (lambda d: d["frames"][5]["objects"].pop(), r"frames\[5\]\.objects: expected object_id 0 to 1, each once, got \[0\]"),
        (lambda d: d["frames"][5]["objects"][1].update(object_id=0), r"frames\[5\]\.objects: .*each once, got \[0, 0\]"),
        (lambda d: d["frames"][5]["objects"][1].update(velocity=[1e300, 0, 0]), r"velocity\[0\]`"),
        (lambda d: d["frames"][5]["objects"][1].update(velocity=[True, 0, 0]), r"velocity"),
        (lambda d: d["counterfactual"].update({"9": []}), "counterfactual.9: expected an object id from 0 to 1"),
        (lambda d: d["counterfactual"].update({"0": d["collisions"]}), "expected no collision of the removed object 0"),
        (lambda d: d["collisions"][0].update(frame_id=128), "frame_id: expected a frame from 0 to 127, got 128"),
    ],
)  # fmt: skip
def test_bad_truth_files(change, message) -> None:
    document = truth()
    change(document)
    with pytest.raises(DataError, match=message):
        check_truth(document)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d: d.update(predictions=[]), "predictions: expected at least 1"),
        (lambda d: d["objects"].append({"id": 2, **RED}), "red metal cube is there twice"),
        (lambda d: d["predictions"][2].update(what_if=0), r"predictions\[2\]\.what_if: 0 is there twice"),
        (lambda d: d["predictions"][0]["trajectory"].reverse(), r"trajectory\[1\]\.frame_index: expected more than 5"),
        (lambda d: d["predictions"][0]["trajectory"][1].update(frame_index=10**9), "expected a frame from 0 to 9999"),
        (lambda d: d["predictions"][0]["trajectory"][0]["objects"][0].update(x=1e300), "x`"),
        (lambda d: d["predictions"][0]["trajectory"][0]["objects"][0].update(BLUE), "blue metal cube is there twice"),
        (lambda d: d["predictions"][0]["collisions"][0].update(objects=[RED, RED]), "expected two different objects"),
        (lambda d: d["predictions"][0]["collisions"][0].update(frame=-1), "frame: expected a frame from 0"),
    ],
)  # fmt: skip
def test_bad_predictions(change, message) -> None:
    document = predictions()
    change(document)
    with pytest.raises(DataError, match=message):
        convert(document, PredictionFile)


def first(kind: str, d: Any) -> Any:
    return next(q for q in d[0]["questions"] if ("choices" in q) == (kind == "choices"))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d: d.append(d[0]), r"\[1\]\.scene_index: 500002 is there twice"),
        (lambda d: d.clear(), "holds no scenes"),
        (lambda d: d[0].update(questions=[]), "its 1 scenes have none"),
        (lambda d: d[0]["questions"].append(d[0]["questions"][0]), "question_id: .* is there twice"),
        (lambda d: first("choices", d)["choices"].append(first("choices", d)["choices"][0]), "choice_id: 0 is there twice"),
        (lambda d: first("choices", d)["choices"][0].update(answer=None), "choices: expected answers of all or none"),
        (lambda d: first("choices", d)["choices"][0].update(answer="yes"), "answer`"),
        (lambda d: first("", d).update(answer="17"), "answer: expected 0 to 15, yes, no or an attribute word, got '17'"),
        (lambda d: first("", d).update(answer=["yes"]), "answer`"),
        (lambda d: first("", d).update(program="count"), "program`"),
        (lambda d: first("", d).update(program=[]), "program`"),
        (lambda d: first("", d).update(program=["events"] * 100_000), r"questions\[0\]\.program: 100,000 program_tokens"),
        (lambda d: first("", d).update(question="a " * 100_000), "200,000 text_characters"),
        (lambda d: first("", d).update(question="How many\x00 cubes?"), "question: expected a line of text"),
        (lambda d: first("", d).update(question=" "), "question: expected a line of text"),
        (lambda d: d[0].update(video_filename="../../etc/passwd"), "video_filename`"),
        (lambda d: d[0].update(scene_index=-1), "scene_index`"),
    ],
)  # fmt: skip
def test_bad_questions(change, message, tmp_path) -> None:
    content = question_file()
    change(content)
    path = tmp_path / "q.json"
    path.write_text(json.dumps(content))
    with pytest.raises(DataError, match=rf"q\.json: .*{message}"):
        read_questions(path)


def test_question_files_end_after_their_list(tmp_path) -> None:
    (tmp_path / "q.json").write_text(QUESTIONS.read_text() + "[]")
    with pytest.raises(DataError, match=r"q\.json: .*trailing characters"):
        read_questions(tmp_path / "q.json")
    (tmp_path / "q.json").write_bytes(b"\xef\xbb\xbf" + QUESTIONS.read_bytes())
    assert read_questions(tmp_path / "q.json") == read_questions(QUESTIONS)


def test_bad_submissions(tmp_path) -> None:
    path = tmp_path / "x.json"
    row = {"question_id": 0, "answer": "yes"}
    for content, message in (
        ([{"scene_index": 1, "questions": [row, row]}], r"questions\[1\]\.question_id: 0 is there twice"),
        ([{"scene_index": 1, "questions": [row]}] * 2, r"\[1\]\.scene_index: 1 is there twice"),
    ):
        path.write_text(json.dumps(content))
        with pytest.raises(DataError, match=rf"x\.json: .*{message}"):
            read_submission(path)


COMPACT = {"video": [1, 1], "frame": [0, 1], "attr": [3, 3], "score": [255, 255], "cx64": [64, 64], "cy64": [64, 64],
           "area": [9, 9], "box": [[0, 0, 3, 3]] * 2}  # fmt: skip


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"frame": [1, 0]}, "row 1: expected ascending videos and frames, got video 1, frame 0 after"),
        ({"frame": [0, 20_000]}, "frame: 20,001 frames, more than 10,000"),
        ({"frame": [0, 5]}, "video 1 has 3 frames, row 1 frame 5"),
        ({"attr": [48, 0]}, "attr: expected 0 to 47"),
        ({"score": [-1, 0]}, "score: expected 0 to 255"),
        ({"score": [0.5, 0.5]}, "score: expected dtype kind"),
        ({"area": [9, 0]}, "area: expected 1 to 153600, got 0"),
        ({"area": [9]}, "area: expected the shape"),
        ({"box": [[0, 0, 3, 3], [3, 0, 3, 3]]}, r"box: row 1: expected left < right.*got \[3, 0, 3, 3\]"),
        ({"box": [[0, 0, 3, 321]] * 2}, "bottom up to 320"),
        ({name: [] for name in COMPACT}, "expected at least 1 row"),
    ],
)
def test_bad_compact_files(changes, message, tmp_path) -> None:
    np.savez(tmp_path / "good.npz", **COMPACT)
    assert [v for v, _ in read_compact_proposals(tmp_path / "good.npz", {1: 3})] == [1]
    np.savez(tmp_path / "c.npz", **{**COMPACT, **changes})
    with pytest.raises(DataError, match=rf"c\.npz: .*{message}"):
        list(read_compact_proposals(tmp_path / "c.npz", {1: 3}))


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


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_changed_values_never_crash_a_reader(data, tmp_path) -> None:
    values = st.one_of(
        st.none(), st.booleans(), st.integers(), st.floats(allow_nan=False), st.text(max_size=5), st.just([]), st.just({})
    )  # fmt: skip
    readers = {
        "questions": (question_file, lambda d, p: (p.write_text(json.dumps(d)), read_questions(p))),
        "proposals": (proposals, lambda d, _: (parse_proposals(json.dumps(d).encode(), "p"), ground_truth_of(d, "p"))),
        "truth": (truth, lambda d, _: check_truth(d)),
        "predictions": (predictions, lambda d, _: convert(d, PredictionFile)),
        "scene": (
            lambda: json.loads(TRUTH.read_text()),
            lambda d, p: (p.write_text(json.dumps(d)), load(Scene, p)),
        ),
    }
    make, read = readers[data.draw(st.sampled_from(sorted(readers)))]
    document = make()
    for _ in range(data.draw(st.integers(1, 2))):
        place = document
        while True:
            keys = sorted(place) if isinstance(place, dict) else list(range(len(place)))
            if not keys:
                break
            key = data.draw(st.sampled_from(keys))
            if isinstance(place[key], dict | list) and place[key] and data.draw(st.integers(0, 4)):
                place = place[key]
                continue
            place[key] = data.draw(values)
            break
    with suppress(DataError):
        read(document, tmp_path / "x.json")


def scene_document() -> dict[str, Any]:
    return dict(json.loads(TRUTH.read_text()))


def uncertain(probability: object = 0.5, removed: object = None, frame: int = 30) -> dict[str, Any]:
    event = {"type": "Event", "kind": "collision", "frame": frame, "objects": [0, 1]}
    return {"type": "UncertainCollision", "event": event, "probability": probability, "removed": removed}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d: d.update(objects=5), "objects`"),
        (lambda d: d.update(zebra=5), "not a Scene: got an unexpected keyword argument 'zebra'"),
        (lambda d: d.pop("events"), "not a Scene: missing a required argument: 'events'"),
        (lambda d: d.update(n_frames=500), r"Scene: visible: expected the shape \(6, 500\)"),
        (lambda d: d.update(n_frames=True), "n_frames`"),
        (lambda d: d["events"][0].update(frame=1.5), r"events\[0\]: .*Event: .*frame`"),
        (lambda d: d["events"][0].update(frame=9999), "expected frames from 0 to 127, got Event"),
        (lambda d: d["events"][0].update(frame=-1), "expected objects from 0 to 5 at a frame"),
        (lambda d: d["events"][0].update(objects=[0, 99]), "expected objects from 0 to 5 at a frame"),
        (lambda d: d["events"].append(7), r"events\[7\]`"),
        (lambda d: d["unseen"][0].update(frame=10**12), r"unseen\[0\]\.frame: 1(,000){4}"),
        (lambda d: d["counterfactual"].update(map={}), "counterfactual.map: "),
        (lambda d: d["counterfactual"]["map"].append([99, []]), "counterfactual: expected object ids from 0 to 5 as keys"),
        (lambda d: d.update(uncertain=[uncertain(probability=1.5)]), "probability`"),
        (lambda d: d.update(uncertain=[uncertain(probability="a")]), r"probability`"),
        (lambda d: d.update(uncertain=[uncertain(removed=9)]), "Scene.uncertain: expected removed objects from 0 to 5, got 9"),
        (lambda d: d.update(uncertain=[uncertain(frame=10**12)]), r"uncertain\[0\]\.event\.frame: 1(,000){4}"),
        (lambda d: d["visible"].update(dtype="object"), r"visible: .*dtype`"),
        (lambda d: d["visible"].update(shape=[10**6, 10**6]), "visible: expected 1000000000000 values"),
        (lambda d: d["visible"].update(shape=[-1, 128]), r"visible: .*shape\[0\]`"),
        (lambda d: d["visible"].update(values="x" * 768), r"visible\.values: expected a text of 0 and 1"),
    ],
)  # fmt: skip
def test_bad_saved_scenes(change, message, tmp_path) -> None:
    document = scene_document()
    change(document)
    (tmp_path / "s.json").write_text(json.dumps(document))
    with pytest.raises(DataError, match=rf"s\.json: not a Scene \(.*{message}"):
        load(Scene, tmp_path / "s.json")


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
    with pytest.raises(DataError, match=r"SceneObject: .*id`"):
        SceneObject("0", "red", "metal", "cube")  # type: ignore[arg-type]
    with pytest.raises(DataError, match=r"frame`"):
        Event("in", 1.5, (0,))  # type: ignore[arg-type]
    where, seen = np.full((1, 2, 2), np.nan), np.zeros((1, 2), bool)
    Rollout(where, seen, ())  # NaN is where an object is absent
    with pytest.raises(DataError, match="location_world: expected finite numbers, got inf"):
        Rollout(np.full_like(where, np.inf), seen, ())
    with pytest.raises(DataError, match="unseen_scores: expected 0 to 1, got nan"):
        Rollout(where, seen, (), np.array([[np.nan]]))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"splits": {"train": [0, 10**12]}}, "splits.train: expected first and last"),
        ({"splits": {"train": [5, 3]}}, "splits.train: expected first and last"),
        ({"splits": {"train": [-5, 3]}}, "splits.train: expected first and last"),
        ({"kinds": ["zebra"]}, "kinds"),
        ({"kinds": [5]}, "kinds"),
        ({"n_frames": 10**9}, "n_frames: (expected a whole number from 1|.* more than 10,000)"),
    ],
)
def test_bad_manifests(changes, message, tmp_path) -> None:
    splits = {"train": [0, 2], "validation": [10000, 10000], "test": [15000, 15000]}
    manifest = {"splits": splits, "kinds": ["videos"], "n_frames": 128}
    for key, value in changes.items():
        manifest[key] = {**manifest[key], **value} if isinstance(value, dict) else value  # type: ignore[dict-item]
    (tmp_path / "manifest.json").write_text(json.dumps(manifest))
    with pytest.raises(DataError, match=rf"manifest\.json.*{message}"):
        CLEVRER(tmp_path)


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
    assert [r["scene"] for r in read_frame_records(tmp_path)] == [1]
    path.write_text(json.dumps(frame_line()) + "\n" + json.dumps(frame_line(**changes)) + "\n")
    with pytest.raises(DataError, match=rf"annotations_0\.jsonl, line 2.*{message}"):
        list(read_frame_records(tmp_path))
