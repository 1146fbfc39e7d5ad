"""Pairs of texts of which one has exactly one wrong fact, to train and to test what tells them apart."""

import random
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import groupby
from typing import TypeVar

from nsdr.claims.judge import ClaimJudge
from nsdr.claims.reading import written
from nsdr.claims.statements import HAPPENING, PLACES, EventPhrase, ObjectPhrase, Statement
from nsdr.claims.verification import TOLERANCE_FRAMES, verify
from nsdr.errors import DataError
from nsdr.language.slots import Slot
from nsdr.symbolic.phrases import indefinite
from nsdr.types import Scene
from nsdr.world.vocabulary import ATTRIBUTES

__all__ = ["EDITS", "MinimalPair", "minimal_pairs"]

EDITS = ("attribute", "event", "count", "frame", "relation")
"""What can be wrong: an attribute word; what happens or moves; a number; a frame; before and after, causes, places in a row."""
_OPPOSITES = (("in", "out"), ("moving", "stationary"), ("ever moving", "never moving"), ("before", "after"))
OPPOSITES = {a: b for pair in _OPPOSITES for a, b in (pair, pair[::-1])}
T = TypeVar("T")


@dataclass(frozen=True)
class MinimalPair:
    """Two texts that differ in one fact.

    Attributes:
        text: the right one: none of its claims fails.
        wrong: the wrong one: exactly one of its claims fails.
        kind: what is wrong, one of `EDITS`.
    """

    text: str
    wrong: str
    kind: str


def minimal_pairs(
    text: str, scene: Scene, seed: int = 0, tolerance_frames: int = TOLERANCE_FRAMES
) -> list[MinimalPair]:
    """Change one fact of a text at a time so that it becomes wrong.

    Every pair is verified: the wrong text has the same claims, of which exactly the changed one fails. A sentence gives at most
    one pair of each kind; which one is drawn with the seed. What `narrate` would word otherwise is reworded in both texts.

    Args:
        text: such as one of `nsdr.narrate`.
        scene: the scene that it is about.
        seed: of the draws; the same seed gives the same pairs.
        tolerance_frames: as of `verify`; changed frames differ by more.

    Raises:
        DataError: a claim of the text does not hold.
    """
    claims = verify(text, scene, tolerance_frames)
    if claims.failing:
        first = claims.failing[0]
        raise DataError(f"'{first.text}' does not hold ({first.reason}); expected a text without wrong claims")
    rng, judge = random.Random(seed), ClaimJudge(scene, tolerance_frames)
    pairs = []
    for start, group in groupby(claims, lambda c: c.start):
        sentence = list(group)
        before, told, after = text[:start], [c.statement for c in sentence], text[sentence[0].end :]
        right = before + " ".join(map(written, told)) + after
        if [c.holds for c in verify(right, scene, tolerance_frames)] != [c.holds for c in claims]:
            continue
        for kind in EDITS:
            edits = [
                edit
                for edit in _each(told, partial(_changed, kind, scene.n_frames))
                if any(judge.judge(said).holds is False for said in edit)
            ]
            rng.shuffle(edits)
            for edit in edits:
                wrong = before + " ".join(map(written, edit)) + after
                checked = verify(wrong, scene, tolerance_frames)
                differing = [b.holds for a, b in zip(claims, checked, strict=False) if a.holds != b.holds]
                if differing == [False] and [c.kind for c in checked] == [c.kind for c in claims]:
                    pairs.append(MinimalPair(right, wrong, kind))
                    break
    return pairs


def _changed(kind: str, n_frames: int, said: Statement) -> Iterator[Statement]:
    """A statement with one fact of a kind changed, in every way."""
    numbered = said.number is not None and said.kind != "order"
    if kind == "attribute":
        if said.kind == "attribute":
            yield from (replace(said, words=words) for words in _each(said.words, _other_values))
        if said.removed:
            yield from (replace(said, removed=phrase) for phrase in _other_phrases(said.removed))
        yield from (replace(said, objects=objects) for objects in _each(said.objects, _other_phrases))
        yield from _with_events(said, lambda e: (replace(e, objects=o) for o in _each(e.objects, _other_phrases)))
    elif kind == "event":
        if said.kind in HAPPENING and not numbered:
            yield replace(said, negated=not said.negated)
        if said.kind in ("motion", "count") and said.words:
            yield replace(said, words=(OPPOSITES[said.words[0]],))
        if said.kind in ("count", "order", "cause"):
            yield from _with_events(said, lambda e: [replace(e, kind=OPPOSITES[e.kind])] if e.kind in OPPOSITES else [])
    elif kind == "count" and numbered:
        number = said.number or 0
        near = (0, 1) if number < 2 else (number - 1, number + 1)
        yield from (replace(said, number=n) for n in near if (n < 2) == (number < 2))
    elif kind == "frame":
        if said.frame is not None:
            yield from (replace(said, frame=frame) for frame in range(n_frames))
        frames = range(n_frames)
        yield from _with_events(said, lambda e: (replace(e, frame=f) for f in frames if e.frame is not None))
    elif kind == "relation":
        if said.relation:
            yield replace(said, relation=OPPOSITES[said.relation])
        if said.kind == "cause":
            yield replace(said, negated=not said.negated)
        if said.kind == "order" and said.number is not None:
            yield from (replace(said, number=place) for place in PLACES.values())


def _each(items: Sequence[T], changed: Callable[[T], Iterable[T]]) -> Iterator[tuple[T, ...]]:
    """The items with one of them changed, in every way."""
    for i, item in enumerate(items):
        yield from ((*items[:i], other, *items[i + 1 :]) for other in changed(item))


def _with_events(said: Statement, changed: Callable[[EventPhrase], Iterable[EventPhrase]]) -> Iterator[Statement]:
    return (replace(said, events=events) for events in _each(said.events, changed))


def _other_values(word: str) -> Iterator[str]:
    """The other values of a word's attribute."""
    return (value for values in ATTRIBUTES.values() if word in values for value in values if value != word)


def _other_phrases(phrase: ObjectPhrase) -> Iterator[ObjectPhrase]:
    for words in _each(phrase.words, _other_values):
        noun = Slot("N", words).text
        article = phrase.text.split()[0] if phrase.text else ""
        text = indefinite(noun) if article in ("a", "an") else f"the {noun}" if article == "the" else noun
        yield replace(phrase, words=words, text=text)
