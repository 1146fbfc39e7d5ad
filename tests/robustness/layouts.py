"""Question files, data sets and command lines as people have them, and the same with a mistake."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tests.robustness.case import Case, Write, text_writer
from tests.robustness.good import COMMANDS, EVALUATE, GENERATE, SCENE, SCORE, annotation, questions

ASK, OF_ROOT = COMMANDS["questions"], (*EVALUATE, "--root", ".", "--source", "annotations", "--types", "descriptive")
VIDEO = f"video_{SCENE}.mp4"


def _forms(scene: dict[str, Any]) -> dict[str, str]:
    """A scene's questions in other forms than the release's list."""
    rows = [{**question, "scene_index": SCENE, "video_filename": VIDEO} for question in scene["questions"]]
    return {
        "lists by video": json.dumps({VIDEO: scene["questions"]}),
        "scenes by number": json.dumps({str(SCENE): scene}),
        "a scene in each line": json.dumps(scene) + "\n",
        "a question in each line": "".join(f"{json.dumps(row)}\n" for row in rows),
        "a list of questions": json.dumps(rows),
    }


def _bad_forms(scene: dict[str, Any]) -> dict[str, tuple[str, str]]:
    """The file's text, and the place that the error must name."""
    listed, line = scene["questions"], json.dumps(scene)
    return {
        "key that is no video": (json.dumps({"zebra": listed}), "zebra"),
        "key of another video": (json.dumps({"10007": scene}), "10007"),
        "number as scene": (json.dumps({VIDEO: 5}), VIDEO),
        "question twice": (json.dumps({VIDEO: [listed[0], listed[0]]}), "question_id"),
        "questions without a scene": (json.dumps(listed), "scene_index"),
        "scene in two lines": (f"{line}\n{line}\n", "line 2"),
        "cut off line": (f"{line}\n{line[:-9]}\n", "line 2"),
        "list as line": (f"{line}\n[1]\n", "line 2"),
        "empty object": ("{}", ""),
    }


def _folders(**files: str) -> Write:
    """Writes a data set with one video's annotation at each of these places."""

    def write(folder: Path, good: Path) -> None:
        for place in files.values():
            text_writer(f"{place}/annotation_{SCENE}.json", json.dumps(annotation()))(folder, good)
        text_writer("validation.json", json.dumps(questions()))(folder, good)

    return write


PLACES = {
    "validation": "annotations/validation",
    "val": "annotations/val",
    "zip in the root": "annotation_10000-11000",
    "folder of the split": "annotation_val/annotation_10000-11000",
}
TWICE = {
    "question": ("visualize", "v.mp4", "-o", "x.html", "-q", "How many?", "-q", "How many cubes are there?"),
    "long and short": ("visualize", "v.mp4", "-o", "x.html", "-q", "How many?", "--question=How many cubes are there?"),
    "output": (*SCORE, "--output", "other.json"),
    "field": (*GENERATE, "--videos=2"),
}


def layout_cases() -> Iterator[Case]:
    """All mistakes."""
    for name, (text, place) in _bad_forms(questions()[0]).items():
        yield Case("questions, form", name, ASK, text_writer("questions.json", text), "questions.json", place)
    both = _folders(first="annotations/a", second="annotations/b")
    yield Case("data set, layout", "two files of one name", OF_ROOT, both, f"annotation_{SCENE}.json")
    yield Case(
        "data set, layout", "other folders", OF_ROOT, _folders(only="annos"), f"annotation_{SCENE}.json", "annos"
    )
    for name, argv in TWICE.items():
        yield Case("option given twice", name, argv, named="2 times")


def layout_controls() -> Iterator[Case]:
    """What is right: every one must be accepted."""
    for name, text in _forms(questions()[0]).items():
        yield Case("control", f"questions: {name}", ASK, text_writer("questions.json", text))
    for name, place in PLACES.items():
        yield Case("control", f"layout: {name}", OF_ROOT, _folders(only=place))
