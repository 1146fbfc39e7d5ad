"""Rewards for answers, as TRL's `GRPOTrainer` calls them: exact, by option, and for the form."""

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from nsdr.clevrer.answers.responses import TAG, Response, read_response
from nsdr.errors import DataError
from nsdr.io.worlds import WorldSource, as_world
from nsdr.world.world import CLEVRER_WORLD

Completion = str | Sequence[Mapping[str, Any]]
"""A text, or messages with `role` and `content`, as conversational data sets have them; the last message counts."""
Options = Sequence[str]
"""Texts of a question's options; none for an open question."""
EXPECTED = {
    "solution": "right answers, so leave out questions without one, such as those of the test split",
    "options": "texts of options",
    "program": "programs, so leave out questions without one",
    "option_programs": "programs of options",
    "scene": "paths of scenes, which `nsdr export --scenes` writes",
}
"""What each column holds."""
_ENDS_WITH_TAGS = re.compile(r"<answer>.*</answer>\s*\Z", re.DOTALL)


def exact(
    completions: Sequence[Completion],
    solution: Sequence[str],
    options: Sequence[Options],
    world: WorldSource = CLEVRER_WORLD,
    **columns: Any,
) -> list[float]:
    """1 where the answer is the right one, with all of its options, else 0; also 0 where no answer can be read.

    Args:
        completions: one per sample.
        solution: right answers in their tags, such as "<answer>A,C</answer>".
        options: of each question.
        world: whose words answers have.
        columns: other columns and what the trainer adds; not used.

    Raises:
        DataError: the columns' lengths differ, a value is None, a solution cannot be read, or the world's file cannot.
    """
    return [float(given.answer == right) for given, right, _ in read(completions, solution, options, world)]


def per_option(
    completions: Sequence[Completion],
    solution: Sequence[str],
    options: Sequence[Options],
    world: WorldSource = CLEVRER_WORLD,
    **columns: Any,
) -> list[float]:
    """The share of options that are judged rightly (0-1); an open question counts as one option.

    Where no answer can be read, it is 0. Arguments and errors are those of `exact`.
    """
    rewards = []
    for given, right, n_options in read(completions, solution, options, world):
        if isinstance(given.answer, frozenset) and isinstance(right, frozenset):
            rewards.append(1 - len(given.answer ^ right) / n_options)
        else:
            rewards.append(float(given.answer == right))
    return rewards


def answer_format(
    completions: Sequence[Completion], options: Sequence[Options], world: WorldSource = CLEVRER_WORLD, **columns: Any
) -> list[float]:
    """1 where the completion ends with its only answer in `<answer>` tags, and it can be read, right or wrong; else 0.

    Arguments and errors are those of `exact`, without `solution`.
    """
    rewards: list[float] = []
    for completion, choices in rows(completions, options=options):
        text = text_of(completion)
        readable = read_response(text, _checked(choices), world).answer is not None
        rewards.append(float(readable and len(TAG.findall(text)) == 2 and _ENDS_WITH_TAGS.search(text) is not None))
    return rewards


def read(
    completions: Sequence[Completion], solution: Sequence[str], options: Sequence[Options], world: WorldSource
) -> list[tuple[Response, str | frozenset[str], int]]:
    """Of each sample what was read, the right answer and the number of options."""
    read: list[tuple[Response, str | frozenset[str], int]] = []
    for completion, right, choices in rows(completions, solution=solution, options=options):
        texts = _checked(choices)
        if not isinstance(right, str):
            raise DataError(f"column solution: expected texts, got {right!r:.60}")
        expected = read_response(right, texts, world)
        if expected.answer is None:
            example = f"<answer>{as_world(world).vocabulary.colors[0].word}</answer> or <answer>A,C</answer>"
            raise DataError(
                f"solution {right!r}: {expected.problem}; expected such as {example}, or give the world of the answers"
            )
        read.append((read_response(text_of(completion), texts, world), expected.answer, len(texts)))
    return read


def rows(completions: Sequence[Completion], **columns: Sequence[Any]) -> Iterator[tuple[Any, ...]]:
    """Each completion with its values of the columns, which are checked."""
    for name, values in columns.items():
        if len(values) != len(completions):
            raise DataError(f"column {name}: expected {len(completions)} values, one per completion, got {len(values)}")
        if any(value is None for value in values):
            raise DataError(f"column {name}: has values that are null; expected {EXPECTED[name]}")
    return zip(completions, *columns.values(), strict=True)


def _checked(options: Options) -> Options:
    if isinstance(options, str) or not isinstance(options, Sequence) or not all(isinstance(o, str) for o in options):
        raise DataError(f"column options: expected lists of texts, got {options!r:.60}")
    return options


def text_of(completion: Completion) -> str:
    """The text of a completion; of messages the last one's, whose content may be parts with text."""
    if isinstance(completion, str):
        return completion
    if not isinstance(completion, Sequence) or not all(isinstance(message, Mapping) for message in completion):
        raise DataError(f"completions: expected texts or lists of messages, got {completion!r:.60}")
    last: Any = completion[-1] if completion else {}
    content = last.get("content") or ""
    if isinstance(content, str):
        return content
    if not isinstance(content, Sequence):
        raise DataError(f"completions: expected a text or a list of parts as a message's content, got {content!r:.60}")
    return "\n".join(str(p.get("text", "")) for p in content if isinstance(p, Mapping) and p.get("type") == "text")
