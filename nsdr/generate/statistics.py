"""Statistics of scenes and of questions as Markdown tables, in CLEVRER's world beside the release's."""

from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

from msgspec.structs import replace

from nsdr.baselines.q_type import PUBLISHED_Q_TYPE, SUBTYPES, q_type_baselines
from nsdr.clevrer.files.questions import SceneQuestions
from nsdr.io.files import write_file
from nsdr.io.reading import parse_json
from nsdr.types import Scene
from nsdr.world.world import CLEVRER_WORLD, World

FRAME_BIN = 10
"""Width of a bin of frames."""
Counts = dict[str, dict[str, float]]
"""Number or share of each value, by statistic."""
TITLES = {
    "objects": "objects in a video",
    "collisions": "collisions in a video",
    "enters": "objects entering a video",
    "exits": "objects leaving a video",
    "collision_frame": "frame of collisions",
    "first_collision_frame": "frame of the first collision",
    "enter_frame": "frame of entering",
    "exit_frame": "frame of leaving",
    "shape": "shapes",
    "material": "materials",
    "predicted": "collisions after the video",
}
"""Statistics of scenes with their headings."""
RELEASED_QUESTIONS: Counts = {
    "questions by kind": {
        "count": 40000,
        "exist": 20000,
        "query_color": 18454,
        "query_shape": 16884,
        "query_material": 14614,
        "explanatory": 16799,
        "predictive": 7179,
        "counterfactual": 18642,
    },
    "options of a question": {"1": 149, "2": 9317, "3": 10188, "4": 22966},
    "correct options, explanatory": {"0": 2743, "1": 3428, "2": 5541, "3": 4320, "4": 767},
    "correct options, predictive": {"1": 7179},
    "correct options, counterfactual": {"0": 169, "1": 7947, "2": 6406, "3": 4120},
    "options by answer": {"correct": 70836, "wrong": 70375},
}
"""Counts over the train split's 10,000 videos."""


def count_scenes(scenes: Iterable[Scene]) -> Counts:
    """Share of each value (sum 1) for each statistic of `TITLES`; frames in bins of ten ("30" is 30-39)."""
    counters: dict[str, Counter[str]] = {name: Counter() for name in TITLES}
    for scene in scenes:
        counters["objects"][str(len(scene.objects))] += 1
        for name, kind in (("collision", "collision"), ("enter", "in"), ("exit", "out")):
            frames = [e.frame for e in scene.events if e.kind == kind]
            counters[f"{name}s"][str(len(frames))] += 1
            counters[f"{name}_frame"].update(map(_frame_bin, frames))
            if kind == "collision" and frames:
                counters["first_collision_frame"][_frame_bin(min(frames))] += 1
        for o in scene.objects:
            counters["shape"][o.shape] += 1
            counters["material"][o.material] += 1
        if scene.predicted is not None:
            counters["predicted"][str(len(scene.predicted))] += 1
    return {
        name: {key: round(share, 5) for key, share in _shares(counter).items()}
        for name, counter in counters.items()
        if counter
    }


def _frame_bin(frame: int) -> str:
    return str(frame // FRAME_BIN * FRAME_BIN)


def released_statistics() -> Counts:
    """`count_scenes` of 12,228 released train and validation videos; source: the ground-truth blocks of their proposals."""
    content: Counts = parse_json(files("nsdr.generate").joinpath("released_statistics.json").read_bytes(), "statistics")
    return content


def count_questions(scenes: Iterable[SceneQuestions]) -> Counts:
    """Counts as in `RELEASED_QUESTIONS`, of the answers to each descriptive subtype, and of tagged options."""
    counts: dict[str, Counter[str]] = defaultdict(Counter)
    for question in (q for scene in scenes for q in scene.questions):
        counts["questions by kind"][question.subtype or question.type] += 1
        if question.choices:
            correct = sum(c.answer == "correct" for c in question.choices)
            counts["options of a question"][str(len(question.choices))] += 1
            counts[f"correct options, {question.type}"][str(correct)] += 1
            counts["options by answer"].update(str(c.answer) for c in question.choices)
            for choice in (c for c in question.choices if c.tag is not None):
                counts["counterfactual options by tag"][str(choice.tag)] += 1
                counts[f"{choice.tag} options by answer"][str(choice.answer)] += 1
        else:
            counts[f"answers, {question.subtype}"][str(question.answer)] += 1
    names = [*RELEASED_QUESTIONS, *sorted(name for name in counts if name not in RELEASED_QUESTIONS)]
    return {name: {k: counts[name][k] for k in sorted(counts[name])} for name in names if name in counts}


def write_statistics(folder: str | Path, counts: Counts, title: str, world: World) -> None:
    """Write `statistics.md`: `count_scenes` of a data set, in CLEVRER's world beside that of the release."""
    released = released_statistics() if world == CLEVRER_WORLD else {}
    of_release = " / the release (12,228 videos)" if released else ""
    lines = [f"# {title}", "", f"Shares in percent, this data set{of_release}.", ""]
    for name in (name for name in TITLES if name in counts):
        lines += _table(TITLES[name].capitalize(), counts[name], released.get(name, {}))
    write_file(Path(folder) / "statistics.md", "\n".join(lines) + "\n")


def write_question_statistics(stem: str | Path, scenes: Sequence[SceneQuestions], world: World) -> None:
    """Write `STEM.statistics.md`: `count_questions`, and the accuracy from question types alone.

    In CLEVRER's world, both are beside those of the release.
    """
    of_clevrers_world = world == CLEVRER_WORLD
    lines = [f"# Questions on {len(scenes)} videos", ""]
    for name, values in count_questions(scenes).items():
        lines += _table(
            f"{name.capitalize()} (%)", values, RELEASED_QUESTIONS.get(name, {}) if of_clevrers_world else {}
        )
    lines += [
        "## Accuracy from the question's type alone",
        "",
        "Accuracies (%) of the Q-type baselines; multiple choice per option / per question. The most frequent answers",
        "are those of this set itself; in the paper, those of the training set. Descriptive questions beyond CLEVRER are",
        "left out.",
        "",
        "| baseline | descriptive | explanatory | predictive | counterfactual |",
        "|---|---|---|---|---|",
    ]
    of_clevrer = [
        replace(s, questions=tuple(q for q in s.questions if q.choices or q.subtype in SUBTYPES)) for s in scenes
    ]
    for baseline, rows in q_type_baselines(of_clevrer, world=world).items():
        published = [("as published", 1, PUBLISHED_Q_TYPE[baseline])] if of_clevrers_world else []
        for source, scale, found in [("this set", 100, rows), *published]:
            cells = [_accuracy(found.get(kind), scale) for kind in PUBLISHED_Q_TYPE["random"]]
            lines.append(f"| Q-type ({baseline}), {source} | {' | '.join(cells)} |")
    path = Path(stem)
    write_file(path.with_name(f"{path.name}.statistics.md"), "\n".join(lines) + "\n")


def _accuracy(value: Any, scale: float) -> str:
    """An accuracy, or a pair of accuracies per option and per question, as text."""
    values = value if isinstance(value, tuple) else (value,)
    return "-" if value is None else "/".join(f"{scale * v:.1f}" for v in values)


def _shares(values: Mapping[str, float]) -> dict[str, float]:
    """Shares of the total, with numbers in ascending order."""
    total = sum(values.values())
    return {key: values[key] / total for key in sorted(values, key=lambda k: (len(k), k))}


def _table(title: str, counts: Mapping[str, float], released: Mapping[str, float]) -> list[str]:
    """Shares of each value in percent under a heading."""
    rows = {"this set": _shares(counts)} | ({"release": _shares(released)} if released else {})
    keys = sorted({key for values in rows.values() for key in values}, key=lambda k: (k not in released, len(k), k))
    lines = [f"## {title}", "", f"| | {' | '.join(keys)} |", f"|---{'|---' * len(keys)}|"]
    for name, values in rows.items():
        lines.append(f"| {name} | {' | '.join(f'{100 * values.get(k, 0):.1f}' for k in keys)} |")
    return [*lines, ""]
