"""Events in words, and answers of several lines: what happens, one event in each line, and what there is to see."""

from collections.abc import Sequence

from nsdr.types import Event, Scene
from nsdr.types.events import event_sentence
from nsdr.types.simulations import compared, event_details


def event_lines(scene: Scene, events: Sequence[Event]) -> list[str]:
    """Each event of the video, or after it, as a line, such as "the red metal cube exits (about frame 140, 84 %)".

    Events that are uncertain in the scene have a probability.
    """
    probability = {u.event: u.probability for u in scene.uncertain or () if u.removed is None}
    return [_line(scene, event, probability.get(event)) for event in events]


def lines_without(scene: Scene, removed: int, events: Sequence[Event]) -> list[str]:
    """How the events without an object compare with those of the video and what follows it, in order of time.

    Each line begins with "still", "new" or "other frame"; what happens with the object only is there as "no longer". Events of
    the object itself are left out.

    Args:
        scene: the scene.
        removed: id of the object.
        events: all that happen without it.
    """
    probability = {u.event: u.probability for u in scene.uncertain or () if u.removed == removed}
    with_it = [e for e in (*scene.events, *(scene.predicted or ())) if removed not in e.objects]
    if scene.collisions_only:
        with_it = [e for e in with_it if e.kind == "collision"]
    lines = []
    for kind, event, frame in compared(with_it, events):
        p = None if kind == "no longer" else probability.get(event)
        lines.append(f"{kind}: {_line(scene, event, p, frame if kind == 'other frame' else None)}")
    return lines


def description(scene: Scene, objects: Sequence[int], events: Sequence[Event]) -> str:
    """Objects of a scene in one line, and events in one line each."""
    names = [f"the {scene.objects[i].name}" for i in objects]
    count = f"{len(names)} object{'' if len(names) == 1 else 's'}"
    return "\n".join([f"{count}: {', '.join(names)}" if names else count, *event_lines(scene, events)])


def _line(scene: Scene, event: Event, probability: float | None = None, instead_of: int | None = None) -> str:
    text = event_sentence(event, [f"the {o.name}" for o in scene.objects], event_details(instead_of, probability))
    return text if event.frame < scene.n_frames else text.replace("(frame", "(about frame")
