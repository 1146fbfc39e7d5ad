"""Two meanings of "responsible": part of what led to an event, and needed for it.

- `chain`, CLEVRER's own: an object or event is responsible for an event if a chain of collisions, entrances and exits leads
  from it to that event (paper, section 3.3).
- `but_for`: it is responsible if the event would not have happened without it, as the scene's counterfactuals say.

They disagree where a chain was not needed (a push that changed nothing), and where an object led to nothing but kept another
one away.
"""

from collections.abc import Mapping, Sequence

from nsdr.clevrer.files.scenes import enter_exit_events
from nsdr.errors import ExecutionError
from nsdr.symbolic.causal import ancestor_sets
from nsdr.types import Event, Scene, TraceStep

__all__ = ["MEANINGS", "but_for", "check_meaning", "judgements"]

MEANINGS = ("chain", "but_for")
"""What "responsible" can mean."""
SAME_FRAMES = 1
"""A collision at this distance (frames) is the same one: where a contact falls between two frames is a matter of rounding."""


def check_meaning(meaning: str) -> None:
    """Raise an `ExecutionError` unless it is one of `MEANINGS`."""
    if meaning not in MEANINGS:
        raise ExecutionError(f"unknown meaning of responsible {meaning!r}; expected {' or '.join(MEANINGS)}")


def but_for(scene: Scene, target: Event, candidate: Event | int) -> bool | None:
    """Whether an event would not have happened without an object, or without another event.

    An event is taken away with one of its objects: without a collision of A and B, the target happens if it happens without A,
    or without B. Where A takes part in other collisions before the target, too, it is not known which of them was needed.

    Args:
        scene: with counterfactuals.
        target: observed event. A collision happens without an object if the two collide at any frame.
        candidate: id of an object, or an event.

    Returns:
        None where it is not known: the scene lacks the counterfactual, the motion in it, or objects to take an event away with.
    """
    if isinstance(candidate, Event):
        return _needs_event(scene, target, candidate)
    if candidate in target.objects:
        return True
    without = (scene.counterfactual or {}).get(candidate)
    if without is None:
        return None
    if target.kind == "collision":
        return not any(e.objects == target.objects for e in without)
    if _same(_history(scene.events, target), _history(without, target)):
        return False
    return _needs_for_border(scene, target, candidate)


def judgements(trace: Sequence[TraceStep], scene: Scene) -> Mapping[str, bool | None]:
    """Whether a choice of an explanatory question is right, by each of `MEANINGS`; None where that is not known.

    Args:
        trace: of the judged choice, which ends in `belong_to` of `filter_ancestor`, negated or not.
        scene: of the question.

    Returns:
        Nothing for traces of other questions, and for scenes without counterfactuals.
    """
    negated = bool(trace) and trace[-1].module == "negate"
    last = trace[trace[-1].inputs[0] if negated else -1] if trace else None
    if last is None or last.module != "belong_to" or scene.counterfactual is None:
        return {}
    chosen, group = (trace[i] for i in last.inputs)
    if group.module != "filter_ancestor":
        return {}
    needed = but_for(scene, trace[group.inputs[1]].value, chosen.value)
    return {"chain": bool(last.value) != negated, "but_for": None if needed is None else needed != negated}


def _needs_event(scene: Scene, target: Event, candidate: Event) -> bool | None:
    same = (candidate.kind, candidate.objects)
    earlier = [e for e in scene.events if e.frame < target.frame and (e.kind, e.objects) == same]
    if not earlier or same == (target.kind, target.objects):
        return False
    if candidate.kind == "in":
        return but_for(scene, target, candidate.objects[0])
    others = [i for i in candidate.objects if i not in target.objects]
    if candidate.kind == "out" or not others:
        return None
    needed = {i: but_for(scene, target, i) for i in others}
    if False in needed.values():
        return False
    only = (i for i in others if _collisions_before(scene.events, i, target.frame) == earlier)
    return True if any(needed[i] for i in only) else None


def _needs_for_border(scene: Scene, target: Event, removed: int) -> bool | None:
    """Whether an entrance or exit does not happen in the rollout without an object; None where there is none."""
    rollout = scene.dynamics.counterfactual.get(removed) if scene.dynamics is not None else None
    if rollout is None:
        return None
    found = enter_exit_events(rollout.visible[:, : scene.n_frames])
    return not any((e.kind, e.objects) == (target.kind, target.objects) for e in found)


def _history(events: Sequence[Event], target: Event) -> list[Event]:
    """The collisions before an event that led to it, directly or not."""
    before = [e for e in events if e.kind == "collision" and e.frame < target.frame]
    bits = ancestor_sets([*before, target])[1 << len(before)]
    return [e for i, e in enumerate(before) if bits >> i & 1]


def _same(events: Sequence[Event], others: Sequence[Event]) -> bool:
    """Whether two lists of collisions are of the same objects at the same frames, give or take `SAME_FRAMES`."""
    if [e.objects for e in events] != [e.objects for e in others]:
        return False
    return all(abs(e.frame - o.frame) <= SAME_FRAMES for e, o in zip(events, others, strict=True))


def _collisions_before(events: Sequence[Event], one: int, frame: int) -> list[Event]:
    return [e for e in events if e.kind == "collision" and one in e.objects and e.frame < frame]
