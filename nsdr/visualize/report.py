"""One self-contained HTML page about a video: what each stage found and, for each question, program, trace and answer."""

import base64
import html
import importlib.util
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from nsdr.io.files import atomic_path
from nsdr.pipeline import Perception
from nsdr.symbolic import format_probability, format_tree
from nsdr.symbolic.traces import explain
from nsdr.types import Answer, DynamicsPrediction, Event, Scene, TraceStep
from nsdr.visualize.annotate import annotated_image
from nsdr.visualize.figures import causal_figure, figure_png, plan_figure
from nsdr.visualize.impacts import event_text
from nsdr.visualize.strobe import EVERY, stroboscopic_image
from nsdr.visualize.video import write_annotated_video
from nsdr.world.vocabulary import COLORS_RGB

__all__ = ["write_report"]

MAX_VIDEO_BYTES = 12 * 2**20
"""A larger annotated video is replaced by annotated frames."""
MAX_VIDEO_FRAMES = 600
"""A longer one, too, before it is encoded."""
SHOWN_FRAMES = 6
"""Number of these frames."""
OBSERVED_FRAMES_PER_STEP = 3
"""Maximum number of frames shown beside a step of the trace."""
THUMBNAIL_SIZE_PX = (240, 160)
"""Width and height of these frames."""
HIGHLIGHT_COLOR = (255, 210, 60)
"""Colour of the boxes around a step's objects, RGB."""
HIGHLIGHT_WIDTH_PX = 3
"""Line width of these boxes (pixels of the video)."""
STYLE = """
:root { color-scheme: light dark; --text: #222; --faint: #666; --line: #ddd; --back: #fff; --code: #f4f4f4; --good: #177245;
--bad: #a33 }
@media (prefers-color-scheme: dark) { :root { --text: #ddd; --faint: #999; --line: #444; --back: #1b1b1d; --code: #2a2a2d;
--good: #6cc796; --bad: #e58a8a } }
body { font: 15px/1.5 system-ui, sans-serif; color: var(--text); background: var(--back); max-width: 1060px; margin: 2em auto;
padding: 0 1em }
h1 { font-size: 1.5em } h2 { font-size: 1.15em; margin-top: 2em; border-bottom: 1px solid var(--line) }
h3 { font-size: 1em; margin: 1.2em 0 0 } figure { margin: 0 } figcaption { color: var(--faint); font-size: .85em }
.row { display: grid; grid-template-columns: repeat(auto-fit, minmax(320px, 1fr)); gap: 1em }
img, video { max-width: 100%; border-radius: 4px }
pre { background: var(--code); padding: .8em; overflow-x: auto; font-size: .85em; line-height: 1.35 }
code { background: var(--code); padding: 0 .2em } table { border-collapse: collapse; width: 100% }
td, th { padding: .25em .6em; text-align: left; vertical-align: top; border-top: 1px solid var(--line) }
.answer { font-size: 1.3em } .correct { color: var(--good) } .wrong, .error { color: var(--bad) } td img { width: 150px }
summary { cursor: pointer; color: var(--faint) } .number { text-align: right; width: 4em }
.swatch { display: inline-block; width: 1em; height: 1em; border-radius: 3px; border: 1px solid var(--faint);
vertical-align: -.1em } .metal { background-image: linear-gradient(135deg, #fff8, #fff0 50%) }
"""


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
        DataError: matplotlib is missing.
    """
    scene, dynamics = perception.scene, perception.dynamics
    title = html.escape(answers[0].question if len(answers) == 1 else "What was seen in the video")
    body = [f"<h1>{title}</h1>", *(_summary(answer, len(answers) > 1) for answer in answers)]
    if frames is not None and perception.tracks is not None:
        body += ["<h2>Video</h2>", _video(frames, perception)]
    body += [
        "<h2>Objects</h2>",
        _objects(scene),
        "<h2>Events</h2>",
        _events(scene, dynamics),
        "<h2>Pictures</h2><div class=row>",
    ]
    if frames is not None and perception.tracks is not None:
        body += _pictures(frames, perception)
    if dynamics is not None:
        caption = "From above: observed trajectories solid, predicted ones dashed."
        body.append(_figure(figure_png(plan_figure(dynamics)), caption))
    body += [_figure(figure_png(causal_figure(scene)), "Causal graph."), "</div>"]
    if dynamics is not None:
        body += ["<h2>Without each object</h2><div class=row>", *_removals(dynamics, answers), "</div>"]
    body += [_answer(answer, perception, frames) for answer in answers]
    head = f"<meta charset=utf-8><meta name=viewport content='width=device-width'><title>NS-DR: {title}</title>"
    page = f"<!doctype html><html lang=en>{head}<style>{STYLE}</style>{''.join(body)}</html>"
    with atomic_path(path) as temporary:
        temporary.write_text(page, encoding="utf-8")


def _video(frames: NDArray[np.uint8], perception: Perception) -> str:
    """The annotated video, or some annotated frames where it cannot be encoded or is too large."""
    assert perception.tracks is not None
    if len(frames) <= MAX_VIDEO_FRAMES and importlib.util.find_spec("av") is not None:
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "annotated.mp4"
            write_annotated_video(file, frames, perception.proposals, perception.tracks, perception.scene)
            content = file.read_bytes()
        if len(content) <= MAX_VIDEO_BYTES:
            source = "data:video/mp4;base64," + base64.b64encode(content).decode()
            caption = "Masks, names and trails in every frame; flashes mark collisions."
            return (
                f"<figure><video controls loop muted src='{source}'></video><figcaption>{caption}</figcaption></figure>"
            )
    shown = np.linspace(0, len(frames) - 1, SHOWN_FRAMES).astype(int).tolist()
    scene = perception.scene
    images = [
        annotated_image(frames[f], f, perception.proposals, perception.tracks, scene) for f in dict.fromkeys(shown)
    ]
    return f"<div class=row>{''.join(_figure(_jpeg(image), '') for image in images)}</div>"


def _objects(scene: Scene) -> str:
    rows = []
    for o in scene.objects:
        seen = np.flatnonzero(scene.visible[o.id])
        frames = f"{seen[0]}\u2013{seen[-1]}" if len(seen) else "never"
        red, green, blue = COLORS_RGB[o.color]
        swatch = f"<span class='swatch {o.material}' style='background-color: rgb({red},{green},{blue})'></span>"
        moving = "not known" if scene.moving is None else _motion(scene.moving[o.id] & scene.visible[o.id])
        rows.append(f"<tr><td class=number>{o.id}<td>{swatch} {o.name}<td>{frames}<td>{moving}")
    return f"<table><tr><th class=number>object<th>name<th>in frames<th>moves{''.join(rows)}</table>"


def _motion(moving: NDArray[np.bool_]) -> str:
    """Frames of the first and last motion."""
    frames = np.flatnonzero(moving)
    return f"in frames {frames[0]}\u2013{frames[-1]}" if len(frames) else "never"


def _events(scene: Scene, dynamics: DynamicsPrediction | None) -> str:
    def row(event: Event, about: str) -> str:
        return f"<tr><td class=number>{about}{event.frame}<td>{html.escape(event_text(event, scene, dynamics))}"

    rows = [row(event, "") for event in scene.events] or ["<tr><td><td>nothing happens"]
    if scene.unseen is not None:
        rows.append("<tr><td><td><b>Predicted after the video</b>")
        rows += [row(event, "about ") for event in scene.unseen] or ["<tr><td><td>nothing"]
    return f"<table><tr><th class=number>frame<th>event{''.join(rows)}</table>"


def _pictures(frames: NDArray[np.uint8], perception: Perception) -> list[str]:
    assert perception.tracks is not None
    last = len(frames) - 1
    image = annotated_image(frames[last], last, perception.proposals, perception.tracks, perception.scene)
    figures = [_figure(_jpeg(image), "Frame parser and tracker: masks, ids and trails; stars mark collisions.")]
    if perception.proposals is not None:
        strobe = stroboscopic_image(frames, perception.proposals, perception.tracks, EVERY)
        caption = f"The video as a stroboscopic image: one copy every {EVERY} frames."
        figures.insert(0, _figure(_jpeg(strobe), caption))
    return figures


def _removals(dynamics: DynamicsPrediction, answers: Sequence[Answer]) -> list[str]:
    """The plan without each object that the questions remove, or without each of all."""
    chosen = sorted((_removed_objects(answers) or set(dynamics.counterfactual)) & set(dynamics.counterfactual))
    return [
        _figure(figure_png(plan_figure(dynamics, i)), f"Without the {dynamics.objects[i].name}; gray: with it.")
        for i in chosen
    ]


def _removed_objects(answers: Sequence[Answer]) -> set[int]:
    """Ids of the objects that the questions remove."""
    traces = [t for a in answers for t in ([c.trace for c in a.choices] or [a.trace])]
    removed = set()
    for trace in traces:
        for step in trace:
            if step.module == "get_counterfact":
                removed |= set(trace[step.inputs[1]].objects)
    return removed


def _summary(answer: Answer, named: bool) -> str:
    """The answer, or a table of the choices; after the question, if it is to be named."""
    question = f"<p>{html.escape(answer.question)}</p>" if named else ""
    if answer.answer is not None:
        said = html.escape(answer.answer).replace("\n", "<br>")
        return f"{question}<p class=answer>Answer: <b>{said}</b>{html.escape(format_probability(answer))}</p>"
    rows = (
        f"<tr class={c.answer or 'error'}><td>{c.answer or 'error'}{html.escape(format_probability(c))}"
        f"<td>{html.escape(c.choice)}" + (f"<br>{html.escape(c.error)}" if c.error else "")
        for c in answer.choices
    )
    return f"{question}<table>{''.join(rows)}</table>"


def _answer(answer: Answer, perception: Perception, frames: NDArray[np.uint8] | None) -> str:
    parts = [f"<h2>Why: {html.escape(answer.question)}</h2>"]
    parts.append(f"<p>Program: <code>{html.escape(' '.join(answer.program))}</code></p>")
    scene = perception.scene
    if answer.answer is not None:
        parts.append(f"<p>{html.escape(explain(answer, scene))}</p>" + _trace(answer.trace, perception, frames))
    for choice in answer.choices:
        parts.append(
            f"<h3 class={choice.answer or 'error'}>{html.escape(choice.choice)}: {choice.answer or 'error'}</h3>"
        )
        if choice.error:
            parts.append(f"<p>{html.escape(choice.error)}</p>")
        else:
            parts.append(f"<p>{html.escape(explain(choice, scene))}</p>" + _trace(choice.trace, perception, frames))
    return "".join(parts)


def _trace(trace: Sequence[TraceStep], perception: Perception, frames: NDArray[np.uint8] | None) -> str:
    """The steps, collapsed; words such as `cube` are no steps but stand among the inputs."""
    is_word = [not step.inputs and step.module == step.text for step in trace]
    numbers = np.cumsum([not word for word in is_word]).tolist()
    rows = []
    for index, step in enumerate(trace):
        if is_word[index]:
            continue
        inputs = ", ".join(trace[i].text if is_word[i] else str(numbers[i]) for i in step.inputs)
        observed = sorted({e.frame for e in step.events if e in perception.scene.events})[:OBSERVED_FRAMES_PER_STEP]
        shown = observed if frames is not None and perception.tracks is not None else []
        images = "".join(f"<img alt='frame {f}' src='{_thumbnail(frames[f], perception, step, f)}'>" for f in shown)  # type: ignore[index]
        call = f"<code>{step.module}</code>{f' ({inputs})' if inputs else ''}"
        rows.append(f"<tr><td class=number>{numbers[index]}<td>{call}<td>{html.escape(step.text)}<td>{images}")
    tree = html.escape(format_tree(trace))
    head = "<tr><th class=number>step<th>module (inputs)<th>result<th>frames of its events"
    table = f"<details><summary>{len(rows)} steps</summary><table>{head}{''.join(rows)}</table></details>"
    return f"{table}<details><summary>program tree</summary><pre>{tree}</pre></details>"


def _thumbnail(frame: NDArray[np.uint8], perception: Perception, step: TraceStep, frame_index: int) -> str:
    """A small copy of the frame as a data URI, with boxes around the objects of the step's events in this frame."""
    image = frame.copy()
    assert perception.tracks is not None
    for i in {i for e in step.events if e.frame == frame_index for i in e.objects}:
        track = perception.tracks.tracks[i]
        box = track.box_xyxy_px[int(np.abs(track.frame_index - frame_index).argmin())].tolist()
        cv2.rectangle(image, box[:2], box[2:], HIGHLIGHT_COLOR, HIGHLIGHT_WIDTH_PX)
    return _data_uri(_jpeg(cv2.resize(image, THUMBNAIL_SIZE_PX, interpolation=cv2.INTER_AREA)))


def _jpeg(image: Any) -> bytes:
    """An RGB image as the bytes of a JPEG file, which is a tenth of a PNG's size for frames."""
    return bytes(cv2.imencode(".jpg", image[..., ::-1])[1])


def _data_uri(image: bytes) -> str:
    kind = "png" if image.startswith(b"\x89PNG") else "jpeg"
    return f"data:image/{kind};base64," + base64.b64encode(image).decode()


def _figure(image: bytes, caption: str) -> str:
    text = html.escape(caption)
    return f"<figure><img alt='{text}' src='{_data_uri(image)}'><figcaption>{text}</figcaption></figure>"
