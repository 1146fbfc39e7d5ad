"""One self-contained HTML page about a video: what each stage found and, for each question, program, trace and answer."""

import base64
import html
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from nsdr.errors import DataError
from nsdr.io.files import atomic_path
from nsdr.pipeline import Perception
from nsdr.symbolic import format_tree
from nsdr.symbolic.traces import explain
from nsdr.types import Answer, TraceStep
from nsdr.visualize.annotate import annotated_image
from nsdr.visualize.figures import causal_figure, figure_png, plan_figure
from nsdr.visualize.strobe import EVERY, stroboscopic_image

__all__ = ["write_report"]

OBSERVED_FRAMES_PER_STEP = 3
"""Maximum number of frames shown beside a step of the trace."""
THUMBNAIL_SIZE_PX = (240, 160)
"""Width and height of these frames."""
HIGHLIGHT_COLOR = (255, 210, 60)
"""Colour of the boxes around a step's objects, RGB."""
HIGHLIGHT_WIDTH_PX = 3
"""Line width of these boxes (pixels of the video)."""
STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; color: #222; max-width: 1060px; margin: 2em auto; padding: 0 1em }
h1 { font-size: 1.5em } h2 { font-size: 1.15em; margin-top: 2em; border-bottom: 1px solid #ddd }
figure { margin: 0 } figcaption { color: #666; font-size: .85em }
.row { display: grid; grid-template-columns: 1fr 1fr; gap: 1em } img { max-width: 100%; border-radius: 4px }
pre { background: #f6f6f6; padding: .8em; overflow-x: auto; font-size: .85em; line-height: 1.35 }
table { border-collapse: collapse; width: 100% } td, th { padding: .25em .6em; text-align: left; vertical-align: top;
border-top: 1px solid #eee } .answer { font-size: 1.3em } .correct { color: #177245 } .wrong { color: #a33 }
td img { width: 150px }
"""


def write_report(
    path: str | Path, frames: NDArray[np.uint8], perception: Perception, answers: Sequence[Answer]
) -> None:
    """Write the HTML page.

    Args:
        path: HTML file to write.
        frames: (T, 320, 480, 3) uint8 RGB.
        perception: of the same video, with proposals, tracks and dynamics.
        answers: answers with their traces; an empty sequence leaves out that part of the page.

    Raises:
        DataError: matplotlib is missing, or the perception lacks proposals, tracks or dynamics.
    """
    scene, proposals, tracks, dynamics = perception.scene, perception.proposals, perception.tracks, perception.dynamics
    if proposals is None or tracks is None or dynamics is None:
        raise DataError(f"{path}: a report needs a perception with proposals, tracks and dynamics")
    last = len(frames) - 1
    annotated = annotated_image(frames[last], last, proposals, tracks, scene)
    strobe = stroboscopic_image(frames, proposals, tracks, EVERY)
    body = [
        "<h1>" + html.escape(answers[0].question if len(answers) == 1 else "What was seen in the video") + "</h1>",
        *(_summary(answer) for answer in answers),
        "<h2>Perception</h2><div class=row>",
        _figure(_png(strobe), f"The video as a stroboscopic image: one copy every {EVERY} frames."),
        _figure(_png(annotated), "Frame parser and tracker: masks, ids and trails; stars mark collisions."),
        "</div><h2>Dynamics</h2><div class=row>",
        _figure(figure_png(plan_figure(dynamics)), "From above: observed trajectories solid, predicted ones dashed."),
        _figure(figure_png(causal_figure(scene)), "Causal graph."),
        "</div><h2>Without each object</h2><div class=row>",
        *(
            _figure(figure_png(plan_figure(dynamics, i)), f"Without the {scene.objects[i].name}; gray: with it.")
            for i in sorted(_removed_objects(answers) or dynamics.counterfactual)
        ),
        "</div>",
        *(_answer(answer, perception, frames) for answer in answers),
    ]
    page = f"<!doctype html><html lang=en><meta charset=utf-8><title>NS-DR</title><style>{STYLE}</style>{''.join(body)}</html>"
    with atomic_path(path) as temporary:
        temporary.write_text(page, encoding="utf-8")


def _removed_objects(answers: Sequence[Answer]) -> set[int]:
    """Ids of the objects that the questions remove."""
    traces = [t for a in answers for t in ([c.trace for c in a.choices] or [a.trace])]
    removed = set()
    for trace in traces:
        for step in trace:
            if step.module == "get_counterfact":
                removed |= set(trace[step.inputs[1]].objects)
    return removed


def _summary(answer: Answer) -> str:
    if answer.answer is not None:
        return f"<p class=answer>Answer: <b>{html.escape(answer.answer)}</b></p>"
    rows = (f"<tr class={c.answer}><td>{c.answer}<td>{html.escape(c.choice)}" for c in answer.choices)
    return f"<table>{''.join(rows)}</table>"


def _answer(answer: Answer, perception: Perception, frames: NDArray[np.uint8]) -> str:
    parts = [f"<h2>Why: {html.escape(answer.question)}</h2>"]
    parts.append(f"<p>Program: <code>{html.escape(' '.join(answer.program))}</code></p>")
    scene = perception.scene
    if answer.answer is not None:
        parts.append(f"<p>{html.escape(explain(answer, scene))}</p>" + _trace(answer.trace, perception, frames))
    for choice in answer.choices:
        parts.append(f"<h3 class={choice.answer}>{html.escape(choice.choice)}: {choice.answer}</h3>")
        parts.append(f"<p>{html.escape(explain(choice, scene))}</p>" + _trace(choice.trace, perception, frames))
    return "".join(parts)


def _trace(trace: Sequence[TraceStep], perception: Perception, frames: NDArray[np.uint8]) -> str:
    rows = []
    for number, step in enumerate(trace, 1):
        if not step.inputs and step.module == step.text:
            continue  # a word such as `cube`, which has no result
        inputs = ", ".join(str(i + 1) for i in step.inputs)
        observed = sorted({e.frame for e in step.events if e in perception.scene.events})[:OBSERVED_FRAMES_PER_STEP]
        sources = [(f, _thumbnail(frames[f], perception, step, f)) for f in observed]
        images = "".join(f"<img alt='frame {f}' src='{source}'>" for f, source in sources)
        rows.append(f"<tr><td>{number}<td><code>{step.module}</code> {inputs}<td>{html.escape(step.text)}<td>{images}")
    tree = html.escape(format_tree(trace))
    head = "<tr><th>step<th>module, inputs<th>result<th>frames of its events"
    details = f"<details><summary>program tree</summary><pre>{tree}</pre></details>"
    return f"{details}<table>{head}{''.join(rows)}</table>"


def _thumbnail(frame: NDArray[np.uint8], perception: Perception, step: TraceStep, frame_index: int) -> str:
    """A small copy of the frame as a data URI, with boxes around the objects of the step's events in this frame."""
    image = frame.copy()
    assert perception.tracks is not None
    for i in {i for e in step.events if e.frame == frame_index for i in e.objects}:
        track = perception.tracks.tracks[i]
        box = track.box_xyxy_px[int(np.abs(track.frame_index - frame_index).argmin())].tolist()
        cv2.rectangle(image, box[:2], box[2:], HIGHLIGHT_COLOR, HIGHLIGHT_WIDTH_PX)
    return _data_uri(_png(cv2.resize(image, THUMBNAIL_SIZE_PX, interpolation=cv2.INTER_AREA)))


def _png(image: Any) -> bytes:
    """An RGB image as the bytes of a PNG file."""
    return bytes(cv2.imencode(".png", image[..., ::-1])[1])


def _data_uri(png: bytes) -> str:
    return "data:image/png;base64," + base64.b64encode(png).decode()


def _figure(png: bytes, caption: str) -> str:
    return f"<figure><img alt='' src='{_data_uri(png)}'><figcaption>{html.escape(caption)}</figcaption></figure>"
