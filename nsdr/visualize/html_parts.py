"""What reports and the page to ask on share: answers, steps of a trace, pictures, and how a report looks."""

import base64
import html
from collections.abc import Collection, Iterable, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from nsdr.claims.narration import reasons
from nsdr.io.files import write_file
from nsdr.pipeline import Perception
from nsdr.symbolic import format_tree
from nsdr.types import Answer, ChoiceAnswer, Scene, TraceStep, VideoTracks
from nsdr.types.answers import format_probability

OBSERVED_FRAMES_PER_STEP = 3
"""Maximum number of frames shown beside a step of the trace."""
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
.note { color: var(--faint) }
h1 { font-size: 1.5em } h2 { font-size: 1.15em; margin-top: 2em; border-bottom: 1px solid var(--line) }
h3 { font-size: 1em; margin: 1.2em 0 0 } figure { margin: 0 } figcaption { color: var(--faint); font-size: .85em }
.row { display: grid; grid-template-columns: repeat(auto-fill, minmax(320px, 1fr)); gap: 1em } .row img { width: 100% }
.row ul { margin: .4em 0; padding-left: 1.2em; font-size: .9em }
img, video { max-width: 100%; border-radius: 4px }
pre { background: var(--code); padding: .8em; overflow-x: auto; font-size: .85em; line-height: 1.35 }
code { background: var(--code); padding: 0 .2em } table { border-collapse: collapse; width: 100% }
td, th { padding: .25em .6em; text-align: left; vertical-align: top; border-top: 1px solid var(--line) }
.answer { font-size: 1.3em } .correct { color: var(--good) } .wrong, .error { color: var(--bad) } td img { width: 150px }
tr.correct td:first-child, tr.wrong td:first-child { white-space: nowrap; width: 9em }
summary { cursor: pointer; color: var(--faint) } .number { text-align: right; width: 4em }
"""
"""Style sheet of reports."""


def notes_html(notes: Iterable[str], known: Collection[str] = ()) -> str:
    """Notes, each on a line of its own, but for those that are `known` because the page shows them elsewhere."""
    return "".join(f"<p class=note>Note: {html.escape(note)}</p>" for note in notes if note not in known)


def summary_html(answer: Answer, named: bool, scene: Scene) -> str:
    """The answer with its probability, or a table of the choices and the reason for each; after the question, if it is `named`.

    Its notes follow, but for those of its scene.
    """
    question = f"<p>{html.escape(answer.question)}</p>" if named else ""
    if not answer.is_multiple_choice:
        said = html.escape(answer.text).replace("\n", "<br>")
        question += f"<p class=answer>Answer: <b>{said}</b>{html.escape(format_probability(answer))}</p>"
    rows = (
        f"<tr class={c.answer or 'error'}><td>{c.answer or 'error'}{html.escape(format_probability(c))}"
        f"<td>{html.escape(c.choice)}<br><small>{html.escape(c.error or _reason(c, scene))}</small>"
        for c in answer.choices
    )
    table = f"<table>{''.join(rows)}</table>" if answer.choices else ""
    return question + table + notes_html(answer.notes, scene.notes)


def answer_html(answer: Answer, perception: Perception, frames: NDArray[np.uint8] | None) -> str:
    """Why a question got its answer: program, explanation, and every step with the frames of its events.

    Args:
        answer: with its trace or those of its choices.
        perception: of the video.
        frames: (T, height, width, 3) uint8 RGB of it; None leaves out the frames.
    """
    parts = [f"<h2>Why: {html.escape(answer.question)}</h2>"]
    parts.append(f"<p>Program: <code>{html.escape(' '.join(answer.program))}</code></p>")
    if not answer.is_multiple_choice:
        parts.append(
            why_html(answer, perception.scene) + steps_html(answer.trace, perception, frames, unfolded=" open")
        )
        return "".join(parts)
    for choice in answer.choices:
        parts.append(
            f"<h3 class={choice.answer or 'error'}>{html.escape(choice.choice)}: {choice.answer or 'error'}</h3>"
        )
        if choice.error:
            parts.append(f"<p>{html.escape(choice.error)}</p>")
        else:
            parts.append(why_html(choice, perception.scene) + steps_html(choice.trace, perception, frames))
    return "".join(parts)


def _reason(choice: ChoiceAnswer, scene: Scene) -> str:
    """The last sentence of a choice's explanation, which says why it is correct or wrong; "" for a candidate."""
    return reasons(choice, scene)[-1] if choice.trace else ""


def why_html(answer: Answer | ChoiceAnswer, scene: Scene) -> str:
    """The explanation in sentences, those about what happens without an object first."""
    sentences = sorted(reasons(answer, scene), key=lambda sentence: not sentence.startswith("Without "))
    return f"<p>{'<br>'.join(map(html.escape, sentences))}</p>"


def steps_html(
    trace: Sequence[TraceStep], perception: Perception, frames: NDArray[np.uint8] | None, unfolded: str = ""
) -> str:
    """The steps, collapsed, and the program tree; words such as `cube` are no steps but stand among the inputs.

    Args:
        trace: the executed steps.
        perception: where the events of the steps are found.
        frames: (F, height, width, 3) uint8 RGB frames for pictures of events; None for no pictures.
        unfolded: " open" to show the steps unfolded.
    """
    is_word = [not step.inputs and step.module == step.text for step in trace]
    numbers = np.cumsum([not word for word in is_word]).tolist()
    rows = []
    for index, step in enumerate(trace):
        if is_word[index]:
            continue
        inputs = ", ".join(trace[i].text if is_word[i] else str(numbers[i]) for i in step.inputs)
        images = _images(step, perception, frames)
        call = f"<code>{step.module}</code>{f' ({inputs})' if inputs else ''}"
        rows.append(f"<tr><td class=number>{numbers[index]}<td>{call}<td>{html.escape(step.text)}<td>{images}")
    tree = html.escape(format_tree(trace))
    head = "<tr><th class=number>step<th>module (inputs)<th>result<th>frames of its events"
    table = f"<details><summary>{len(rows)} steps</summary><table>{head}{''.join(rows)}</table></details>"
    return f"{table}<details{unfolded}><summary>program tree</summary><pre>{tree}</pre></details>"


def _images(step: TraceStep, perception: Perception, frames: NDArray[np.uint8] | None) -> str:
    """The first frames of a step's observed events, with boxes around who takes part."""
    if frames is None or perception.tracks is None:
        return ""
    observed = [e for e in step.events if e in perception.scene.events]
    images = []
    for f in sorted({e.frame for e in observed})[:OBSERVED_FRAMES_PER_STEP]:
        objects = {i for e in observed if e.frame == f for i in e.objects}
        images.append(f"<img alt='frame {f}' src='{thumbnail(frames[f], f, perception.tracks, objects)}'>")
    return "".join(images)


def thumbnail(
    frame: NDArray[np.uint8], frame_index: int, tracks: VideoTracks, objects: Iterable[int], width_px: int = 480
) -> str:
    """A small copy of a frame as a data URI, with boxes around objects.

    Args:
        frame: (height, width, 3) uint8 RGB.
        frame_index: the frame's index in the video.
        tracks: where the objects are.
        objects: ids of those that get a box: a thin one, at the nearest place, where they are not seen in the frame.
        width_px: of the copy (pixels).
    """
    image = frame.copy()
    for i in objects:
        track = tracks.tracks[i]
        nearest = int(np.abs(track.frame_index - frame_index).argmin())
        box = track.box_xyxy_px[nearest].tolist()
        width_of_line = HIGHLIGHT_WIDTH_PX if track.frame_index[nearest] == frame_index else 1
        cv2.rectangle(image, box[:2], box[2:], HIGHLIGHT_COLOR, width_of_line)
    size = (width_px, width_px * frame.shape[0] // frame.shape[1])
    return data_uri(jpeg(cv2.resize(image, size, interpolation=cv2.INTER_AREA)))


def jpeg(image: Any) -> bytes:
    """An RGB image as the bytes of a JPEG file, which is a tenth of a PNG's size for frames."""
    return bytes(cv2.imencode(".jpg", image[..., ::-1])[1])


def data_uri(image: bytes) -> str:
    """A PNG or JPEG file as a URI that holds it."""
    kind = "png" if image.startswith(b"\x89PNG") else "jpeg"
    return f"data:image/{kind};base64," + base64.b64encode(image).decode()


def video_html(mp4: bytes) -> str:
    """A player of an mp4 file, which it holds."""
    source = "data:video/mp4;base64," + base64.b64encode(mp4).decode()
    return f"<video controls loop muted src='{source}'></video>"


def figure_html(image: bytes, caption: str) -> str:
    """A PNG or JPEG file with its caption, which is escaped."""
    text = html.escape(caption)
    return f"<figure><img alt='{text}' src='{data_uri(image)}'><figcaption>{text}</figcaption></figure>"


def write_page(path: str | Path, title: str, body: str, style: str) -> None:
    """Write an HTML page that needs no other file and no network.

    Args:
        path: HTML file to write.
        title: text, which is escaped.
        body: HTML.
        style: style sheet of parts of the body, beside that of reports.
    """
    head = f"<meta charset=utf-8><meta name=viewport content='width=device-width'><title>NS-DR: {html.escape(title)}</title>"
    page = f"<!doctype html><html lang=en>{head}<style>{STYLE}{style}</style>{body}</html>"
    write_file(path, page)
