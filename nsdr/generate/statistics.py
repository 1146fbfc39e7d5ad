"""Statistics of scenes compared with the release: Markdown tables and charts."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

from nsdr.io.files import atomic_path
from nsdr.io.reading import parse_json
from nsdr.types import Scene

__all__ = ["bar_charts", "count_scenes", "released_statistics", "write_statistics"]

FRAME_BIN = 10
"""Width of a bin of frames."""
Counts = dict[str, dict[str, float]]
"""Share of each value, by statistic."""
CHART_COLUMNS = 3
"""Charts per row of a figure."""
CHART_SIZE_INCHES = (4.6, 2.9)
"""Width and height of a chart."""
CHART_DPI = 90
"""Resolution of a figure."""
BAR_GROUP_WIDTH = 0.8
"""Width of all bars of a key; the distance between keys is 1."""
MAX_UPRIGHT_LABELS, MAX_UPRIGHT_CHARACTERS = 8, 50
"""A chart with more labels, or more characters in all labels, has them slanted."""

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
    "unseen": "collisions after the video",
}
"""Headings of the statistics."""


def count_scenes(scenes: Iterable[Scene]) -> Counts:
    """Share of each value (sum 1) for each statistic of `TITLES`; frames in bins of ten ("30" is 30-39)."""
    counters: dict[str, Counter[str]] = {name: Counter() for name in TITLES}

    def frame_bin(frame: int) -> str:
        return str(frame // FRAME_BIN * FRAME_BIN)

    for scene in scenes:
        by_kind = {kind: [e.frame for e in scene.events if e.kind == kind] for kind in ("collision", "in", "out")}
        counters["objects"][str(len(scene.objects))] += 1
        for name, kind in (("collisions", "collision"), ("enters", "in"), ("exits", "out")):
            counters[name][str(len(by_kind[kind]))] += 1
        for name, kind in (("collision_frame", "collision"), ("enter_frame", "in"), ("exit_frame", "out")):
            counters[name].update(map(frame_bin, by_kind[kind]))
        if by_kind["collision"]:
            counters["first_collision_frame"][frame_bin(min(by_kind["collision"]))] += 1
        for o in scene.objects:
            counters["shape"][o.shape] += 1
            counters["material"][o.material] += 1
        if scene.unseen is not None:
            counters["unseen"][str(len(scene.unseen))] += 1
    return {name: _shares(counter) for name, counter in counters.items() if counter}


def _shares(counter: Counter[str]) -> dict[str, float]:
    total = sum(counter.values())
    return {key: round(counter[key] / total, 5) for key in sorted(counter, key=lambda k: (len(k), k))}


def released_statistics() -> Counts:
    """`count_scenes` of 12,228 released train and validation videos; source: the ground-truth blocks of their proposals."""
    content: Counts = parse_json(files("nsdr.generate").joinpath("released_statistics.json").read_bytes(), "statistics")
    return content


def write_statistics(folder: str | Path, counts: Counts, title: str) -> None:
    """Write `statistics.md` and, if matplotlib is installed, `statistics.png`: `counts` next to the release's."""
    folder, released = Path(folder), released_statistics()
    with atomic_path(folder / "statistics.md") as temporary:
        temporary.write_text(_markdown(counts, released, title))
    _charts(folder / "statistics.png", counts, released)


def _keys(*tables: Mapping[str, float]) -> list[str]:
    return sorted({key for table in tables for key in table}, key=lambda k: (len(k), k))


def _markdown(counts: Counts, released: Counts, title: str) -> str:
    lines = [f"# {title}", "", "Shares in percent, this data set / the release (12,228 videos).", ""]
    for name, text in TITLES.items():
        if name not in counts:
            continue
        this_set, release = counts[name], released.get(name, {})
        keys = _keys(this_set, release)
        lines += [f"## {text.capitalize()}", "", f"| | {' | '.join(keys)} |", f"|---{'|---' * len(keys)}|"]
        lines.append(f"| this | {' | '.join(f'{100 * this_set.get(k, 0):.1f}' for k in keys)} |")
        if release:
            lines.append(f"| release | {' | '.join(f'{100 * release.get(k, 0):.1f}' for k in keys)} |")
        lines.append("")
    return "\n".join(lines)


def _charts(path: Path, counts: Counts, released: Counts) -> None:
    bar_charts(
        path,
        [
            (TITLES[name], {"this data set": counts[name], "release": released.get(name, {})})
            for name in TITLES
            if name in counts
        ],
    )


def bar_charts(path: str | Path, charts: Sequence[tuple[str, Mapping[str, Mapping[str, float]]]]) -> None:
    """Write a PNG of bar charts: (title, {series: {key: share}}). Does nothing if matplotlib is not installed."""
    try:
        from matplotlib.figure import Figure
    except ImportError:
        return
    rows = -(-len(charts) // CHART_COLUMNS)
    width, height = CHART_SIZE_INCHES
    figure = Figure(figsize=(width * CHART_COLUMNS, height * rows), layout="constrained")
    for number, (title, series) in enumerate(charts, 1):
        axes: Any = figure.add_subplot(rows, CHART_COLUMNS, number)
        shown = {name: values for name, values in series.items() if values}
        keys = _keys(*shown.values())
        bar_width = BAR_GROUP_WIDTH / max(len(shown), 1)
        for s, (name, values) in enumerate(shown.items()):
            positions = [k + (s - (len(shown) - 1) / 2) * bar_width for k in range(len(keys))]
            axes.bar(positions, [100 * values.get(k, 0) for k in keys], bar_width, label=name)
        crowded = len(keys) > MAX_UPRIGHT_LABELS or sum(map(len, keys)) > MAX_UPRIGHT_CHARACTERS
        axes.set_xticks(range(len(keys)), keys, fontsize=7, rotation=45 if crowded else 0)
        axes.set_title(title, fontsize=9)
        axes.set_ylabel("%", fontsize=8)
    if charts:
        figure.axes[0].legend(fontsize=7)
    with atomic_path(path) as temporary:
        figure.savefig(temporary, dpi=CHART_DPI)
