"""The page of data-set facts, released beside generated: `python benchmarks/dataset_facts.py DATA_SET > docs/dataset.md`."""

import json
import shlex
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from nsdr.clevrer.dataset import SPLITS
from nsdr.clevrer.files.annotations import read_truth_file
from nsdr.clevrer.files.questions import QUESTION_TYPES, SceneQuestions, read_questions
from nsdr.clevrer.files.scenes import scene_from_truth
from nsdr.errors import DataError
from nsdr.generate.statistics import (
    FRAME_BIN,
    RELEASED_QUESTIONS,
    TITLES,
    Counts,
    count_questions,
    count_scenes,
    released_statistics,
)
from nsdr.io.files import find_files
from nsdr.io.reading import read_json

RELEASED_VIDEOS = 12_228
"""Videos that `released_statistics` was counted on: released train and validation videos."""
PAPER_QUESTIONS = {"descriptive": 219_918, "explanatory": 33_811, "predictive": 14_298, "counterfactual": 37_253}
"""Questions of all splits, as the paper states them (section 3.2)."""
SETTINGS = ("videos", "seed", "first_scene", "splits", "renderer", "masks")
"""Settings of a generated data set that the page names."""
PER_COLLISION = {"collision_frame": "collisions", "enter_frame": "enters", "exit_frame": "exits"}
"""Statistics of events, and those of their number in a video."""
PROPERTIES = (
    (
        "video",
        "yes, 128 frames at 25 fps",
        "yes; length, size and frame rate are settings; none with `--renderer none`",
    ),
    (
        "diagnostic annotations",
        "objects, motion and collisions (train, validation); programs of all their questions",
        "the same, and exact masks; masses, and what the release withholds: motion and collisions after the video and without"
        " each object",
    ),
    ("temporal relation", "yes: before, after, first, second, last, at the start, at the end", "yes, the same"),
    ("explanation", "yes: which of the choices is responsible for an event", "yes"),
    ("prediction", "yes: what will happen next", "yes"),
    ("counterfactual", "yes: what will happen without an object", "yes"),
)
"""The properties of the paper's Table 1, for CLEVRER and for generated data sets."""


def facts_page(folder: str | Path) -> str:
    """Facts of CLEVRER and of a generated data set side by side, as Markdown.

    Args:
        folder: of `nsdr generate dataset`, with questions.

    Raises:
        DataError: not such a folder, or a file of it cannot be read; names it.
    """
    folder = Path(folder)
    manifest = read_json(folder / "manifest.json")
    config = manifest.get("config", {})
    questions = {split: _questions(folder, split) for split in SPLITS}
    every = [scene for scenes in questions.values() for scene in scenes]
    truths = [path for split in SPLITS for path in find_files(folder / "truth" / split, "truth_*.json")]
    if not every or not truths:
        raise DataError(f"{folder}: has no questions or no truth; expected a data set of `nsdr generate dataset`")
    scenes = count_scenes(scene_from_truth(read_truth_file(path)) for path in truths)
    counts = count_questions(every)
    parts = [
        f"""# The data set

<!-- Generated: python benchmarks/dataset_facts.py {folder} > docs/dataset.md -->

CLEVRER as it was released, beside a generated data set.

- Generated: `{_command(config)}`.
- The page is made by `python benchmarks/dataset_facts.py {folder} > docs/dataset.md`.
- Released questions were counted in the train split where nothing else is said. Released events and objects were counted in
  {RELEASED_VIDEOS:,} train and validation videos (`nsdr/generate/released_statistics.json`).
- What was not counted in the release is shown for the generated data set alone.

## Properties

The columns of the paper's Table 1.

| property | CLEVRER | generated |
|---|---|---|""",
        *(f"| {name} | {released} | {generated} |" for name, released, generated in PROPERTIES),
        "",
        "## Splits",
        "",
        "By default a generated data set has the release's shares of videos in each split, and its indices.",
        "",
        "| split | video indices | released videos | generated videos | released questions | generated questions |",
        "|---|---|---|---|---|---|",
        *(_split_row(folder, name, questions[name]) for name in SPLITS),
        f"| all | | {sum(map(len, SPLITS.values())):,} | {len(truths):,} | {sum(PAPER_QUESTIONS.values()):,} (paper) | "
        f"{_total(every):,} |",
        "",
        "## Questions",
        "",
        *_types(counts["questions by kind"]),
        *(line for name in counts for line in _question_table(name, counts)),
        "## Scenes",
        "",
        *(line for name in scenes for line in _scene_table(name, scenes, len(truths))),
    ]
    return "\n".join(parts).rstrip() + "\n"


def _command(config: Mapping[str, object]) -> str:
    """The command that made a data set, as far as `SETTINGS` and the size of its videos go."""
    values = {name: config.get(name) for name in SETTINGS}
    render = config.get("render")
    if isinstance(render, Mapping):
        values |= {f"render.{name}": render.get(name) for name in ("width", "height")}
    texts = {name: value if isinstance(value, str) else json.dumps(value) for name, value in values.items()}
    return " ".join(["nsdr generate dataset", *(f"--{name} {shlex.quote(text)}" for name, text in texts.items())])


def _questions(folder: Path, split: str) -> list[SceneQuestions]:
    """With answers: those of the test split are among the truth."""
    path = folder / "truth" / "questions_test.json" if split == "test" else folder / "questions" / f"{split}.json"
    return read_questions(path) if path.exists() else []


def _total(scenes: Sequence[SceneQuestions]) -> int:
    return sum(len(scene.questions) for scene in scenes)


def _split_row(folder: Path, split: str, questions: Sequence[SceneQuestions]) -> str:
    indices = SPLITS[split]
    made = len(find_files(folder / "truth" / split, "truth_*.json"))
    released = f"{sum(RELEASED_QUESTIONS['questions by kind'].values()):,}" if split == "train" else "not counted"
    return (
        f"| {split} | {indices.start}-{indices.stop - 1} | {len(indices):,} | {made:,} | {released} | "
        f"{_total(questions):,} |"
    )


def by_type(counts: Mapping[str, float]) -> dict[str, float]:
    """Numbers of questions of each type, from those of each descriptive sub-type and each other type."""
    others = {name: counts.get(name, 0) for name in QUESTION_TYPES[1:]}
    return {QUESTION_TYPES[0]: sum(counts.values()) - sum(others.values()), **others}


def _types(generated: Mapping[str, float]) -> list[str]:
    """Question types: the train split, all splits as the paper states them, and the generated questions."""
    columns: dict[str, Mapping[str, float]] = {
        "train": by_type(RELEASED_QUESTIONS["questions by kind"]),
        "all splits (paper)": PAPER_QUESTIONS,
        "generated": by_type(generated),
    }
    return ["### Types", "", *_table("type", QUESTION_TYPES, columns), ""]


def _question_table(name: str, counts: Mapping[str, Mapping[str, float]]) -> list[str]:
    released = RELEASED_QUESTIONS.get(name, {})
    keys = [*released, *(key for key in counts[name] if key not in released)]
    title = name[0].upper() + name[1:]
    if name == "questions by kind":
        keys, title = [key for key in keys if key not in QUESTION_TYPES], "Sub-types of descriptive questions"
    columns = {"released": released, "generated": counts[name]} if released else {"generated": counts[name]}
    shown = {column: {key: values.get(key, 0) for key in keys} for column, values in columns.items()}
    return [f"### {title}", "", *_table("", keys, shown), ""]


def _scene_table(name: str, generated: Counts, n_videos: int) -> list[str]:
    released = released_statistics()
    columns = {"released": _numbers(name, released, RELEASED_VIDEOS)} if name in released else {}
    columns["generated"] = _numbers(name, generated, n_videos)
    keys = sorted({key for values in columns.values() for key in values}, key=lambda key: (len(key), key))
    labels = {key: f"{key}-{int(key) + FRAME_BIN - 1}" if name.endswith("frame") else key for key in keys}
    shown = {title: {labels[key]: n for key, n in values.items()} for title, values in columns.items()}
    return [f"### {TITLES[name].capitalize()}", "", *_table("", list(labels.values()), shown), ""]


def _numbers(name: str, shares: Counts, n_videos: int) -> dict[str, float]:
    """Numbers of videos, objects or events from their shares, which are rounded to five decimals."""

    def mean(counted: str) -> float:
        return sum(int(number) * share for number, share in shares[counted].items())

    total = n_videos * (mean(PER_COLLISION[name]) if name in PER_COLLISION else 1)
    if name in ("shape", "material"):
        total = n_videos * mean("objects")
    elif name == "first_collision_frame":
        total = n_videos * (1 - shares["collisions"].get("0", 0))
    return {key: round(share * total) for key, share in shares[name].items()}


def _table(head: str, keys: Sequence[str], columns: Mapping[str, Mapping[str, float]]) -> list[str]:
    """Numbers and shares of each key, side by side."""
    titles = [text for name in columns for text in (name, "%")]
    lines = [f"| {' | '.join([head, *titles])} |", "|---" * (1 + len(titles)) + "|"]
    for key in keys:
        cells = [key]
        for values in columns.values():
            total = sum(values.values())
            cells += [f"{values.get(key, 0):,}", f"{100 * values.get(key, 0) / total:.1f}" if total else "-"]
        lines.append(f"| {' | '.join(cells)} |")
    return lines


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit("usage: python benchmarks/dataset_facts.py DATA_SET > docs/dataset.md")
    try:
        print(facts_page(sys.argv[1]), end="")
    except DataError as e:
        sys.exit(str(e))
