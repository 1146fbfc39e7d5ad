"""What the page shows as HTML: the answer with the frames it rests on, what differs in a simulation, and the style sheet."""

import html
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from nsdr.apps.clips import Clip
from nsdr.types import Answer, ChoiceAnswer, Scene, Simulation, TraceStep
from nsdr.types.answers import format_probability
from nsdr.visualize.html_parts import notes_html, steps_html, thumbnail, why_html
from nsdr.visualize.violations import VIOLATIONS_STYLE

MAX_FRAMES = 6
"""Frames that are shown beside an answer."""
STYLE = (
    VIOLATIONS_STYLE
    + """
.gradio-container { max-width: 1500px !important }
.panel { line-height: 1.45 } .panel p { margin: .3em 0 } .panel .answer { font-size: 1.25em }
.panel table { border-collapse: collapse; width: 100%; border: 0 !important }
.panel td, .panel th { padding: .2em .5em; text-align: left; vertical-align: top; border: solid #8884 !important;
border-width: 1px 0 0 !important }
.panel pre { overflow-x: auto; font-size: .85em; line-height: 1.35; padding: .6em; background: #8881 }
.panel code { overflow-wrap: anywhere; font-size: .85em } .panel td img { width: 110px }
.panel details { border-top: 1px solid #8884; padding: .25em 0 } .panel details details { padding-left: 1em }
.panel summary { cursor: pointer } .panel ul { margin: .3em 0; padding-left: 1.3em; list-style: disc }
.panel .correct { color: #116236 } .panel .wrong, .panel .error { color: #a33 }
.dark .panel .correct { color: #6cc796 } .dark .panel .wrong, .dark .panel .error { color: #f0a0a0 !important }
.timeline .cards, .panel .cards { display: flex; overflow-x: auto; padding-bottom: 4px }
.cards > button, .cards > div { flex: 0 0 150px }
.violation .cards > div { flex: 1 }
#clips { flex-wrap: nowrap; overflow-x: auto; gap: 8px }
#clips > * { flex: 0 0 auto; min-width: 0; width: 132px; height: 96px; padding: 4px; font-size: 12px; font-weight: 500 }
#clips button { flex-direction: column; gap: 4px; overflow: hidden } #clips img { width: 100%; height: 66px; margin: 0;
object-fit: cover; border-radius: 4px }
#refused:not(:has(.panel)), #answer:not(:has(.panel)), #difference:not(:has(.panel)) { display: none }
.gradio-container { overflow: clip !important; --color-accent: #4338ca; --button-primary-background-fill: #4338ca;
--button-primary-background-fill-hover: #3730a3; --button-primary-border-color: transparent }
.gradio-container.dark, .dark .gradio-container { --color-accent: #a5b4fc }
.gradio-container .max_value, .gradio-container .min_value { color: inherit }
#columns { align-items: flex-start } #seen > * { flex: none }
@media (min-width: 768px) { #seen { position: sticky; top: 8px; max-height: calc(100vh - 16px); overflow-y: auto;
flex-wrap: nowrap } }
@media (max-width: 767px) {
.gradio-container .main { padding: 10px !important }
#columns { flex-direction: column; flex-wrap: nowrap; gap: 10px } #seen { display: contents }
#columns > *, #seen > * { width: 100%; flex: none } #seen > * { order: 2 }
#tracks { order: 0; position: sticky; top: 0; z-index: 5 } #asking { order: 1 } }
"""
)
"""Style sheet of the page. On a wide window, the left column stays in view; on a narrow one, the video does."""


def answer_panel(answer: Answer, clip: Clip) -> str:
    """The answer in one line with its probability; the frames it rests on, explanation, steps and program tree are folded.

    Of a multiple-choice question, each choice is such a line.
    """
    frames, scene = clip.frames(), clip.perception.scene
    notes = notes_html(answer.notes, scene.notes)
    correct = [c for c in answer.choices if c.answer == "correct"]
    if not answer.is_multiple_choice:
        head = _said(answer.text, answer)
    elif len(correct) == 1:
        head = _said(correct[0].choice, correct[0])
    else:
        head = f"<b>{len(correct) or 'None'} of the {len(answer.choices)} choices are correct</b>"
    lines = [_choice(choice, clip, frames) for choice in answer.choices]
    if not answer.is_multiple_choice:
        lines.insert(0, f"<details><summary>Why</summary>{_why(answer, clip, frames)}</details>")
    return f"<div class=panel><p class=answer>{head}</p>{notes}{''.join(lines)}</div>"


def _said(text: str, judged: Answer | ChoiceAnswer) -> str:
    """The answer in bold; one that is told in several lines begins below "Answer:"."""
    lines = html.escape(text).split("\n")
    start = "<br>" if len(lines) > 1 else ""
    return f"Answer: {start}<b>{'<br>'.join(lines)}</b>{html.escape(format_probability(judged))}"


def _choice(choice: ChoiceAnswer, clip: Clip, frames: NDArray[np.uint8]) -> str:
    """A choice that unfolds: its sign and text with the probability, and why."""
    verdict = choice.answer or "error"
    sign = {"correct": "✓", "wrong": "✗"}.get(verdict, "?")
    line = f"{sign} {verdict}{format_probability(choice)}: {choice.choice}"
    why = f"<p>{html.escape(choice.error)}</p>" if choice.error else _why(choice, clip, frames)
    return f"<details><summary class={verdict}>{html.escape(line)}</summary>{why}</details>"


def _why(judged: Answer | ChoiceAnswer, clip: Clip, frames: NDArray[np.uint8]) -> str:
    if not judged.trace:
        return ""
    p, program = clip.perception, html.escape(" ".join(judged.program))
    steps = steps_html(judged.trace, p, frames)
    folded = f"<details><summary>program</summary><code>{program}</code></details>"
    return f"{why_html(judged, p.scene)}{_frames(judged, clip, frames)}{steps}{folded}"


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


def _frames(judged: Answer | ChoiceAnswer, clip: Clip, frames: NDArray[np.uint8]) -> str:
    found, tracks = rests_on(judged.trace, clip.perception.scene), clip.perception.tracks
    if not found or tracks is None:
        return ""
    cards = []
    for f, objects in sorted(found.items())[:MAX_FRAMES]:
        names = html.escape(", ".join(tracks.tracks[i].object.name for i in objects))
        image = thumbnail(frames[f], f, tracks, objects)
        cards.append(f"<div><img alt='frame {f}' src='{image}'><b>frame {f}</b>{names}</div>")
    return f"<div class=cards tabindex=0 role=group aria-label='frames it rests on'>{''.join(cards)}</div>"


def difference_panel(simulation: Simulation, clip: Clip) -> str:
    """What was changed in a clip, and what happens differently, with probabilities."""
    lines = [f"<li>{html.escape(simulation.describe(change))}" for change in simulation.differences()]
    what = "".join(lines) or "<li>nothing else changes"
    head = html.escape(simulation.heading)
    notes = notes_html(simulation.notes, known=clip.perception.scene.notes)
    return f"<div class=panel><p><b>{head[:1].upper()}{head[1:]}</b></p><ul>{what}</ul>{notes}</div>"


def notes_panel(clip: Clip) -> str:
    """Name and length of the clip, and what is uncertain about it, as Markdown."""
    scene = clip.perception.scene
    head = f"**{clip.path.name}**: {scene.n_frames} frames, {len(scene.objects)} objects"
    return "\n\n".join([head, *(f"Note: {note}" for note in scene.notes)])


def refusal_panel(reason: str) -> str:
    """Why something is refused."""
    return f"<div class=panel><p class=error role=alert>{html.escape(reason)}</p></div>"
