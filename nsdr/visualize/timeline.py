"""The timeline of a video as HTML: a lane for each object, a mark for each event, and the frame of each event."""

import html
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from nsdr.pipeline import Perception
from nsdr.symbolic.causal import direct_causes
from nsdr.types import Event, Rollout, Scene, SceneObject
from nsdr.types.answers import percent
from nsdr.types.events import event_phrase
from nsdr.visualize.html_parts import data_uri, jpeg, thumbnail
from nsdr.visualize.plan_frames import draw_plan
from nsdr.world.vocabulary import Vocabulary
from nsdr.world.world import World

LABEL_WIDTH, LANE_WIDTH, LANE_HEIGHT, AXIS_HEIGHT = 170, 550, 24, 24
"""Sizes of the drawing (units of its view box)."""
HEAD_LENGTH = 6
"""Length of the head of an arrow, and from its tip to the event's place (units of the view box)."""
CARD_WIDTH_PX = 360
"""Width of the pictures of events (pixels): twice of what is shown, for dense screens."""
TIMELINE_STYLE = """
.timeline svg { width: 100%; height: auto; font: 12px system-ui, sans-serif; display: block }
.timeline text { fill: currentColor }
.timeline .axis { stroke: currentColor; opacity: .25 } .timeline .later { fill: currentColor; opacity: .07 }
.timeline .event { cursor: pointer; outline: none } .timeline .event line { stroke: currentColor; stroke-width: 1.5 }
.timeline .event circle, .timeline .event path { fill: #ffd23c; stroke: #333; stroke-width: 1 }
.timeline .hit { fill: transparent } .timeline .cause { fill: none; stroke: #d3294b; opacity: .8 }
.timeline .head { fill: #d3294b }
.timeline .event:hover line, .timeline .event:focus line { stroke-width: 4 }
.cards { display: grid; grid-template-columns: repeat(auto-fill, minmax(150px, 1fr)); gap: .6em; margin-top: .6em;
align-items: start; font: 12px/1.35 system-ui, sans-serif }
.cards button { all: unset; cursor: pointer; border: 2px solid transparent;
border-radius: 6px; padding: 2px }
.cards button.marked, .cards button:hover, .cards button:focus { border-color: #ffb300 }
.cards img { width: 100%; display: block; border-radius: 4px } .cards b { display: block }
"""
"""Style sheet of the timeline and its cards."""


def timeline_html(perception: Perception, frames: NDArray[np.uint8] | None, video: str) -> str:
    """Lanes that show when each object is in the image (light) and moves (strong), marks of the events, and their pictures.

    An arrow leads from each event to those that it directly causes. What is predicted to follow the video lies on a grey
    ground. Pointing at a mark outlines its picture.

    Args:
        perception: of a video.
        frames: (T, height, width, 3) uint8 RGB of it, for the pictures; None leaves these out.
        video: CSS selector of the page's video, which a click on an event moves to its frame.
    """
    scene = perception.scene
    events = [*scene.events, *(scene.predicted or ())]
    end = scene.world.timeline.horizon_frame(scene.n_frames)
    marks = _arrows(events, end)
    marks += "".join(_mark(event, number, perception, video) for number, event in enumerate(events))
    moving = None if scene.moving is None else scene.moving & scene.visible
    lanes = lanes_html(scene.objects, scene.visible, moving, end, marks, "events", scene.world)
    return f"<div class=timeline>{lanes}{_event_cards(perception, frames, video)}</div>"


def lanes_html(
    objects: Sequence[SceneObject],
    visible: NDArray[np.bool_],
    moving: NDArray[np.bool_] | None,
    end: int,
    marks: str,
    what: str,
    world: World,
) -> str:
    """The drawing of a timeline: an axis, a lane for each object, and what is marked in them.

    Args:
        objects: in the order of their ids.
        visible: (n_objects, n_frames) bool, whether they are in the image.
        moving: (n_objects, n_frames) bool, whether they move; None shows no motion.
        end: the axis ends before this frame; what is after the video lies on a grey ground.
        marks: SVG elements.
        what: what they mark, in the plural.
        world: the world that the video is of.
    """
    box = f"0 0 {LABEL_WIDTH + LANE_WIDTH} {LANE_HEIGHT * len(objects) + AXIS_HEIGHT}"
    drawn = _axis(len(objects), visible.shape[1], end, world.timeline.fps)
    drawn += _lanes(objects, visible, moving, end, world.vocabulary) + marks
    return f"<svg viewBox='{box}' role=group aria-label='timeline of the {what}'>{drawn}</svg>"


def _event_cards(perception: Perception, frames: NDArray[np.uint8] | None, video: str) -> str:
    """A picture of each event with its frame and words: the frame with boxes, or the ground from above after the video."""
    scene, explanation = perception.scene, perception.explanation
    simulated = None if frames is None or explanation is None else explanation.observed
    cards = []
    for number, event in enumerate([*scene.events, *(scene.predicted or ())]):
        later = event.frame >= scene.n_frames
        text = html.escape(_words(event, scene))
        when = f"about frame {event.frame}, predicted" if later else f"frame {event.frame}"
        click = "" if later else _seek(event.frame, video, scene.world)
        image = event_picture(event, perception, frames, simulated)
        cards.append(f"<button type=button data-event={number}{click}>{image}<b>{when}</b>{text}</button>")
    return f"<div class=cards>{''.join(cards)}</div>"


def frame_x(frame: float, end: int) -> float:
    """Where a frame lies on a timeline that ends before the frame `end` (units of the view box)."""
    return round(LABEL_WIDTH + LANE_WIDTH * min(frame / end, 1), 1)


def _axis(n_objects: int, n_frames: int, end: int, fps: int) -> str:
    """The axis with a number at each second."""
    bottom = LANE_HEIGHT * n_objects
    later = frame_x(n_frames, end)
    parts = [f"<rect class=later x={later} y=0 width={LABEL_WIDTH + LANE_WIDTH - later} height={bottom} />"]
    for frame in range(0, end, fps):
        x = frame_x(frame, end)
        parts.append(f"<line class=axis x1={x} x2={x} y1=0 y2={bottom + 4} />")
        parts.append(f"<text x={x} y={bottom + 17} text-anchor=middle>{frame}</text>")
    parts.append(f"<text x=0 y={bottom + 17}>frame</text>")
    return "".join(parts)


def _lanes(
    objects: Sequence[SceneObject],
    visible: NDArray[np.bool_],
    moving: NDArray[np.bool_] | None,
    end: int,
    vocabulary: Vocabulary,
) -> str:
    parts = []
    still = np.zeros(visible.shape, bool)
    for o in objects:
        red, green, blue = vocabulary.color(o.color).srgb
        y = LANE_HEIGHT * o.id
        parts.append(f"<text x=0 y={y + 16}>{o.id} {html.escape(o.name)}</text>")
        for what, flags, opacity in (
            ("in the image", visible, 0.35),
            ("moves", still if moving is None else moving, 0.95),
        ):
            for first, after in _spans(flags[o.id]):
                x, width = frame_x(first, end), round(frame_x(after, end) - frame_x(first, end), 1)
                style = f"fill='rgb({red},{green},{blue})' opacity={opacity}"
                title = f"<title>{what}: frames {first}\u2013{after - 1}</title>"
                parts.append(f"<rect x={x} y={y + 7} width={width} height=10 rx=3 {style}>{title}</rect>")
    return "".join(parts)


def _spans(flags: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Ranges (first, one after the last) in which flags are set."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(int)))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _mark(event: Event, number: int, perception: Perception, video: str) -> str:
    scene = perception.scene
    x = frame_x(event.frame, scene.world.timeline.horizon_frame(scene.n_frames))
    lanes = [LANE_HEIGHT * i + LANE_HEIGHT / 2 for i in event.objects]
    top, bottom = min(lanes), max(lanes)
    if event.kind == "collision":
        shape = f"<line x1={x} x2={x} y1={top} y2={bottom} />"
        shape += "".join(f"<circle cx={x} cy={y} r=5 />" for y in lanes)
    else:  # an arrow into the lane or out of it
        shape = f"<path d='M{x - 5} {top - 6}L{x + 5} {top}L{x - 5} {top + 6}z' />"
    title = html.escape(f"frame {event.frame}: {_words(event, scene)}")
    point = "this.closest('.timeline').querySelector('[data-event=&quot;%d&quot;]').classList.%s('marked')"
    hover = f' onmouseover="{point % (number, "add")}" onmouseout="{point % (number, "remove")}"'
    click = _seek(event.frame, video, scene.world) if event.frame < scene.n_frames else ""
    area = f"<rect class=hit x={x - 7} y={top - 9} width=14 height={bottom - top + 18} />"
    return f"<g class=event tabindex=0 role=button{hover}{click}><title>{title}</title>{shape}{area}</g>"


def _arrows(events: Sequence[Event], end: int) -> str:
    """Arrows to events, given in order of time, from their direct causes; the timeline ends before the frame `end`."""
    places = [np.array([frame_x(e.frame, end), LANE_HEIGHT * (np.mean(e.objects) + 0.5)]) for e in events]
    parts = []
    for place, causes in zip(places, direct_causes(events), strict=True):
        for start in (places[cause] for cause in causes):
            bend = np.array([(start[0] + place[0]) / 2, min(start[1], place[1]) - LANE_HEIGHT / 2])
            ahead = HEAD_LENGTH * (place - bend) / np.linalg.norm(place - bend)
            tip, back, aside = place - ahead, place - 2 * ahead, ahead[::-1] * [-0.5, 0.5]
            line, head = (
                [" ".join(f"{v:.1f}" for v in point) for point in points]
                for points in ((start, bend, back), (tip, back + aside, back - aside))
            )
            parts.append(f"<path class=cause d='M{line[0]}Q{line[1]} {line[2]}' />")
            parts.append(f"<path class=head d='M{head[0]}L{head[1]}L{head[2]}z' />")
    return "".join(parts)


def _seek(frame: int, video: str, world: World) -> str:
    """An attribute that moves the video to a frame."""
    return f' onclick="{seek_script(frame, video, world.timeline.fps)}"'


def seek_script(frame: int, video: str, fps: int) -> str:
    """JavaScript for an attribute in double quotes that moves the video of a CSS selector to a frame."""
    seconds = (frame + 0.5) / fps
    move = f"v.pause();v.currentTime={seconds:.2f};v.scrollIntoView({{block:&quot;nearest&quot;}})"
    return f"const v=document.querySelector('{video}');if(v){{{move}}}"


def _words(event: Event, scene: Scene) -> str:
    """An event in words; one that is uncertain with how probable it is: "the red cube and the blue sphere collide (77 %)"."""
    known = [d.probability for d in scene.uncertain or () if d.removed is None and d.event == event]
    return event_phrase(event, [f"the {o.name}" for o in scene.objects]) + (f" ({percent(known[0])})" if known else "")


def event_picture(
    event: Event,
    perception: Perception,
    frames: NDArray[np.uint8] | None,
    simulated: Rollout | None,
) -> str:
    """The frame of an event with boxes around its objects; without that frame, the ground from above; "" without both.

    Args:
        event: one of the video, or of what is simulated.
        perception: of the video.
        frames: (T, height, width, 3) uint8 RGB of it; None leaves these out.
        simulated: what is drawn from above; None leaves it out.
    """
    if frames is not None and perception.tracks is not None and event.frame < len(frames):
        source = thumbnail(frames[event.frame], event.frame, perception.tracks, event.objects, CARD_WIDTH_PX)
    elif simulated is not None:
        source = data_uri(jpeg(draw_plan(perception.scene.objects, simulated, event.frame, perception.scene.world)))
    else:
        return ""
    return f"<img alt='frame {event.frame}' src='{source}'>"
