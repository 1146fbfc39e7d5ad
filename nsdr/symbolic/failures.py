"""Error messages about failed steps, in the words of a user."""

from collections.abc import Sequence
from typing import Any

from nsdr.errors import ExecutionError
from nsdr.symbolic.facts import SceneFacts
from nsdr.symbolic.modules import Kind
from nsdr.symbolic.phrases import noun_phrase
from nsdr.symbolic.program import Step
from nsdr.world.vocabulary import indefinite

NUMBERS = ("none", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten")
MAX_LISTED = 8
"""Largest number of objects or events that a message lists."""


def failure(
    error: ExecutionError, steps: Sequence[Step], index: int, values: Sequence[Any], facts: SceneFacts, where: str
) -> ExecutionError:
    """The error of a step, in words.

    Args:
        error: the error of the step's module.
        steps: the steps of the program that failed.
        index: the index of the failed step.
        values: the values of the steps before it.
        facts: what the program ran on.
        where: the choice that the step belongs to, such as "choice B"; "" for the question.

    Returns:
        An error whose message names what the program asks for, and says what the scene has instead.
    """
    step, prefix = steps[index], f"{where}: " if where else ""
    if step.token not in ("unique", "filter_order"):
        return ExecutionError(f"{prefix}{error}", index + 1, step.token)
    source = step.inputs[0]
    is_objects = steps[source].kind == Kind.OBJECTS
    found = _objects(facts, values[source]) if is_objects else facts.sentences(values[source])
    if step.token == "unique" and found:
        place, kind = f" in {where}" if where else "", "objects" if is_objects else "events"
        fitting = f"{_number(len(found))} {kind}: {_listed(found, is_objects)}"
        message = f"'{noun_phrase(steps, index)}'{place} fits {fitting}"
    else:
        message = prefix + _nothing(steps, index, found, facts)
    return ExecutionError(message, index + 1, step.token)


def _nothing(steps: Sequence[Step], index: int, found: Sequence[str], facts: SceneFacts) -> str:
    """The sentence about a set that is empty, or too small for an order."""
    step = steps[index]
    noun = noun_phrase(steps, step.inputs[0])
    if steps[step.inputs[0]].kind == Kind.OBJECTS:
        asked = noun.removesuffix(" object") if noun.endswith(" object") else indefinite(noun)
        return f"no object in this video is {asked}; it has: {_listed(_objects(facts, facts.all_objects), True)}"
    asked = noun_phrase(steps, index).removeprefix("the ") if step.token == "filter_order" else noun
    if found:
        return f"there is no {asked}; there is {_number(len(found))}: {_listed(found, False)}"
    kinds = {"collision": "collision", "entrance": "in", "exit": "out"}
    kind = next((name for name in kinds if noun.startswith(name)), "event")
    others = facts.sentences([e for e in facts.events if kind == "event" or e.kind == kinds[kind]])
    return f"there is no {asked}; the {kind}s of this video: {_listed(others, False) if others else 'none'}"


def _objects(facts: SceneFacts, objects: Sequence[int]) -> tuple[str, ...]:
    return tuple(f"the {facts.objects[i].name}" for i in objects)


def _listed(found: Sequence[str], is_objects: bool) -> str:
    """ "the red cube and the blue sphere"; events are separated by semicolons."""
    shown = list(found[:MAX_LISTED])
    more = len(found) - len(shown)
    if more:
        shown.append(f"{more} more")
    if not is_objects:
        return "; ".join(shown)
    return shown[0] if len(shown) == 1 else f"{', '.join(shown[:-1])} and {shown[-1]}" if shown else "none"


def _number(count: int) -> str:
    return NUMBERS[count] if count < len(NUMBERS) else str(count)
