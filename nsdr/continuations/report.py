"""Reports of `nsdr compare-videos`: a table, curves over the frames after the cut, and an HTML page."""

import html
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from nsdr.clevrer.files.annotations import read_truth_file
from nsdr.continuations.compare import GENERATED, ROWS
from nsdr.continuations.score import MEASURES
from nsdr.io.files import write_file, write_json
from nsdr.io.notes import unsaid
from nsdr.io.video import read_frames, spaced
from nsdr.io.worlds import world_in
from nsdr.visualize.figures import figure_png, new_figure
from nsdr.visualize.html_parts import figure_html, jpeg, write_page
from nsdr.world.world import World

TITLE = "Continuations of videos"
"""Title of the page."""
WORST = 5
"""Number of videos that the page shows, those with the largest errors."""
SHOWN_FRAMES = 4
"""Number of frames that are shown of each video, evenly spaced after the cut, up to the last one."""
SHOWN_WIDTH_PX = 360
"""Width of the frames that are shown (pixels)."""
STYLES = dict(zip(ROWS, ("k-", "k:", "C0:", "C0--", "C7-", "C1-", "C2-", "C3-"), strict=True))
"""Colour and line style of each row in matplotlib's notation."""
NOTES = (
    "Error: mean distance of found objects from their true positions. To the nearest future: mean distance from the nearest of "
    "the possible futures, which are runs of Bullet from positions known to 0.01. Log-likelihood: mean over objects and frames "
    "under all possible futures, relative to another run of Bullet (0: as likely as such a run). Missing: objects that should "
    "be in the image and are not found. Identity kept: objects that are seen with the color, material and shape that they had. "
    "Collisions: pairs that collide in the true video; possible collisions are those in it or in a possible future. "
    "In brackets: 95 % intervals by a bootstrap over videos; for shares, the wider of the bootstrap and Wilson's interval."
)
"""Explanation below every table."""


def markdown_table(report: Mapping[str, Any]) -> str:
    """The table of a report in Markdown."""
    lines = [f"| | {' | '.join(m.title for m in MEASURES.values())} |", "|---" * (len(MEASURES) + 1) + "|"]
    lines += [f"| {row} | {' | '.join(_cells(values))} |" for row, values in report["table"].items()]
    return "\n".join(lines) + "\n"


def _cells(row: Mapping[str, Any]) -> list[str]:
    """The cells of a row of the table, one for each measure."""
    cells = []
    for name, measure in MEASURES.items():
        value, interval = row[name]["value"], row[name]["interval"]
        scale = 100 if measure.is_share else 1
        known = [] if value is None else [round(scale * x, measure.decimals) + 0.0 for x in (value, *(interval or ()))]
        numbers = [f"{x:.{measure.decimals}f}" for x in known]  # without -0
        cells.append("-" if not numbers else numbers[0] + (f" ({numbers[1]} to {numbers[2]})" if interval else ""))
    return cells


def curves_figure(report: Mapping[str, Any]) -> Any:
    """A matplotlib figure of errors and log-likelihoods by frame after the cut, with a curve for each row.

    Raises:
        DataError: matplotlib is missing.
    """
    panels = {"error": "error", "nearest": "error to the nearest possible future", "log_likelihood": "log-likelihood"}
    figure = new_figure(15, 4.5)
    axes = figure.subplots(1, len(panels))
    for panel, (name, title) in zip(axes, panels.items(), strict=True):
        for row, curves in report["curves"].items():
            values = np.array(curves[name], float)  # None is NaN
            frames = report["given_frames"] + np.arange(len(values))
            panel.plot(frames, values, STYLES[row], lw=2.5 if row == GENERATED else 1.3, label=row)
        panel.set(xlabel="frame", title=title, ylabel=MEASURES[name].title.partition("(")[2].rstrip(")"))
        panel.set_yscale("symlog" if name == "log_likelihood" else "log")
        panel.grid(alpha=0.3)
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside right upper", fontsize=9, frameon=False)
    return figure


def write_files(report: Mapping[str, Any], folder: Path, command: str) -> list[Path]:
    """Write `report.json`, `table.md`, `curves.png` and `report.html`, and return their paths.

    Args:
        report: report of `nsdr.continuations.compare.compare_videos`.
        folder: folder to which the files are written.
        command: command that made the report.
    """
    paths = [folder / name for name in ("report.json", "table.md", "curves.png", "report.html")]
    write_json(paths[0], {"command": command, **report}, indent=1)
    made = f"{len(report['videos'])} videos. Made by `{command}`, revision {report['revision']}."
    write_file(paths[1], f"{markdown_table(report)}\n{NOTES}\n{made}\n{_not_scored(report)}")
    picture = figure_png(curves_figure(report))
    write_file(paths[2], picture)
    write_page(paths[3], TITLE, _body(report, picture, made), "body { max-width: 1500px }")
    return paths


def _not_scored(report: Mapping[str, Any]) -> str:
    """A Markdown list of the videos that were not scored, with the reasons."""
    rows = [f"- {name}: {reason}" for name, reason in report["not_scored"].items()]
    return "\n".join(["", f"Not scored ({len(rows)}):", "", *rows, ""]) if rows else ""


def _body(report: Mapping[str, Any], picture: bytes, made: str) -> str:
    """The body of the HTML page."""
    head = "".join(f"<th>{html.escape(m.title)}" for m in MEASURES.values())
    rows = "".join(
        f"<tr><td>{row}{''.join(f'<td>{cell}' for cell in _cells(values))}" for row, values in report["table"].items()
    )
    body = [f"<h1>{TITLE}</h1><table><tr><th>{head}{rows}</table><p>{NOTES}</p><p>{html.escape(made)}</p>"]
    body.append(figure_html(picture, "Means over objects and videos, by frame after the cut."))
    body += [
        "<h2>Worst cases</h2>",
        "<p>Videos that are farthest from every possible future. Left: the true video. Right: the generated video.</p>",
    ]
    nearest = [v["rows"][GENERATED]["nearest"] for v in report["videos"]]
    worst = np.argsort([-np.inf if n is None else -n for n in nearest], kind="stable")[:WORST]
    body += [_case(report["videos"][k], report["given_frames"], report["fps"]) for k in worst]
    if report["not_scored"]:
        listed = "".join(f"<li>{html.escape(f'{name}: {why}')}" for name, why in report["not_scored"].items())
        body.append(f"<h2>Not scored</h2><ul>{listed}</ul>")
    return "".join(body)


def _case(video: Mapping[str, Any], cut: int, fps: float) -> str:
    """HTML of some frames of a video after the cut, the true next to the generated ones, with the errors of the objects."""
    values = video["rows"][GENERATED]
    said = ", ".join(f"{MEASURES[m].title}: {values[m]:.3g}" for m in ("error", "nearest") if values[m] is not None)
    n = len(next(iter(video["objects"].values())))
    shown = [cut + int(f) for f in spaced(n, SHOWN_FRAMES + 1)[1:]]
    world = world_in(read_truth_file(video["truth"]))
    pictures = [_frames(video[kind], shown, fps, world) for kind in ("seen", "generated")]
    figures = []
    for k, f in enumerate(shown):
        errors = [f"{name} {row[f - cut]:.2f}" for name, row in video["objects"].items() if row[f - cut] is not None]
        images = [p[k] for p in pictures if k < len(p)]
        figures.append(
            figure_html(jpeg(np.hstack(images)), f"Frame {f}; errors (world units): {', '.join(errors) or 'none'}")
        )
    return f"<h3>{html.escape(video['name'])}: {html.escape(said)}</h3><div class=row>{''.join(figures)}</div>"


def _frames(path: str, wanted: Sequence[int], fps: float, world: World) -> list[Any]:
    """Frames of a video with the width `SHOWN_WIDTH_PX`; none if the path is that of proposals."""
    if not path.endswith(".mp4"):
        return []
    size_px = SHOWN_WIDTH_PX, round(SHOWN_WIDTH_PX * world.camera.height / world.camera.width)
    frames = [frame for i, frame in enumerate(read_frames(path, fps=fps, note=unsaid, world=world)) if i in wanted]
    return [cv2.resize(frame, size_px, interpolation=cv2.INTER_AREA) for frame in frames]
