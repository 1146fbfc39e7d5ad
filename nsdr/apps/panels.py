"""What the page shows as HTML: the answer with the frames it rests on, what differs in a simulation, and the style sheet."""

import html
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from nsdr.apps.clips import Clip
from nsdr.types import Answer, Scene, Simulation, TraceStep
from nsdr.visualize.event_words import change_text, interventions_text
from nsdr.visualize.html_parts import answer_html, notes_html, summary_html, thumbnail
from nsdr.visualize.violations import VIOLATIONS_STYLE

MAX_FRAMES = 6
"""Frames that are shown beside an answer."""
STYLE = (
    VIOLATIONS_STYLE
    + """
.gradio-container { max-width: 1500px !important }
.panel { line-height: 1.45 } .panel .answer { font-size: 1.3em; margin: .2em 0 } .panel h2 { display: none }
.panel h3 { font-size: 1em; margin: .8em 0 .1em }
.panel table { border-collapse: collapse; width: 100%; border: 0 !important }
.panel td, .panel th { padding: .2em .5em; text-align: left; vertical-align: top; border: solid #8884 !important;
border-width: 1px 0 0 !important }
.panel tr.correct td:first-child, .panel tr.wrong td:first-child, .panel tr.error td:first-child { white-space: nowrap;
color: inherit }
.panel pre { overflow-x: auto; font-size: .85em; line-height: 1.35; padding: .6em; background: #8881 }
.panel code { overflow-wrap: anywhere; font-size: .85em } .panel td img { width: 110px }
.panel .note { opacity: .75 } .panel summary { cursor: pointer; opacity: .7 }
.panel .correct { color: #177245 } .panel .wrong, .panel .error { color: #a33 }
.dark .panel .correct { color: #6cc796 } .dark .panel .wrong, .dark .panel .error { color: #e58a8a }
.panel .cards > div { padding: 4px }
"""
)
"""Style sheet of the page."""


def answer_panel(answer: Answer, clip: Clip) -> str:
    """Answer and probability or the judged choices, the frames it rests on, and why: explanation, steps and program tree."""
    frames = clip.frames()
    shown = _frames(answer, clip, frames)
    why = answer_html(answer, clip.perception, frames)
    summary = summary_html(answer, named=True, known=clip.perception.scene.notes)
    return f"<div class=panel>{summary}{shown}{why}</div>"


def rests_on(trace: Sequence[TraceStep], scene: Scene) -> dict[int, tuple[int, ...]]:
    """The frames of the video that an answer is based on, each with the ids of the objects that it is about.

    These are the frames of the last step that returns events or a frame. If no step does, it is the middle frame of the video.
    """
    objects = next((step.objects for step in reversed(trace) if step.objects), ())
    for step in reversed(trace):
        observed = [event for event in step.events if event in scene.events]
        if observed:
            return {event.frame: event.objects for event in observed}
        if step.kind == "frame" and step.value is not None:
            return {min(int(step.value), scene.n_frames - 1): objects}
    return {scene.n_frames // 2: objects} if objects else {}


def _frames(answer: Answer, clip: Clip, frames: NDArray[np.uint8]) -> str:
    traces = [answer.trace] if answer.trace else [c.trace for c in answer.choices if c.answer == "correct"]
    found: dict[int, tuple[int, ...]] = {}
    for trace in traces:
        found |= rests_on(trace, clip.perception.scene)
    tracks = clip.perception.tracks
    if not found or tracks is None:
        return ""
    cards = []
    for f, objects in sorted(found.items())[:MAX_FRAMES]:
        names = html.escape(", ".join(tracks.tracks[i].object.name for i in objects))
        image = thumbnail(frames[f], f, tracks, objects)
        cards.append(f"<div><img alt='frame {f}' src='{image}'><b>frame {f}</b>{names}</div>")
    return f"<div class=cards>{''.join(cards)}</div>"


def difference_panel(simulation: Simulation, clip: Clip) -> str:
    """What was changed in a clip, and what happens differently, with probabilities."""
    lines = [f"<li>{html.escape(change_text(simulation, change))}" for change in simulation.differences()]
    what = "".join(lines) or "<li>nothing else changes"
    head = html.escape(interventions_text(simulation))
    notes = notes_html(simulation.notes, known=clip.perception.scene.notes)
    return f"<div class=panel><p><b>{head[:1].upper()}{head[1:]}</b></p><ul>{what}</ul>{notes}</div>"


def notes_panel(clip: Clip) -> str:
    """Name and length of the clip, and what is uncertain about it, as Markdown."""
    scene = clip.perception.scene
    head = f"**{clip.path.name}**: {scene.n_frames} frames, {len(scene.objects)} objects"
    return "\n\n".join([head, *(f"Note: {note}" for note in scene.notes)])
