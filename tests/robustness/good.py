"""Small good inputs of every format, of one scene: 10000, in which a red cube hits a blue sphere at frame 40."""

import gzip
import json
import shutil
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from pycocotools import mask as rle

from nsdr.clevrer.example import TRUTH, VIDEO

SCENE, FRAMES, HORIZON = 10000, 128, 179
NAMES = (("red", "metal", "cube"), ("blue", "rubber", "sphere"), ("green", "rubber", "cylinder"))
WORDS = [dict(zip(("color", "material", "shape"), name, strict=True)) for name in NAMES]


def _motion(n_frames: int) -> list[dict[str, Any]]:
    still = [0.0, 0.0, 0.0]
    frames = []
    for f in range(n_frames):
        objects = []
        for i in range(3):
            x = [-1.5 + 0.03 * min(f, 40), 0.2 + 0.03 * max(f - 40, 0), 1.5][i]
            moving = f < 40 if i == 0 else i == 1 and f >= 40
            objects.append(
                {"object_id": i, "location": [x, 0.5 * i - 0.5, 0.2], "orientation": still}
                | {"velocity": [1.0 if moving else 0.0, 0.0, 0.0], "angular_velocity": still}
                | {"inside_camera_view": True}
            )
        frames.append({"frame_id": f, "objects": objects})
    return frames


def _collision(frame: int) -> dict[str, Any]:
    return {"object_ids": [0, 1], "frame_id": frame, "location": [0.0, 0.0, 0.2]}


def annotation(index: int = SCENE) -> dict[str, Any]:
    """`annotation_10000.json`, or that of another video."""
    objects = [{"object_id": i, **w} for i, w in enumerate(WORDS)]
    return {
        "scene_index": index, "video_filename": f"video_{index:05d}.mp4", "object_property": objects,
        "motion_trajectory": _motion(FRAMES), "collision": [_collision(40)],
    }  # fmt: skip


def truth() -> dict[str, Any]:
    """`truth_10000.json`."""
    return {
        "scene_index": SCENE, "seed": 1, "n_frames": FRAMES,
        "objects": [{"object_id": i, "mass": 1.0, **w} for i, w in enumerate(WORDS)],
        "frames": _motion(HORIZON), "collisions": [_collision(40)],
        "counterfactual": {"0": [], "1": [], "2": [_collision(40)]},
    }  # fmt: skip


def block() -> dict[str, Any]:
    """A `ground_truth` block."""
    return {
        "objects": [{"id": i, **w} for i, w in enumerate(WORDS)],
        "in_outs": [{"type": "in", "object": 2, "frame": 10}],
        "collisions": [{"type": "collision", "object": [0, 1], "frame": 40}],
    }


def blocks() -> list[dict[str, Any]]:
    """The list of a file of truth blocks."""
    return [{"video": SCENE, "n_frames": FRAMES, **block()}]


def proposals(index: int = SCENE) -> dict[str, Any]:
    """`proposal_10000.json`, or that of another video, with its `ground_truth` as in `sim_10000.json`."""
    frames = []
    for f in range(FRAMES):
        objects = []
        for i, words in enumerate(WORDS):
            mask = np.zeros((320, 480), np.uint8)
            left = 60 + 120 * i + f // 4
            cv2.rectangle(mask, (left, 150), (left + 30, 180), 1, -1)
            counts = rle.encode(np.asfortranarray(mask))["counts"].decode()
            row = {"mask": {"size": [320, 480], "counts": counts}, **words, "score": 0.99}
            objects.append(row | {"video_index": index, "frame_index": f})
        frames.append({"frame_index": f, "objects": objects})
    return {"video_index": index, "video_filename": f"video_{index:05d}.mp4", "frames": frames, "ground_truth": block()}


def predictions() -> dict[str, Any]:
    """`sim_10000.json` of a dynamics predictor."""
    trajectory = [
        {
            "frame_index": f,
            "objects": [{"x": 50.0, "y": 30.0 * (i + 1) + (f / 20 if i == 0 else 0), **w} for i, w in enumerate(WORDS)],
        }
        for f in range(0, 190, 5)
    ]
    collisions = [{"frame": 40, "objects": WORDS[:2]}]
    rows = [{"what_if": i, "trajectory": trajectory, "collisions": collisions if i < 0 else []} for i in range(-1, 3)]
    return {"objects": [{"id": i, **w} for i, w in enumerate(WORDS)], "predictions": rows}


RED = ["objects", "red", "filter_color", "unique"]
BLUE = ["objects", "blue", "filter_color", "unique"]


def questions(index: int = SCENE) -> list[dict[str, Any]]:
    """A question file: a descriptive question and a counterfactual one."""
    program = ["events", *RED, "filter_collision", *BLUE, "filter_collision", "unique"]
    choices = [{"choice_id": 0, "choice": "The red object collides with the blue object", "program": program,
                "answer": "wrong"}]  # fmt: skip
    rows = [
        {"question_id": 0, "question": "How many collisions happen?", "question_type": "descriptive",
         "question_subtype": "count", "program": ["events", "objects", "filter_collision", "count"], "answer": "1"},
        {"question_id": 1, "question": "What will happen without the green object?", "question_type": "counterfactual",
         "program": ["all_events", "objects", "green", "filter_color", "unique", "get_counterfact", "belong_to"],
         "choices": choices},
    ]  # fmt: skip
    return [{"scene_index": index, "video_filename": f"video_{index:05d}.mp4", "questions": rows}]


def manifest() -> dict[str, Any]:
    """`manifest.json` of a generated data set."""
    splits = {"train": [0, 0], "validation": [SCENE, SCENE + 1], "test": [15000, 15000]}
    return {"splits": splits, "kinds": ["videos", "annotations", "questions", "proposals"], "n_frames": FRAMES}


def data_set_manifest() -> dict[str, Any]:
    """`manifest.json` of the data set with videos and truth files."""
    config = {"seed": 0, "first_scene": 0, "render": {"width": 480, "height": 320}}
    return {**manifest(), "kinds": ["videos", "questions"], "config": config}


def submission() -> list[dict[str, Any]]:
    """An EvalAI submission."""
    choices = [{"choice_id": 0, "answer": "wrong"}]
    rows = [{"question_id": 0, "answer": "1"}, {"question_id": 1, "choices": choices}]
    return [{"scene_index": SCENE, "questions": rows}]


def json_line_answers() -> list[dict[str, Any]]:
    """The rows of a JSON Lines file of answers."""
    return [
        {"id": f"{SCENE}-0", "scene_index": SCENE, "question_id": 0, "response": "<answer>1</answer>"},
        {"id": f"{SCENE}-1", "scene_index": SCENE, "question_id": 1, "response": "<answer>none</answer>"},
    ]


def scene() -> dict[str, Any]:
    """A scene saved by `nsdr parse`."""
    return dict(json.loads(TRUTH.read_text()))


def write_good(folder: Path) -> None:
    """Write all good inputs: `questions.json`, `scene.json`, `video.mp4`, …, and a data set in the official layout."""
    for name, (file, document, _) in DOCUMENTS.items():
        path = folder / name.replace(" ", "_") / file
        path.parent.mkdir(parents=True, exist_ok=True)
        text = json.dumps(document()).encode()
        path.write_bytes(gzip.compress(text) if name == "blocks" else text)
    for file, document in {"questions/validation.json": questions, "derender_proposals/proposal_10000.json": proposals,
                           "annotations/validation/annotation_10000.json": annotation}.items():  # fmt: skip
        path = folder / "release" / file
        path.parent.mkdir(parents=True)
        path.write_text(json.dumps(document()))
    _write_data_set(folder / "dataset")
    (folder / "answers.jsonl").write_text("".join(f"{json.dumps(row)}\n" for row in json_line_answers()))
    shutil.copy(VIDEO, folder / "video.mp4")
    compact_proposals(folder / "proposals.npz")
    gray_video(folder / "gray.mp4")


def _write_data_set(folder: Path) -> None:
    """A generated data set of one video."""
    for file, document in {"manifest.json": data_set_manifest, "questions/validation.json": questions,
                           "truth/validation/truth_10000.json": truth}.items():  # fmt: skip
        path = folder / file
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(document()))
    video = folder / "videos/validation/video_10000.mp4"
    video.parent.mkdir(parents=True)
    gray_video(video, FRAMES)


def gray_video(path: Path, count: int = 12, size_px: tuple[int, int] = (480, 320), rate: float = 25.0) -> None:
    """Write a video in which nothing is to be seen."""
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), rate, size_px)
    for _ in range(count):
        writer.write(np.full((size_px[1], size_px[0], 3), 130, np.uint8))
    writer.release()


def compact_arrays() -> dict[str, np.ndarray]:
    """The arrays of compact proposals of the scene."""
    count = FRAMES * 3
    frame, i = np.divmod(np.arange(count), 3)
    left = 60 + 120 * i + frame // 4
    return {
        "video": np.full(count, SCENE, np.uint32), "frame": frame.astype(np.uint16),
        "attr": np.array([7, 15, 20], np.uint8)[i], "score": np.full(count, 255, np.uint8),
        "cx64": ((left + 15) * 64).astype(np.uint16), "cy64": np.full(count, 165 * 64, np.uint16),
        "area": np.full(count, 961, np.uint32),
        "box": np.stack([left, np.full(count, 150), left + 31, np.full(count, 181)], 1).astype(np.uint16),
    }  # fmt: skip


def compact_proposals(path: Path) -> None:
    """Write `compact_arrays`."""
    np.savez(path, **compact_arrays())  # type: ignore[arg-type]


QUESTIONS_OF = ("--questions", "{good}/questions/questions.json")
EVALUATE = ("evaluate", "--programs", "gold", "--workers", "1", "--cache", "cache", "--submission", "out.json")
COUNT = ("events objects filter_collision count",)
COMMANDS: dict[str, tuple[str, ...]] = {
    "questions": (*EVALUATE, "--questions", "questions.json", "--source", "truth", "--data", "{good}/truth"),
    "annotations": (*EVALUATE, *QUESTIONS_OF, "--source", "annotations", "--data", ".", "--types", "descriptive"),
    "truth": (*EVALUATE, *QUESTIONS_OF, "--source", "truth", "--data", "."),
    "truth for questions": ("generate", "questions", "--scenes", "truth_10000.json", "-o", "out.json"),
    "ground truth": (*EVALUATE, *QUESTIONS_OF, "--source", "ground-truth", "--data", ".", "--types", "descriptive"),
    "blocks": (*EVALUATE, *QUESTIONS_OF, "--source", "ground-truth", "--data", "truth.json.gz", "--types", "descriptive"),
    "proposals": (*EVALUATE, *QUESTIONS_OF, "--source", "proposals", "--data", ".", "--types", "descriptive"),
    "compact": (*EVALUATE, *QUESTIONS_OF, "--source", "proposals", "--data", "proposals.npz", "--types", "descriptive"),
    "predictions": ("program", *COUNT, "--semantics", "official", "--run", "sim_10000.json"),
    "scenes from predictions": (*EVALUATE, *QUESTIONS_OF, "--source", "predictions", "--data", "."),
    "scenes": ("program", *COUNT, "--run", "scene.json"),
    "scene questions": ("answer", "scene.json", "How many collisions happen?"),
    "manifest": (*EVALUATE, "--root", ".", "--source", "annotations", "--types", "descriptive"),
    "submission": ("score", "submission.json", *QUESTIONS_OF, "-o", "report.json"),
    "questions to tag": (*EVALUATE, "--questions", "questions.json", "--source", "truth", "--data", "{good}/truth",
                         "--tags-from", "{good}/truth"),
}  # fmt: skip
"""A command that reads each format, from the name in `DOCUMENTS`."""

ANSWER = ("answer", str(TRUTH), "How many collisions happen?")
EVALUATE_TRUTH = ("evaluate", *QUESTIONS_OF, "--source", "truth", "--data", "{good}/truth", "--programs", "gold",
            "--workers", "1", "--submission", "out.json")  # fmt: skip
PREDICT = ("parse", "{good}/release/derender_proposals", "-o", "out", "--workers", "1", "--form", "predictions")
PARSE = ("parse", "{good}", "-o", "out", "--workers", "1")
PARSE_ONE = ("parse", "{good}/video.mp4")
MOTION = ("data", "motion", "{good}/release", "--split", "validation", "-o", "out", "--workers", "1")
GENERATE = ("generate", "dataset", "-o", "out", "--videos", "1", "--renderer", "none", "--workers", "1")
TRAIN = ("train", "question-parser", "--run-dir", "run", "--loop.steps", "1", "--loop.device", "cpu")
SCORE = ("score", "{good}/answers.jsonl", *QUESTIONS_OF, "-o", "report.json")
EXPORT = ("export", "{good}/dataset", "--format", "chat", "-o", "out")
SIMULATE = ("simulate", "{good}/video.mp4", "--remove", "brown cylinder", "-o", "out.mp4", "-o", "out.json")
SERVE = ("serve", "{good}/dataset")
MCP = ("mcp", "{good}/dataset")
"""Commands that are right as they are."""
ROW = {"name": "x", "questions": "{good}/questions/questions.json", "source": "truth", "data": "{good}/truth",
       "programs": "gold", "cache": "cache"}  # fmt: skip
"""A row of an experiment."""
DOCUMENTS: dict[str, tuple[str, Any, str]] = {
    "questions": ("questions.json", questions, "list"),
    "annotations": ("annotation_10000.json", annotation, "object"),
    "truth": ("truth_10000.json", truth, "object"),
    "truth for questions": ("truth_10000.json", truth, "object"),
    "ground truth": ("sim_10000.json", proposals, "object"),
    "blocks": ("truth.json.gz", blocks, "list"),
    "proposals": ("proposal_10000.json", proposals, "object"),
    "predictions": ("sim_10000.json", predictions, "object"),
    "scenes from predictions": ("sim_10000.json", predictions, "object"),
    "scenes": ("scene.json", scene, "object"),
    "scene questions": ("scene.json", scene, "object"),
    "manifest": ("manifest.json", manifest, "object"),
    "submission": ("submission.json", submission, "list"),
    "questions to tag": ("questions.json", questions, "list"),
}
"""File name, good document and its type, of each format."""
