"""One self-contained HTML page about a video: what each stage found and, for each question, program, trace and answer."""

import html
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nsdr.dynamics.simulation import simulate
from nsdr.pipeline import Perception
from nsdr.types import Answer, Remove
from nsdr.visualize.annotate import STROBE_EVERY, stroboscopic_image, write_annotated_video
from nsdr.visualize.figures import figure_png, plan_figure
from nsdr.visualize.html_parts import (
    answer_html,
    data_uri,
    figure_html,
    jpeg,
    notes_html,
    summary_html,
    video_html,
    write_page,
)
from nsdr.visualize.plan_frames import draw_plan
from nsdr.visualize.timeline import TIMELINE_STYLE, timeline_html


def write_report(
    path: str | Path, frames: NDArray[np.uint8] | None, perception: Perception, answers: Sequence[Answer]
) -> None:
    """Write the HTML page; it needs no other file and no network.

    Args:
        path: HTML file to write.
        frames: (T, height, width, 3) uint8 RGB; None leaves out the video and all pictures of frames.
        perception: of the same video; a stage that is None leaves out its part of the page.
        answers: answers with their traces; an empty sequence leaves out that part of the page.

    Raises:
        DataError: matplotlib or PyAV is missing.
    """
    scene, explanation = perception.scene, perception.explanation
    title = answers[0].question if len(answers) == 1 else "What was seen in the video"
    body = [f"<h1>{html.escape(title)}</h1>", notes_html(scene.notes)]
    body += [summary_html(answer, len(answers) > 1, scene) for answer in answers]
    if frames is not None and perception.tracks is not None:
        body += ["<h2>Video</h2>", _video(frames, perception)]
    body += [
        "<h2>Objects and events</h2>",
        timeline_html(perception, frames, "#video video"),
        "<h2>Pictures</h2>",
    ]
    if frames is not None and perception.tracks is not None and perception.proposals is not None:
        strobe = stroboscopic_image(frames, perception.proposals, perception.tracks)
        caption = f"The video as a stroboscopic image: one copy every {STROBE_EVERY} frames."
        body.append(figure_html(jpeg(strobe), caption))
    if explanation is not None:
        caption = "From above: trajectories in the video solid, predicted ones dashed."
        body.append(figure_html(figure_png(plan_figure(explanation.prediction)), caption))
    body.append(_removals(perception, answers))
    body += [answer_html(answer, perception, frames) for answer in answers]
    write_page(path, title, "".join(body), TIMELINE_STYLE)


def _video(frames: NDArray[np.uint8], perception: Perception) -> str:
    """The annotated video."""
    assert perception.tracks is not None
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "annotated.mp4"
        write_annotated_video(file, frames, perception.proposals, perception.tracks, perception.scene)
        player = video_html(file.read_bytes())
    return f"<figure id=video>{player}<figcaption>Masks, names and trails; stars mark collisions.</figcaption></figure>"


def _removals(perception: Perception, answers: Sequence[Answer]) -> str:
    """A grid with a cell for each object that the questions remove, or for all objects if they remove none.

    A cell shows the rollout without the object from above, and what is different in it. A single object has no cell, because
    nothing would be left.
    """
    explanation = perception.explanation
    if explanation is None or len(explanation.objects) < 2:
        return ""
    known = set(explanation.counterfactual)
    cells = []
    for i in sorted((_removed_objects(answers) or known) & known):
        simulation = simulate(explanation, [Remove(i)])
        last = simulation.changed.visible.shape[1] - 1
        plan = draw_plan(simulation.objects, simulation.changed, last, explanation.world, simulation.original)
        lines = [f"<li>{html.escape(simulation.describe(change))}" for change in simulation.differences()]
        cells.append(
            f"<div><h3>Without the {explanation.objects[i].name}</h3><img alt='from above' src='{data_uri(jpeg(plan))}'>"
            f"<ul>{''.join(lines) or '<li>nothing else changes'}</ul></div>"
        )
    legend = (
        f"<p class=note>From above, with trails up to frame {last}. Gray outlines: with the object.</p>"
        if cells
        else ""
    )
    return f"<h2>Without each object</h2>{legend}<div class=row>{''.join(cells)}</div>" if cells else ""


def _removed_objects(answers: Sequence[Answer]) -> set[int]:
    """Ids of the objects that the questions remove."""
    traces = [t for a in answers for t in ([a.trace] if a.trace else [c.trace for c in a.choices])]
    removed = set()
    for trace in traces:
        for step in trace:
            if step.module in ("get_counterfact", "counterfact_events"):
                removed |= set(trace[step.inputs[-1]].objects)
    return removed
