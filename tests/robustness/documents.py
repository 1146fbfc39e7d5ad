"""Bad JSON documents of every format: each field removed or wrong, and what contradicts itself."""

import copy
from collections.abc import Callable, Iterator
from functools import lru_cache
from pathlib import Path
from typing import Any

from tests.robustness.case import (
    Case,
    Change,
    Field,
    Write,
    dumped,
    field_cases,
    repeated,
    replaced,
    text_writer,
)
from tests.robustness.good import COMMANDS, DOCUMENTS


def _fields(*rows: str) -> list[Field]:
    """From lines such as "objects.0.color: word"; a ? after the kind marks an optional field."""
    found = []
    for row in rows:
        path, kind = row.split(": ")
        keys = tuple(int(k) if k.isdigit() else k.strip("'") for k in path.split("."))
        found.append(Field(keys, kind.rstrip("?"), kind.endswith("?")))
    return found


def _named(prefix: str, key: str) -> list[str]:
    return [f"{prefix}.{key}: object id", *(f"{prefix}.{name}: word" for name in ("color", "material", "shape"))]


OF_ONE_QUESTION = ("unknown token", "program underflow", "row missing")
"""Changes that are found when the question is answered, by its scene and number."""


def _block(prefix: str) -> list[str]:
    rows = ["objects: list", *_named("objects.1", "id"), "in_outs: list", "in_outs.0.type: word",
            "in_outs.0.object: object id", "in_outs.0.frame: frame", "collisions: list", "collisions.0.object: pair",
            "collisions.0.frame: frame"]  # fmt: skip
    return [prefix + row for row in rows]


TRUTH = ["objects: list", *_named("objects.1", "object_id"), "frames: list", "frames.5.objects: list",
         "frames.5.objects.1.object_id: object id", "frames.5.objects.1.velocity: vector",
         "frames.5.objects.1.inside_camera_view: boolean", "collisions: list", "collisions.0.object_ids: pair",
         "collisions.0.frame_id: frame", "counterfactual: object", "counterfactual.'2': list?",
         "counterfactual.'2'.0.object_ids: pair", "counterfactual.'2'.0.frame_id: frame", "n_frames: count?"]  # fmt: skip
PREDICTIONS = ["objects: list", *_named("objects.1", "id"), "predictions: list", "predictions.1.what_if: object id",
               "predictions.0.trajectory: list", "predictions.0.trajectory.2.frame_index: frame",
               "predictions.0.trajectory.2.objects: list", "predictions.0.trajectory.2.objects.0.x: number",
               "predictions.0.trajectory.2.objects.0.y: number", "predictions.0.trajectory.2.objects.0.color: word",
               "predictions.1.collisions: list", "predictions.0.collisions.0.frame: frame",
               "predictions.0.collisions.0.objects: list", "predictions.0.collisions.0.objects.1.shape: word"]  # fmt: skip
SCENE = ["type: word", "objects: list", "objects.0.type: word", *_named("objects.0", "id"), "n_frames: count",
         "visible: object", "visible.dtype: word", "visible.shape: list", "visible.values: list", "events: list",
         "events.0.type: word", "events.0.kind: word", "events.0.frame: frame", "events.0.objects: list",
         "counterfactual.map: list"]  # fmt: skip
FIELDS: dict[str, list[Field]] = {
    "questions": _fields(
        "0.scene_index: id", "0.video_filename: text", "0.questions: list", "0.questions.0.question_id: id",
        "0.questions.0.question: text", "0.questions.0.question_type: word", "0.questions.0.program: tokens?",
        "0.questions.0.answer: answer?", "0.questions.1.choices: list", "0.questions.1.choices.0.choice_id: id",
        "0.questions.1.choices.0.choice: text", "0.questions.1.choices.0.program: tokens?",
        "0.questions.1.choices.0.answer: judgement?"),
    "annotations": _fields(
        "scene_index: id", "video_filename: text", "object_property: list", *_named("object_property.1", "object_id"),
        "motion_trajectory: list", "motion_trajectory.5.frame_id: frame", "motion_trajectory.5.objects: list",
        "motion_trajectory.5.objects.1.object_id: object id", "motion_trajectory.5.objects.1.location: vector",
        "motion_trajectory.5.objects.1.orientation: vector", "motion_trajectory.5.objects.1.velocity: vector",
        "motion_trajectory.5.objects.1.angular_velocity: vector",
        "motion_trajectory.5.objects.1.inside_camera_view: boolean", "collision: list",
        "collision.0.object_ids: pair", "collision.0.frame_id: frame"),
    "truth": _fields(*TRUTH),
    "truth for questions": _fields(*TRUTH[:-1]),
    "ground truth": _fields("ground_truth: object", *_block("ground_truth.")),
    "blocks": _fields("0.video: id", "0.n_frames: count", *_block("0.")),
    "proposals": _fields(
        "frames: list", "frames.3.frame_index: frame", "frames.3.objects: list", "frames.3.objects.1.mask: object",
        "frames.3.objects.1.mask.size: mask size", "frames.3.objects.1.mask.counts: mask",
        "frames.3.objects.1.color: word", "frames.3.objects.1.material: word", "frames.3.objects.1.shape: word",
        "frames.3.objects.1.score: share"),
    "predictions": _fields(*PREDICTIONS),
    "scenes from predictions": _fields(*PREDICTIONS[5:]),
    "scenes": _fields(*SCENE),
    "scene questions": _fields(*SCENE[-6:]),
    "manifest": _fields("splits: object", "splits.train: list", "splits.validation: list", "kinds: list", "n_frames: count"),
    "submission": _fields(
        "0.scene_index: id", "0.questions: list", "0.questions.0.question_id: id", "0.questions.0.answer: given",
        "0.questions.1.choices: list", "0.questions.1.choices.0.choice_id: id", "0.questions.1.choices.0.answer: judgement"),
    "questions to tag": _fields("0.questions.1.choices.0.program: tokens", "0.questions.1.choices.0.answer: judgement"),
}  # fmt: skip
"""The fields of each format that a reader needs (`docs/cli.md` and the readers' documentation)."""


def _uncertain(probability: object = 0.5, removed: object = None, frame: int = 30) -> dict[str, Any]:
    event = {"type": "Event", "kind": "collision", "frame": frame, "objects": [0, 1]}
    return {"type": "UncertainEvent", "event": event, "probability": probability, "removed": removed}


CHANGES: dict[str, dict[str, Change]] = {
    "questions": {
        "scene twice": repeated(0),
        "question twice": repeated(0, "questions", 0),
        "choice twice": repeated(0, "questions", 1, "choices", 0),
        "no scene": lambda d: d.clear(),
        "no question": replaced(0, "questions", []),
        "no choice": replaced(0, "questions", 1, "choices", []),
        "choices of a descriptive question": lambda d: d[0]["questions"][0].update(choices=d[0]["questions"][1]["choices"]),
        "number as answer": replaced(0, "questions", 0, "answer", "33"),
        "text too long": replaced(0, "questions", 0, "question", "a " * 100_000),
        "control characters": replaced(0, "questions", 0, "question", "How many\x00 collisions happen?"),
        "lone surrogate": replaced(0, "questions", 0, "question", "\ud800"),
        "program too long": replaced(0, "questions", 0, "program", ["events"] * 100_000),
        "unknown token": replaced(0, "questions", 0, "program", ["events", "zebra", "count"]),
        "program underflow": replaced(0, "questions", 0, "program", ["count"]),
        "empty program": replaced(0, "questions", 0, "program", []),
        "leaves the folder": replaced(0, "video_filename", "../../etc/passwd"),
        "absolute path": replaced(0, "video_filename", "/etc/passwd"),
        "choice without an answer": lambda d: d[0]["questions"][1]["choices"].append({"choice_id": 1, "choice": "x"}),
    },
    "annotations": {
        "object twice": repeated("object_property", 0),
        "same attributes": lambda d: d["object_property"][1].update(color="red", material="metal", shape="cube"),
        "no object": replaced("object_property", []),
        "frame twice": repeated("motion_trajectory", 5),
        "frame missing": lambda d: d["motion_trajectory"].pop(5),
        "no frame": replaced("motion_trajectory", []),
        "object twice in a frame": repeated("motion_trajectory", 5, "objects", 0),
        "object missing in a frame": lambda d: d["motion_trajectory"][5]["objects"].pop(),
        "huge velocity": replaced("motion_trajectory", 5, "objects", 1, "velocity", [1e300, 0, 0]),
        "other scene": replaced("scene_index", 10001),
    },
    "truth": {
        "object twice": repeated("objects", 0),
        "same attributes": lambda d: d["objects"][1].update(color="red", material="metal", shape="cube"),
        "no object": replaced("objects", []),
        "object twice in a frame": repeated("frames", 5, "objects", 0),
        "object missing in a frame": lambda d: d["frames"][5]["objects"].pop(),
        "fewer frames than the video": lambda d: d["frames"].__delitem__(slice(50, None)),
        "no frame": replaced("frames", []),
        "unknown removed object": replaced("counterfactual", "99", []),
        "word as removed object": replaced("counterfactual", "zebra", []),
        "removed object collides": lambda d: d["counterfactual"].update({"0": d["collisions"]}),
    },
    "ground truth": {
        "object twice": repeated("ground_truth", "objects", 0),
        "no object": replaced("ground_truth", "objects", []),
        "collision after the video": replaced("ground_truth", "collisions", 0, "frame", 5000),
        "entrance after the video": replaced("ground_truth", "in_outs", 0, "frame", 5000),
        "entrance twice": repeated("ground_truth", "in_outs", 0),
    },
    "blocks": {
        "video twice": repeated(0),
        "object twice": repeated(0, "objects", 0),
        "no object": replaced(0, "objects", []),
        "no video": lambda d: d.clear(),
        "collision after the video": replaced(0, "collisions", 0, "frame", 5000),
        "entrance after the video": replaced(0, "in_outs", 0, "frame", 5000),
    },
    "proposals": {
        "frame twice": repeated("frames", 3),
        "frames out of order": lambda d: d["frames"].reverse(),
        "last frame far away": replaced("frames", 127, "frame_index", 100_000),
        "240 objects in a frame": lambda d: d["frames"][3].update(objects=d["frames"][3]["objects"] * 80),
        "huge number of frames": replaced("n_frames", 10**9),
        "no frame": replaced("frames", []),
        "text as number of frames": replaced("n_frames", "zebra"),
        "first frame is 1": replaced("frames", 0, "frame_index", 1),
        "fewer frames than listed": replaced("n_frames", 2),
    },
    "predictions": {
        "object twice": repeated("objects", 0),
        "no prediction": replaced("predictions", []),
        "prediction twice": repeated("predictions", 1),
        "sample twice": repeated("predictions", 0, "trajectory", 2),
        "samples out of order": lambda d: d["predictions"][0]["trajectory"].reverse(),
        "object twice in a sample": repeated("predictions", 0, "trajectory", 2, "objects", 0),
        "same object collides": lambda d: d["predictions"][0]["collisions"][0].update(objects=[d["objects"][0]] * 2),
        "three objects collide": lambda d: d["predictions"][0]["collisions"][0].update(objects=d["objects"]),
        "huge position": replaced("predictions", 0, "trajectory", 2, "objects", 0, "x", 1e300),
    },
    "scenes": {
        "object twice": repeated("objects", 0),
        "no object": replaced("objects", []),
        "unknown key": replaced("zebra", 5),
        "other type": replaced("type", "VideoTracks"),
        "dtype of Python": replaced("visible", "dtype", "object"),
        "shape too large": replaced("visible", "shape", [10**6, 10**6]),
        "negative shape": replaced("visible", "shape", [-1, 128]),
        "values missing": replaced("visible", "values", "1"),
        "values that are not 0 or 1": lambda d: d["visible"].update(values=d["visible"]["values"].replace("1", "x")),
        "more frames than visible": replaced("n_frames", 500),
        "event after the video": replaced("events", 0, "frame", 9999),
        "event of an unknown object": replaced("events", 0, "objects", [0, 99]),
        "event of one object twice": replaced("events", 0, "objects", [0, 0]),
        "event of three objects": replaced("events", 0, "objects", [0, 1, 2]),
        "unknown removed object": lambda d: d["counterfactual"]["map"].append([99, []]),
        "reference to an array": replaced("visible", {"array": "array_0"}),
        "map of one column": replaced("counterfactual", "map", [[0]]),
        "unseen event far away": replaced("predicted", 0, "frame", 10**12),
        "event without a frame": replaced("events", 0, "frame", -1),
        "probability above 1": lambda d: d.update(uncertain=[_uncertain(probability=1.5)]),
        "text as probability": lambda d: d.update(uncertain=[_uncertain(probability="a")]),
        "uncertain with an unknown object removed": lambda d: d.update(uncertain=[_uncertain(removed=9)]),
        "uncertain event far away": lambda d: d.update(uncertain=[_uncertain(frame=10**12)]),
    },
    "manifest": {
        "inverted split": replaced("splits", "validation", [10001, 10000]),
        "huge split": replaced("splits", "validation", [0, 10**12]),
        "negative split": replaced("splits", "validation", [-5, 3]),
        "split of words": replaced("splits", "validation", ["a", "b"]),
        "three ends": replaced("splits", "validation", [1, 2, 3]),
        "unknown kind": replaced("kinds", ["zebra"]),
        "number as kind": replaced("kinds", [5]),
        "overlapping splits": replaced("splits", "train", [10000, 10001]),
    },
    "submission": {
        "scene twice": repeated(0),
        "question twice": repeated(0, "questions", 0),
        "choice twice": repeated(0, "questions", 1, "choices", 0),
        "no scene": lambda d: d.clear(),
        "no question": replaced(0, "questions", []),
        "no question of the file": lambda d: d[0].update(scene_index=10007),
    },
    "questions to tag": {
        "scene without truth": replaced(0, "scene_index", 10001),
        "unknown tag": lambda d: d[0]["questions"][1]["choices"][0].update(tag="zebra"),
        "unknown object": lambda d: d[0]["questions"][1]["program"].__setitem__(2, "purple"),
    },
}  # fmt: skip
"""Documents whose fields are right one by one, but not together."""


@lru_cache
def _good(kind: str) -> Any:
    return DOCUMENTS[kind][1]()


def document_writer(kind: str) -> Callable[[Change], Write]:
    """Makes what writes the format's good document after a change."""
    file = DOCUMENTS[kind][0]

    def writer(change: Change) -> Write:
        def write(folder: Path, good: Path) -> None:
            document = copy.deepcopy(_good(kind))
            change(document)
            put_beside(kind, folder, good)
            text_writer(file, dumped(document))(folder, good)

        return write

    return writer


def put_beside(kind: str, folder: Path, good: Path) -> None:
    """The other files that a format's command reads."""
    if kind == "manifest":
        for path in (good / "release").iterdir():
            (folder / path.name).symlink_to(path)


def document_cases() -> Iterator[Case]:
    """All bad JSON documents."""
    for kind, (file, *_) in DOCUMENTS.items():
        writer = document_writer(kind)
        yield from field_cases(kind, FIELDS[kind], COMMANDS[kind], file, writer)
        for name, change in CHANGES.get(kind, {}).items():
            named = "10000" if name in OF_ONE_QUESTION else file
            yield Case(f"{kind}, contradiction", name, COMMANDS[kind], writer(change), named)


def control_cases() -> Iterator[Case]:
    """The good documents: every one must be accepted."""
    for kind in DOCUMENTS:
        yield Case("control", kind, COMMANDS[kind], document_writer(kind)(lambda document: None))
