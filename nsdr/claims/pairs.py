"""Pairs of texts of which one has exactly one wrong fact, to train and to test what tells them apart."""

import random
import re
from collections.abc import Iterator
from dataclasses import dataclass

from nsdr.claims.verification import TOLERANCE_FRAMES, Claim, Verification, verify
from nsdr.errors import DataError
from nsdr.types import Scene
from nsdr.world.nouns import ADJECTIVES, NOUNS
from nsdr.world.vocabulary import ATTRIBUTES

__all__ = ["EDITS", "MinimalPair", "minimal_pairs"]

EDITS = ("attribute", "event", "count", "frame", "relation")
"""What can be wrong: an attribute word; what happens or moves; a number; a frame; before and after, causes, places in a row."""
_COUNTED = rf"(?:(?:{'|'.join(ADJECTIVES)}) )*(?:{'|'.join(NOUNS)}|collisions?)"
_COUNT = re.compile(rf"(?<!frame )\b(?:\d{{1,2}}|no)\b(?= {_COUNTED}\b)", re.IGNORECASE)
_FRAME = re.compile(r"(?<=frame )\d{1,3}\b", re.IGNORECASE)
_OPPOSITES = {
    "event": (
        ("enters", "exits"),
        ("enter", "exit"),
        ("entrance", "exit"),
        ("moving", "stationary"),
        ("move", "never move"),
        ("moves", "never moves"),
        ("collide", "do not collide"),
        ("enters", "does not enter"),
        ("exits", "does not exit"),
        ("would collide", "would not collide"),
    ),
    "relation": (
        ("before", "after"),
        ("led to", "did not lead to"),
        ("responsible", "not responsible"),
        ("the first", "the second"),
        ("the second", "the last"),
        ("the first", "the last"),
    ),
}
"""Words that contradict each other; either is replaced by the other."""


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
    one pair of each kind; which one is drawn with the seed.

    Args:
        text: such as one of `nsdr.claims.narration.narrate`.
        scene: the scene that it is about.
        seed: of the draws; the same seed gives the same pairs.
        tolerance_frames: as of `verify`; changed frames differ by more.

    Raises:
        DataError: a claim of the text does not hold.
    """
    right = verify(text, scene, tolerance_frames)
    if right.failing:
        first = right.failing[0]
        raise DataError(f"'{first.text}' does not hold ({first.reason}); expected a text without wrong claims")
    rng = random.Random(seed)
    pairs = []
    sentences = {c.start: c for c in right.claims if c.holds}
    for claim in sentences.values():
        for kind in EDITS:
            candidates = list(dict.fromkeys(_changed(claim, kind, scene, tolerance_frames)))
            rng.shuffle(candidates)
            for sentence in candidates:
                if not verify(sentence, scene, tolerance_frames).failing:
                    continue  # the whole text takes longer
                wrong = text[: claim.start] + sentence + text[claim.end :]
                if _one_fails(right, verify(wrong, scene, tolerance_frames), claim.start):
                    pairs.append(MinimalPair(text, wrong, kind))
                    break
    return pairs


def _one_fails(right: Verification, wrong: Verification, start: int) -> bool:
    """Whether the claims are of the same kinds and only one, in the sentence at `start`, has become wrong."""
    if [c.kind for c in right] != [c.kind for c in wrong] or len(right.skipped) != len(wrong.skipped):
        return False
    changed = [(a, b) for a, b in zip(right, wrong, strict=True) if a.holds != b.holds]
    return len(changed) == 1 and changed[0][1].start == start and changed[0][1].holds is False


def _changed(claim: Claim, kind: str, scene: Scene, tolerance: int) -> Iterator[str]:
    """The sentence with one fact of a kind changed, in every way that is tried."""
    if kind == "attribute":
        yield from _other_attributes(claim.text)
    elif kind == "frame":
        yield from _other_frames(claim.text, scene.n_frames, tolerance)
    elif kind == "count":
        yield from _other_counts(claim.text)
    else:
        for one, other in _OPPOSITES[kind]:
            for old, new in ((other, one), (one, other)):
                if old == one and re.search(rf"\b{other}\b", claim.text, re.IGNORECASE):
                    continue  # "never move" contains "move"
                yield from _replaced(claim.text, old, new)


def _replaced(sentence: str, old: str, new: str) -> Iterator[str]:
    for match in re.finditer(rf"\b{old}\b", sentence, re.IGNORECASE):
        yield _with(sentence, match, new)


def _with(sentence: str, match: re.Match[str], new: str) -> str:
    """The sentence with another text in place of a match, which keeps a capital letter."""
    new = new[:1].upper() + new[1:] if match[0][:1].isupper() else new
    return sentence[: match.start()] + new + sentence[match.end() :]


def _other_attributes(sentence: str) -> Iterator[str]:
    for values in ATTRIBUTES.values():
        for match in re.finditer(rf"\b({'|'.join(values)})(?=s?\b)", sentence, re.IGNORECASE):
            for value in values:
                if value != match[0].lower():
                    yield _with(sentence, match, value)


def _other_frames(sentence: str, n_frames: int, tolerance: int) -> Iterator[str]:
    for match in _FRAME.finditer(sentence):
        for frame in range(n_frames):
            if abs(frame - int(match[0])) > tolerance:
                yield _with(sentence, match, str(frame))


def _other_counts(sentence: str) -> Iterator[str]:
    """Other numbers of the same grammatical number: 1 and none, or from 2 on."""
    for match in _COUNT.finditer(sentence):
        number = 0 if match[0].lower() == "no" else int(match[0])
        others = [0, 1] if number < 2 else [number - 1, number + 1]
        for other in others:
            if other != number and (other > 1) == (number > 1):
                yield _with(sentence, match, str(other) if other else "no")
