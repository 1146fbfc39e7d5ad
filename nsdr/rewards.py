"""Rewards for training language models on CLEVRER's questions, as TRL's `GRPOTrainer` calls them.

    >>> trainer = GRPOTrainer(model, reward_funcs=[exact, per_option, answer_format, trace_verified], ...)

A reward gets the completions of a batch (texts, or lists of messages) and the columns of the data set as lists. The columns are
`solution` (`nsdr.clevrer.solution`), `options` (the texts of the question's options; empty for an open question) and, for
`trace_verified`, `scene` (path of a file with the video's scene). See `docs/rewards.md`.
"""

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

from nsdr.claims.statements import PAST_KINDS
from nsdr.claims.verification import Claim, Verification, verify
from nsdr.clevrer.answers.responses import TAG, Response, read_response
from nsdr.clevrer.files.scenes import iterate_scenes
from nsdr.errors import DataError
from nsdr.io.reading import read_json
from nsdr.io.storage import load
from nsdr.types import Scene

__all__ = ["MAX_OF_A_KIND", "answer_format", "exact", "per_option", "read_scene", "trace_score", "trace_verified"]

Completion = str | Sequence[Mapping[str, Any]]
"""A text, or messages with `role` and `content`, as conversational data sets have them; the last message counts."""
Options = Sequence[str]
"""Texts of a question's options; none for an open question."""
MAX_OF_A_KIND = 6
"""How many facts of one kind `trace_score` counts: the largest number of collisions in a CLEVRER video."""
UNINFORMATIVE = ("attribute", "presence")
"""Kinds of claims that any look at the video yields; they cannot raise `trace_score`."""
EXPECTED = {
    "solution": "right answers, so leave out questions without one, as of the test split",
    "options": "texts of options",
    "scene": "paths of scenes, which `nsdr export --scenes` writes",
}
"""What each column holds."""
_ENDS_WITH_TAGS = re.compile(r"<answer>.*</answer>\s*\Z", re.DOTALL)


def exact(
    completions: Sequence[Completion], solution: Sequence[str], options: Sequence[Options], **columns: Any
) -> list[float]:
    """1 where the answer is the right one, with all of its options, else 0; also 0 where no answer can be read.

    Args:
        completions: one per sample.
        solution: right answers in their tags, such as "<answer>A,C</answer>".
        options: of each question.
        columns: other columns and what the trainer adds; not used.

    Raises:
        DataError: the columns' lengths differ, a value is None, or a solution cannot be read.
    """
    return [float(given.answer == right) for given, right, _ in _read(completions, solution, options)]


def per_option(
    completions: Sequence[Completion], solution: Sequence[str], options: Sequence[Options], **columns: Any
) -> list[float]:
    """The share of options that are judged rightly (0-1); an open question counts as one option.

    Where no answer can be read, it is 0. Arguments and errors are those of `exact`.
    """
    rewards = []
    for given, right, n_options in _read(completions, solution, options):
        if isinstance(given.answer, frozenset) and isinstance(right, frozenset):
            rewards.append(1 - len(given.answer ^ right) / n_options)
        else:
            rewards.append(float(given.answer == right))
    return rewards


def answer_format(completions: Sequence[Completion], options: Sequence[Options], **columns: Any) -> list[float]:
    """1 where the completion ends with its only answer in `<answer>` tags, and it can be read, right or wrong; else 0.

    Arguments and errors are those of `exact`, without `solution`.
    """
    rewards = []
    for completion, choices in _rows(completions, options=options):
        text = _text(completion)
        readable = read_response(text, _checked(choices)).answer is not None
        rewards.append(float(readable and len(TAG.findall(text)) == 2 and _ENDS_WITH_TAGS.search(text) is not None))
    return rewards


def trace_verified(completions: Sequence[Completion], scene: Sequence[str | Path], **columns: Any) -> list[float]:
    """The share of the reasoning's checkable claims that hold in the video's scene (0-1), by `trace_score`.

    Args:
        completions: one per sample.
        scene: of each sample, the path of a file that `read_scene` reads. Files that were read are kept in memory and must not
            change.
        columns: other columns and what the trainer adds; not used.

    Raises:
        DataError: the columns' lengths differ, a value is None, or a scene cannot be read.
    """
    rewards = []
    for completion, path in _rows(completions, scene=scene):
        if not isinstance(path, str | Path):
            raise DataError(f"column scene: expected paths, got {path!r:.60}")
        rewards.append(trace_score(verify(_text(completion), read_scene(str(path)))))
    return rewards


def trace_score(verification: Verification) -> float:
    """The share of distinct, informative claims that hold; 0 without any.

    Each rule keeps a text from filling up its score with what is easily said:

    - Each fact counts once, whatever its wording or frame; a claim that fails counts once for each frame that it is tried with.
    - Attributes and presence of objects, denials at a single frame, events without a particular object or frame ("an object
      enters"), counts of none where there is no such object ("no yellow cube enters"), and what is true by its words ("without
      the cube, the cube and the ball do not collide") count only where they are wrong.
    - Denied facts that hold ("… do not collide", "no cube …") count at most as often as others that hold, or once; but events
      that are denied of the video ("the cube does not exit"), which are hardly ever wrong, not even once without others.
    - At most `MAX_OF_A_KIND` facts of a kind that hold count.
    - What cannot be checked counts neither way.

    A text may still confine itself to a few safe claims: use it beside `exact`, never alone.

    Args:
        verification: of the text.
    """
    right = {_fact(c): c for c in verification.claims if c.holds and not _uninformative(c)}
    wrong = {(_fact(c), c.frame) for c in verification.claims if c.holds is False}
    asserted = _capped(c for c in right.values() if not c.negated)
    denials = [c for c in right.values() if c.negated]
    denied = min(_capped(denials), max(any(c.kind not in PAST_KINDS.values() for c in denials), asserted))
    counted = asserted + denied
    return counted / (counted + len(wrong)) if counted else 0.0


@lru_cache(maxsize=1024)
def read_scene(path: str) -> Scene:
    """The scene in a file: a generated video's `truth_N.json`, an annotation, or a scene saved by `nsdr.save`.

    An annotation knows only observed events, so claims about what follows or would happen cannot be checked with it.

    Raises:
        DataError: the file is none of these; names it and what was expected.
    """
    content = read_json(path)
    if isinstance(content, dict) and content.get("type") == "Scene":
        return load(Scene, path)
    scenes = [scene for _, _, scene in iterate_scenes(path)]
    if len(scenes) != 1:
        raise DataError(f"{path}: expected a truth file, an annotation or a saved scene, got {len(scenes)} scenes")
    return scenes[0]


def _capped(claims: Iterable[Claim]) -> int:
    return sum(min(n, MAX_OF_A_KIND) for n in Counter(c.kind for c in claims).values())


def _uninformative(claim: Claim) -> bool:
    said = claim.statement
    denied_at_a_frame = claim.negated and bool(said.events) and claim.frame is not None
    placed = claim.frame is not None and not said.relation
    counts = said.number is not None and said.kind != "order"
    vague = not (claim.objects or placed or counts)
    # An object does not collide without itself, and is responsible for an event that it takes part in.
    alone = [said.removed] if said.removed is not None else list(said.objects) if said.kind == "cause" else []
    named = len(alone) + len(said.events[0].objects) if alone and len(said.events) == 1 else 0
    tautology = len(claim.objects) < named
    return claim.kind in UNINFORMATIVE or claim.vacuous or denied_at_a_frame or vague or tautology


def _fact(claim: Claim) -> tuple[Any, ...]:
    """What a claim says, without wording and frames: the event of the scene that it is about, or what it names.

    The words of objects count only where they name none, in a claim that fails.
    """
    said = claim.statement
    removed = claim.objects[-1:] if said.removed is not None else ()
    if claim.event is not None:
        return (said.kind, removed, claim.event)
    phrases = (*said.objects, *(p for e in said.events for p in e.objects))
    words = {tuple(sorted(p.words)) for p in phrases}
    unnamed = tuple(sorted(words)) if claim.holds is False and len(words) > len(claim.objects) else ()
    classes = tuple(sorted(said.objects[0].words)) if said.number is not None and said.objects else ()
    order = claim.objects if said.kind in ("order", "cause") else tuple(sorted(claim.objects))
    kinds = tuple(e.kind for e in said.events)
    return (said.kind, order, removed, unnamed, kinds, classes, said.words, said.number, said.relation, claim.negated)


def _read(
    completions: Sequence[Completion], solution: Sequence[str], options: Sequence[Options]
) -> list[tuple[Response, str | frozenset[str], int]]:
    """Of each sample what was read, the right answer and the number of options."""
    read = []
    for completion, right, choices in _rows(completions, solution=solution, options=options):
        texts = _checked(choices)
        if not isinstance(right, str):
            raise DataError(f"column solution: expected texts, got {right!r:.60}")
        expected = read_response(right, texts)
        if expected.answer is None:
            example = "expected such as <answer>red</answer> or <answer>A,C</answer>"
            raise DataError(f"solution {right!r}: {expected.problem}; {example}")
        read.append((read_response(_text(completion), texts), expected.answer, len(texts)))
    return read


def _rows(completions: Sequence[Completion], **columns: Sequence[Any]) -> Iterator[tuple[Any, ...]]:
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


def _text(completion: Completion) -> str:
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
