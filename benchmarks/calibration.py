"""Are probabilities right? Of statements given p, a share p should be true: reliability diagrams and calibration errors.

`nsdr evaluate … --output REPORT.json --cache SCENES` gives the answers and the scenes; `nsdr parse PROPOSALS
-o SCENES` gives scenes without questions. Their collisions are compared with the truth: a compact `truth.json.gz`
(observed collisions), or a folder of `truth_N.json` of generated videos (also those after the video and without each object).

`python -m benchmarks.calibration --report REPORT.json --scenes SCENES --truth TRUTH -o results/calibration`

writes `results/calibration.md` and `.png`. Either of report and scenes may be left out.
"""

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from benchmarks.shared import Names, made_by, named, parser_of, percent, show, table
from nsdr import Event, Scene, load
from nsdr.clevrer.files.annotations import read_truth, read_truth_file
from nsdr.clevrer.files.questions import QUESTION_TYPES
from nsdr.clevrer.files.scenes import scene_from_ground_truth, scene_from_truth
from nsdr.evaluation.measures import SURE, calibration, wilson_interval
from nsdr.io.files import find_files
from nsdr.io.reading import read_json

OBSERVED, AFTER, WITHOUT = "observed collisions", "collisions after the video", "collisions without an object"
LOWEST = 0.005
"""Collisions that are less probable are not stated."""


def read_scenes(scenes: Path, truth: Path) -> Iterator[tuple[Scene, Scene]]:
    """Predicted scenes with the true ones."""
    blocks = {} if truth.is_dir() else read_truth(truth)
    for path in find_files(scenes, "scene_*.json"):
        index = int(path.name.split(".")[0].split("_")[1])
        if blocks:
            true = scene_from_ground_truth(blocks[index], blocks[index]["n_frames"])
        else:
            true = scene_from_truth(read_truth_file(find_files(truth, f"truth_{index:05d}.json")[0]))
        yield load(path, Scene), true


def statements(scene: Scene, truth: Scene) -> Iterator[tuple[str, float, bool]]:
    """Kind, probability and truth of each collision of a scene; true ones that were not stated are missing."""
    ids = {o.name: o.id for o in truth.objects}
    for kind, removed in ((OBSERVED, None), (AFTER, None), *((WITHOUT, o.id) for o in scene.objects)):
        true_removed = None if removed is None else ids.get(scene.objects[removed].name, -1)
        true_events, events = events_of(truth, kind, true_removed), events_of(scene, kind, removed)
        if true_events is None or events is None:
            continue
        true: set[Names] = {named(truth, e) for e in true_events}
        probability = dict.fromkeys((named(scene, e) for e in events), 1.0)
        for one in scene.uncertain or ():
            is_observed = one.event.frame < scene.n_frames
            if (
                one.event.kind == "collision"
                and one.removed == removed
                and (kind == WITHOUT or is_observed == (kind == OBSERVED))
            ):
                probability[named(scene, one.event)] = one.probability
        yield from ((kind, p, pair in true) for pair, p in probability.items() if p >= LOWEST)


def events_of(scene: Scene, kind: str, removed: int | None) -> Iterable[Event] | None:
    """Collisions of a kind; None where the scene does not know them."""
    if removed is not None:
        events = (scene.counterfactual or {}).get(removed)
    else:
        events = scene.predicted if kind == AFTER else scene.events
    return None if events is None else [e for e in events if e.kind == "collision"]


def text_of(title: str, found: dict[str, dict[str, Any]]) -> str:
    """Markdown."""
    columns = (
        "statements",
        "number",
        "calibration error",
        "Brier score",
        f"{100 * SURE:.0f} % sure",
        "of these wrong (%)",
    )
    rows = []
    for name, c in found.items():
        wrong = f"{c['sure_wrong']}: {percent(c['sure_wrong'], c['sure'], 2)}"
        rows.append((name, c["n"], f"{100 * c['ece']:.1f} %", f"{c['brier']:.4f}", c["sure"], wrong))
    lines = [f"# {title}", "", table(columns, rows), ""]
    lines += ["Stated probability, share that is true, and number of statements of each bin:", ""]
    for name, c in found.items():
        bins = "; ".join(f"{100 * p:.0f} %: {100 * share:.0f} % of {n}" for p, share, n in c["bins"])
        lines.append(f"- {name}: {bins}")
    return "\n".join([*lines, "", made_by()])


def draw(found: dict[str, dict[str, Any]]) -> Figure:
    """Reliability diagrams: the share that is true with its 95 % interval; the areas of the dots grow with the numbers."""
    columns = min(len(found), 4)
    rows = -(-len(found) // columns)
    figure = Figure(figsize=(3.2 * columns, 3.9 * rows), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False).ravel()
    for axis, (name, c) in zip(axes, found.items(), strict=False):
        axis.plot([0, 1], [0, 1], color="0.7", linewidth=1)
        for p, share, n in c["bins"]:
            axis.plot([p, p], wilson_interval(share, n), color="C0", linewidth=1)
        p, share, n = zip(*c["bins"], strict=True)
        axis.scatter(p, share, [20 + 180 * k / max(n) for k in n], alpha=0.8)
        axis.set(title=f"{name}\nerror {100 * c['ece']:.1f} %, n = {c['n']}", xlabel="stated", ylabel="true")
        axis.set(xlim=(-0.05, 1.05), ylim=(-0.05, 1.05), box_aspect=1)
    for axis in axes[len(found) :]:
        axis.remove()
    return figure


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("--report", type=Path, help="of `nsdr evaluate --output`")
    parser.add_argument("--scenes", type=Path, help="folder of scene_N*.json")
    parser.add_argument("--truth", type=Path, help="truth.json.gz, or a folder of truth_N.json")
    parser.add_argument("--title", default="Calibration")
    parser.add_argument("-o", "--output", type=Path, required=True, help="without an extension")
    options = parser.parse_args()
    found: dict[str, dict[str, Any]] = {}
    if options.report:
        report = read_json(options.report)
        found |= {f"{k} answers": report[k]["calibration"] for k in QUESTION_TYPES if "calibration" in report[k]}
    if options.scenes:
        stated: dict[str, list[tuple[float, bool]]] = {kind: [] for kind in (OBSERVED, AFTER, WITHOUT)}
        for scene, truth in read_scenes(options.scenes, options.truth):
            for kind, p, is_true in statements(scene, truth):
                stated[kind].append((p, is_true))
        found |= {kind: calibration(*zip(*rows, strict=True)) for kind, rows in stated.items() if rows}
    show(text_of(options.title, found), options.output.with_suffix(".md"))
    draw(found).savefig(options.output.with_suffix(".png"), dpi=100)


if __name__ == "__main__":
    main()
