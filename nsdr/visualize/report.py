"""One self-contained HTML page about a video: what each stage found and, for each question, program, trace and answer."""

import base64
import html
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nsdr.dynamics.simulation import simulate
from nsdr.pipeline import Perception
from nsdr.types import Answer, Remove, Simulation
from nsdr.visualize.annotate import STROBE_EVERY, stroboscopic_image, write_annotated_video
from nsdr.visualize.event_words import change_text
from nsdr.visualize.figures import figure_png, plan_figure
from nsdr.visualize.html_parts import answer_html, figure_html, jpeg, notes_html, summary_html, write_page
from nsdr.visualize.timeline import TIMELINE_STYLE, event_picture, timeline_html


def write_report(
    path: str | Path, frames: NDArray[np.uint8] | None, perception: Perception, answers: Sequence[Answer]
) -> None:
    """Write the HTML page; it needs no other file and no network.

    Args:
        path: HTML file to write.
        frames: (T, 320, 480, 3) uint8 RGB; None leaves out the video and all pictures of frames.
        perception: of the same video; a stage that is None leaves out its part of the page.
        answers: answers with their traces; an empty sequence leaves out that part of the page.

    Raises:
        DataError: matplotlib or PyAV is missing.
    """
    scene, explanation = perception.scene, perception.explanation
    title = answers[0].question if len(answers) == 1 else "What was seen in the video"
    body = [f"<h1>{html.escape(title)}</h1>", notes_html(scene.notes)]
    body += [summary_html(answer, len(answers) > 1, scene.notes) for answer in answers]
    if frames is not None and perception.tracks is not None:
        body += ["<h2>Video</h2>", _video(frames, perception)]
    body += [
        "<h2>Objects and events</h2>",
        timeline_html(perception, frames, "#video video"),
        "<h2>Pictures</h2><div class=row>",
    ]
    if frames is not None and perception.tracks is not None and perception.proposals is not None:
        strobe = stroboscopic_image(frames, perception.proposals, perception.tracks)
        caption = f"The video as a stroboscopic image: one copy every {STROBE_EVERY} frames."
        body.append(figure_html(jpeg(strobe), caption))
    if explanation is not None:
        caption = "From above: trajectories in the video solid, predicted ones dashed."
        body.append(figure_html(figure_png(plan_figure(explanation.prediction, camera=perception.camera)), caption))
    body.append("</div>")
    if explanation is not None:
        body += ["<h2>Without each object</h2>", *_removals(perception, frames, answers)]
    body += [answer_html(answer, perception, frames) for answer in answers]
    write_page(path, title, "".join(body), TIMELINE_STYLE)


def _video(frames: NDArray[np.uint8], perception: Perception) -> str:
    """The annotated video."""
    assert perception.tracks is not None
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "annotated.mp4"
        write_annotated_video(file, frames, perception.proposals, perception.tracks, perception.scene)
        source = "data:video/mp4;base64," + base64.b64encode(file.read_bytes()).decode()
    caption = "Masks, names and trails in every frame; stars mark collisions."
    player = f"<video controls loop muted src='{source}'></video>"
    return f"<figure id=video>{player}<figcaption>{caption}</figcaption></figure>"


def _removals(perception: Perception, frames: NDArray[np.uint8] | None, answers: Sequence[Answer]) -> list[str]:
    """What is different without each object that the questions remove, or without each of all, with pictures."""
    explanation = perception.explanation
    assert explanation is not None
    known = set(explanation.counterfactual)
    chosen = sorted((_removed_objects(answers) or known) & known)
    parts = []
    for i in chosen:
        name = explanation.objects[i].name
        simulation = simulate(explanation, [Remove(i)])
        plan = figure_html(
            figure_png(plan_figure(explanation.prediction, i, perception.camera)), "From above; gray: with it."
        )
        changes = _changes(simulation, perception, frames) or "<p>Nothing else changes.</p>"
        parts.append(f"<h3>Without the {name}</h3><div class=row>{plan}<div>{changes}</div></div>")
    return parts


def _changes(simulation: Simulation, perception: Perception, frames: NDArray[np.uint8] | None) -> str:
    """A picture and a line for each difference: what no longer happens in the video's frame, else from above."""
    cards = []
    for change in simulation.differences():
        gone = change.kind == "no longer"
        simulated = simulation.original if gone else simulation.changed
        picture = event_picture(change.event, perception, frames if gone else None, simulated)
        cards.append(f"<div>{picture}{html.escape(change_text(simulation, change))}</div>")
    return f"<div class=cards>{''.join(cards)}</div>" if cards else ""


def _removed_objects(answers: Sequence[Answer]) -> set[int]:
    """Ids of the objects that the questions remove."""
    traces = [t for a in answers for t in ([a.trace] if a.trace else [c.trace for c in a.choices])]
    removed = set()
    for trace in traces:
        for step in trace:
            if step.module == "get_counterfact":
                removed |= set(trace[step.inputs[1]].objects)
    return removed
