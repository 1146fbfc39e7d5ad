"""Execution traces as text and as trees, and explanations of answers in words."""

from collections.abc import Sequence

from nsdr.symbolic.causal import causal_path
from nsdr.types import Answer, ChoiceAnswer, Event, Scene, TraceStep

__all__ = ["explain", "format_probability", "format_trace", "format_tree"]


def format_trace(trace: Sequence[TraceStep]) -> str:
    """The trace as text, one step per line: number, module with the numbers of its inputs, and the result."""
    lines = []
    for number, step in enumerate(trace, 1):
        inputs = ", ".join(str(i + 1) for i in step.inputs)
        call = f"{step.module}({inputs})" if inputs else step.module
        lines.append(f"{number:>3}  {call:<26} {step.text}")
    return "\n".join(lines)


def format_probability(answer: Answer | ChoiceAnswer) -> str:
    """How probable it is that an answer or judgement is right, as " (98 %)"; "" where that is not known."""
    if answer.probability is None or answer.answer is None:
        return ""
    right = 1 - answer.probability if answer.answer == "wrong" else answer.probability
    percent = round(100 * right)
    return f" ({'>99' if percent == 100 else '<1' if percent == 0 else percent} %)"


def format_tree(trace: Sequence[TraceStep]) -> str:
    """The trace as a tree with the answer at the root, each module with its result."""
    lines: list[str] = []

    def draw(index: int, first: str, following: str) -> None:
        step = trace[index]
        is_word = not step.inputs and step.module == step.text
        lines.append(first + (step.module if is_word else f"{step.module}: {step.text}"))
        for number, child in enumerate(step.inputs, 1):
            last = number == len(step.inputs)
            draw(child, following + ("└─ " if last else "├─ "), following + ("   " if last else "│  "))

    if trace:
        draw(len(trace) - 1, "", "")
    return "\n".join(lines)


def explain(answer: Answer | ChoiceAnswer, scene: Scene) -> str:
    """Explain an answer in words.

    Args:
        answer: the result of `Executor.answer` or `Executor.judge`, or one of the latter's choices; for a multiple-choice
            answer, each choice is explained on its own line.
        scene: the scene that the question is about.
    """
    if isinstance(answer, Answer) and answer.choices:
        return "\n".join(f"{c.choice}: {explain(c, scene)}" for c in answer.choices)
    trace = answer.trace
    if isinstance(answer, ChoiceAnswer) and answer.error:
        return f"error: {answer.error}"
    if not trace:
        return f"{answer.answer}: no trace was kept"
    return f"{answer.answer}: {_reason(trace, len(trace) - 1, scene)}"


def _reason(trace: Sequence[TraceStep], index: int, scene: Scene) -> str:
    step = trace[index]
    inputs = [trace[i] for i in step.inputs]
    if step.module == "negate":
        return _reason(trace, step.inputs[0], scene) + ", and the question asks for the opposite"
    if step.module in ("count", "exist"):
        found = inputs[0].text
        return "there is none" if found == "none" else found
    if step.module.startswith("query_"):
        because = _selecting_event(trace, step.inputs[0])
        return f"that is the {step.module.removeprefix('query_')} of the {inputs[0].text}{because}"
    if step.module == "belong_to":
        return _membership(trace, index, scene)
    return step.text


def _selecting_event(trace: Sequence[TraceStep], index: int) -> str:
    """The event that an object was selected by, as a clause; empty if there is none."""
    events = [trace[i].text for i in trace[index].inputs if trace[i].kind == "event"]
    return f", because {events[0]}" if events else ""


def _membership(trace: Sequence[TraceStep], index: int, scene: Scene) -> str:
    chosen, group = (trace[i] for i in trace[index].inputs)
    inside = bool(trace[index].value)
    if group.module == "filter_ancestor":
        target = trace[group.inputs[1]].value
        path = _causal_path(chosen, target, scene) if inside else None
        if path:
            return "it led to the target: " + ", then ".join(_event_clause(e, scene) for e in path)
        relation = "belongs to" if inside else "takes part in none of"
        return f"{chosen.text} {relation} the events that led to {trace[group.inputs[1]].text} ({group.text})"
    what = "happens after the video" if group.module == "unseen_events" else "happens"
    if group.module == "get_counterfact":
        what = f"happens without the {trace[group.inputs[1]].text}"
    if group.module == "get_changed":
        what = f"happens with the {trace[group.inputs[1]].text} {trace[group.inputs[2]].text.replace('_', ' ')}"
    return f'"{chosen.text}" is {"" if inside else "not "}among what {what}'


def _causal_path(chosen: TraceStep, target: Event, scene: Scene) -> list[Event] | None:
    """The shortest chain of direct causes from an event (or an event of an object) to the target."""
    value = chosen.value
    if not isinstance(value, Event):
        return causal_path(scene.events, lambda e: value in e.objects, target)
    same = (value.kind, value.objects)
    return causal_path(scene.events, lambda e: (e.kind, e.objects) == same and e != target, target)


def _event_clause(event: Event, scene: Scene) -> str:
    """An event as a clause in the past tense."""
    names = [f"the {scene.objects[i].name}" for i in event.objects]
    verb = {"in": "{} entered", "out": "{} left", "collision": "{} and {} collided"}[event.kind].format(*names)
    return f"{verb} at frame {event.frame}"
