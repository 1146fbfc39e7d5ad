"""Figures of question sets: distributions of questions and answers, and the program-count curve."""

from collections.abc import Mapping, Sequence
from typing import Any

from nsdr.clevrer.files.questions import QUESTION_TYPES, by_type
from nsdr.visualize.figures import pyplot

__all__ = ["program_curve", "question_figure"]

FIGURE_INCHES, CURVE_INCHES = (9.5, 6.0), (9.5, 3.4)
"""Width and height of the figures (inches)."""
WIDTH_RATIOS = (1.35, 1.15, 0.85)
"""Relative widths of the panels of types, sub-types and choices."""
BAR_GROUP_WIDTH = 0.8
"""Width of all bars of a key; the distance between keys is 1."""
LABEL_PT, VALUE_PT, TITLE_PT = 7.5, 7, 10
"""Font sizes of labels, of the values at bars, and of titles (points)."""
HEADROOM = 1.2
"""Height of an axis relative to its largest bar, so that the values at bars and the names of groups have space."""
GRID_ALPHA = 0.3
"""Opacity of the grid."""
MARKERS = dict(zip(QUESTION_TYPES, "os^D", strict=True))
"""Marker of each question type in the curve."""
SUBTYPES = ("count", "exist", "query_color", "query_shape", "query_material")
"""Sub-types of descriptive questions."""
Counts = Mapping[str, Mapping[str, float]]
"""Number of questions, choices or answers of each kind, by statistic, as `nsdr.generate.statistics` counts them."""


def question_figure(series: Mapping[str, Counts]) -> Any:
    """Shares of question types, descriptive sub-types, choices and answers of one or several question sets, as bars.

    Args:
        series: counts of each question set by its name; a set without the answers of a sub-type has no bars there.

    Returns:
        A matplotlib figure.

    Raises:
        DataError: matplotlib is missing.
    """
    figure = pyplot().figure(figsize=FIGURE_INCHES, layout="constrained")
    panels = figure.subplot_mosaic([["types", "subtypes", "choices"], ["answers"] * 3], width_ratios=WIDTH_RATIOS)
    kinds = {name: counts["questions by kind"] for name, counts in series.items()}
    types = {name: by_type(values) for name, values in kinds.items()}
    _bars(panels["types"], "Question types", [(t, t, "") for t in QUESTION_TYPES], _shares(types))
    subtypes = {name: {t: values.get(t, 0) for t in SUBTYPES} for name, values in kinds.items()}
    _bars(
        panels["subtypes"],
        "Sub-types of descriptive questions",
        [(t, t.replace("_", "\n"), "") for t in SUBTYPES],
        _shares(subtypes),
    )
    choices = {name: counts.get("options of a question", {}) for name, counts in series.items()}
    numbers = sorted({n for values in choices.values() for n in values})
    _bars(panels["choices"], "Choices of a question", [(n, n, "") for n in numbers], _shares(choices))
    _answers(panels["answers"], series)
    handles, names = panels["types"].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside lower center", ncols=len(names), fontsize=LABEL_PT, frameon=False)
    return figure


def _answers(axes: Any, series: Mapping[str, Counts]) -> None:
    """The answers to each sub-type, in % of the sub-type's questions."""
    keys, shares = [], {name: dict[str, float]() for name in series}
    for subtype in SUBTYPES:
        counts = {name: values.get(f"answers, {subtype}", {}) for name, values in series.items()}
        answers = sorted({answer for values in counts.values() for answer in values})
        keys += [(f"{subtype} {answer}", answer, subtype if answer == answers[0] else "") for answer in answers]
        for name, values in _shares(counts).items():
            shares[name] |= {f"{subtype} {answer}": share for answer, share in values.items()}
    _bars(axes, "Answers to descriptive questions, by sub-type", keys, shares)


def _shares(series: Mapping[str, Mapping[str, float]]) -> dict[str, dict[str, float]]:
    """In %; {} for a set that has none."""
    totals = {name: sum(values.values()) for name, values in series.items()}
    return {
        name: {key: 100 * value / totals[name] for key, value in values.items()} if totals[name] else {}
        for name, values in series.items()
    }


def _bars(
    axes: Any, title: str, keys: Sequence[tuple[str, str, str]], series: Mapping[str, Mapping[str, float]]
) -> None:
    """Bars of each (key, label, name of the group that begins with it) and of each series, with their values."""
    shown = {name: values for name, values in series.items() if values}
    width = BAR_GROUP_WIDTH / max(len(shown), 1)
    for number, name in enumerate(series):
        if name not in shown:
            continue
        offset = (list(shown).index(name) - (len(shown) - 1) / 2) * width
        heights = [shown[name].get(key, 0.0) for key, _, _ in keys]
        bars = axes.bar([k + offset for k in range(len(keys))], heights, width, label=name, color=f"C{number}")
        axes.bar_label(
            bars, [f"{h:.0f}" if h >= 1 or h == 0 else f"{h:.1f}" for h in heights], fontsize=VALUE_PT, padding=1
        )
    top = HEADROOM * max((v for values in shown.values() for v in values.values()), default=1.0)
    axes.set(xlim=(-0.6, len(keys) - 0.4), ylim=(0, top))
    axes.set_ylabel("%", fontsize=LABEL_PT)
    axes.set_xticks(range(len(keys)), [label for _, label, _ in keys], fontsize=LABEL_PT)
    axes.tick_params(axis="y", labelsize=LABEL_PT)
    axes.set_title(title, fontsize=TITLE_PT)
    for position, (_, _, group) in enumerate(keys):
        if group:
            axes.text(position - 0.4, top * 0.97, group, fontsize=LABEL_PT, va="top", style="italic")
            if position:
                axes.axvline(position - 0.5, color="0.7", lw=0.8)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def program_curve(rows: Sequence[Mapping[str, Any]]) -> Any:
    """Accuracy of programs and answers by the number of training programs: one line for each question type.

    Args:
        rows: of `ablation.csv`: programs, question_type, program_accuracy and answer_accuracy (0-1).

    Returns:
        A matplotlib figure.

    Raises:
        DataError: matplotlib is missing.
    """
    figure = pyplot().figure(figsize=CURVE_INCHES, layout="constrained")
    sizes = list(dict.fromkeys(str(row["programs"]) for row in rows))
    panels = {"program_accuracy": "Exact programs", "answer_accuracy": "Correct answers"}
    for number, (column, title) in enumerate(panels.items(), 1):
        axes = figure.add_subplot(1, len(panels), number)
        for question_type in QUESTION_TYPES:
            shown = [row for row in rows if row["question_type"] == question_type]
            if shown:
                positions = [sizes.index(str(row["programs"])) for row in shown]
                percent = [100 * float(row[column]) for row in shown]
                axes.plot(positions, percent, marker=MARKERS[question_type], label=question_type)
        axes.set_xticks(range(len(sizes)), [f"{int(s):,}" if s.isdigit() else s for s in sizes], fontsize=LABEL_PT)
        axes.set(xlabel="number of training programs", ylim=(-3, 103))
        axes.set_ylabel("accuracy (%)")
        axes.set_title(title, fontsize=TITLE_PT)
        axes.grid(alpha=GRID_ALPHA)
    figure.legend(*figure.axes[0].get_legend_handles_labels(), loc="outside right center", fontsize=LABEL_PT)
    return figure
