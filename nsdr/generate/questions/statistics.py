"""Statistics of a question set compared with the release: a Markdown page and charts like the paper's two figures."""

from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from nsdr.baselines.q_type import ANSWERS, PUBLISHED_Q_TYPE, q_type_baselines
from nsdr.clevrer.files.questions import SceneQuestions
from nsdr.generate.statistics import bar_charts
from nsdr.io.files import atomic_path

__all__ = ["RELEASED_QUESTIONS", "count_questions", "write_question_statistics"]

RELEASED_QUESTIONS: dict[str, dict[str, float]] = {
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


def count_questions(scenes: Iterable[SceneQuestions]) -> dict[str, dict[str, float]]:
    """The counts of `RELEASED_QUESTIONS`, those of the answers to each descriptive subtype, and those of tagged options."""
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


def write_question_statistics(stem: str | Path, scenes: Sequence[SceneQuestions]) -> None:
    """Write `STEM.statistics.md` and, if matplotlib is installed, `STEM.statistics.png`."""
    stem = Path(stem)
    counts = count_questions(scenes)
    with atomic_path(stem.with_name(f"{stem.name}.statistics.md")) as temporary:
        temporary.write_text(_markdown(counts, scenes))
    charts = [
        (name, {"this set": _shares(values), "release": _shares(RELEASED_QUESTIONS.get(name, {}))})
        for name, values in counts.items()
    ]
    bar_charts(stem.with_name(f"{stem.name}.statistics.png"), charts)


def _shares(values: Mapping[str, float]) -> dict[str, float]:
    total = sum(values.values())
    return {key: value / total for key, value in values.items()}


def _markdown(counts: Mapping[str, Mapping[str, float]], scenes: Sequence[SceneQuestions]) -> str:
    lines = [f"# Questions on {len(scenes)} videos", ""]
    for name, values in counts.items():
        this_set, released = _shares(values), _shares(RELEASED_QUESTIONS.get(name, {}))
        keys = sorted(
            {*this_set, *released}, key=lambda k: (k not in released, list(released).index(k) if k in released else k)
        )
        lines += [f"## {name.capitalize()} (%)", "", f"| | {' | '.join(keys)} |", f"|---{'|---' * len(keys)}|"]
        lines.append(f"| this set | {' | '.join(f'{100 * this_set.get(k, 0):.1f}' for k in keys)} |")
        if released:
            lines.append(f"| release | {' | '.join(f'{100 * released.get(k, 0):.1f}' for k in keys)} |")
        lines.append("")
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
        replace(s, questions=tuple(q for q in s.questions if q.choices or q.subtype in ANSWERS)) for s in scenes
    ]
    for baseline, rows in q_type_baselines(of_clevrer).items():
        published = PUBLISHED_Q_TYPE[baseline]
        lines.append(_row(f"Q-type ({baseline}), this set", {k: _percent(v) for k, v in rows.items()}))
        lines.append(_row(f"Q-type ({baseline}), as published", published))
    return "\n".join([*lines, ""])


def _percent(value: Any) -> Any:
    return tuple(100 * v for v in value) if isinstance(value, tuple) else 100 * value


def _row(name: str, rows: Mapping[str, Any]) -> str:
    return f"| {name} | {' | '.join(_cell(rows.get(kind)) for kind in PUBLISHED_Q_TYPE['random'])} |"


def _cell(value: Any) -> str:
    if value is None:
        return "-"
    return "/".join(f"{v:.1f}" for v in value) if isinstance(value, tuple) else f"{value:.1f}"
