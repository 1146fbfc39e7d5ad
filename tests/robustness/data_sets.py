"""Bad data sets for `nsdr export`, outputs that are there already, and the suites' settings."""

import copy
import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import yaml

from tests.robustness.case import Case, Write, dumped, removed, repeated, replaced, text_writer
from tests.robustness.files import DAMAGES
from tests.robustness.good import EXPORT, data_set_manifest, questions

SUITES = Path(__file__).resolve().parents[2] / "configs" / "generate" / "suites"
QUESTIONS, TRUTH = "questions/validation.json", "truth/validation/truth_10000.json"
VIDEO = "videos/validation/video_10000.mp4"
LOCAL = ("export", "dataset", "--format", "chat", "-o", "out")
TOLD, WITH_SCENES = (*LOCAL, "--reasoning", "short"), (*LOCAL, "--scenes")


def data_set(file: str = "", content: str | bytes | None = "") -> Write:
    """Writes the good data set, with one of its files replaced, or left out for None."""

    def write(folder: Path, good: Path) -> None:
        for path in (good / "dataset").rglob("*.*"):
            place = folder / "dataset" / path.relative_to(good / "dataset")
            place.parent.mkdir(parents=True, exist_ok=True)
            place.symlink_to(path)
        if file:
            (folder / "dataset" / file).unlink()
        if file and content is not None:
            text_writer(f"dataset/{file}", content)(folder, good)

    return write


def changed(document: Callable[[], Any], change: Callable[[Any], object]) -> str:
    """The JSON text of a good document after a change."""
    value = copy.deepcopy(document())
    change(value)
    return dumped(value)


OUTPUTS: dict[str, dict[str, str]] = {
    "other file": {"out/notes.txt": "zebra"}, "rows of something else": {"out/validation.jsonl": "zebra"},
    "settings are no JSON": {"out/export.json": "zebra"}, "settings as list": {"out/export.json": "[]"},
    "no settings": {"out/export.json": "{}"}, "settings as text": {"out/export.json": '{"settings": "x"}'},
    "other settings": {"out/export.json": '{"settings": {"format": "chat"}}'},
    "other settings of a finished export": {"out/export.json": '{"settings": {"format": "chat"}, "complete": true}'},
}  # fmt: skip
"""What is in an export's folder before."""
MANIFESTS: dict[str, Callable[[Any], object]] = {
    "no seed": removed("config", "seed"), "seed as text": replaced("config", "seed", "x"),
    "negative seed": replaced("config", "seed", -1), "no first scene": removed("config", "first_scene"),
    "configuration as list": replaced("config", []), "no such video": replaced("splits", "validation", [10001, 10002]),
}  # fmt: skip
QUESTION_CHANGES: dict[str, Callable[[Any], object]] = {
    "video of another split": replaced(0, "scene_index", 15000), "video that is not there": replaced(0, "scene_index", 10001),
    "scene twice": repeated(0), "question twice": repeated(0, "questions", 0), "no scene": lambda d: d.clear(),
    "choice twice": repeated(0, "questions", 1, "choices", 0),
    "leaves the folder": replaced(0, "video_filename", "../../etc/passwd"),
    "unknown tag": lambda d: d[0]["questions"][1]["choices"][0].update(tag="zebra"),
    "30 options": lambda d: d[0]["questions"][1].update(
        choices=[{**d[0]["questions"][1]["choices"][0], "choice_id": i} for i in range(30)]),
}  # fmt: skip


def _export_cases() -> Iterator[Case]:
    for name, files in OUTPUTS.items():

        def write(folder: Path, good: Path, files: dict[str, str] = files) -> None:
            for file, content in files.items():
                text_writer(file, content)(folder, good)

        yield Case("export, existing output", name, EXPORT, write, "out")
    for name, change in MANIFESTS.items():
        yield Case(
            "export, data set", name, LOCAL, data_set("manifest.json", changed(data_set_manifest, change)), "dataset"
        )
    for name, change in QUESTION_CHANGES.items():
        yield Case("export, data set", name, LOCAL, data_set(QUESTIONS, changed(questions, change)), QUESTIONS, "")
    for name, damage in DAMAGES.items():
        write = data_set(QUESTIONS, damage(json.dumps(questions()).encode()))
        yield Case("export, questions", name, LOCAL, write, "validation.json|questions/validation.json")
    yield Case("export, data set", "no video", LOCAL, data_set(VIDEO, None), "video_10000.mp4")
    for name, argv in {"reasoning": TOLD, "scenes": WITH_SCENES}.items():
        yield Case("export, true scenes", f"{name}: missing", argv, data_set(TRUTH, None), "truth_10000.json")


def _leaves(settings: dict[str, Any], path: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    for name, value in settings.items():
        if isinstance(value, dict) and all(isinstance(key, str) for key in value):
            yield from _leaves(value, (*path, name))
        else:
            yield (*path, name)


def _suite_cases() -> Iterator[Case]:
    argv = ("generate", "dataset", "--config", "suite.yaml", "-o", "out", "--workers", "1")
    for file in sorted(SUITES.glob("*.yaml")):
        good = yaml.safe_load(file.read_text())
        for path in _leaves(good):
            for name, change in {"= zebra": replaced(*path, "zebra"), "misspelled": _misspelled(path)}.items():
                settings = copy.deepcopy(good)
                change(settings)
                write = text_writer("suite.yaml", yaml.safe_dump(settings))
                yield Case("suite", f"{file.stem}: {'.'.join(path)} {name}", argv, write, "|".join(path))


def _misspelled(path: tuple[str, ...]) -> Callable[[Any], object]:
    def change(settings: Any) -> None:
        for key in path[:-1]:
            settings = settings[key]
        settings[f"{path[-1]}x"] = settings.pop(path[-1])

    return change


def data_set_cases() -> Iterator[Case]:
    """All bad data sets and suites."""
    yield from _export_cases()
    yield from _suite_cases()


def data_set_controls() -> Iterator[Case]:
    """Good data sets: every one must be accepted."""
    for name, argv in {"export": LOCAL, "reasoning": TOLD, "scenes": WITH_SCENES}.items():
        yield Case("control", name, argv, data_set())
