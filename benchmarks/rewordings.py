"""Rewordings of CLEVRER's texts and spoilt texts, by rules that the parser does not know.

Regular expressions rewrite parts of a text of the grammar: synonyms, verbs of collision, entrance and exit, sentence forms; the
result is not always good English. `drawn_rows` adds misspelt words, and texts that must be refused: a strange word put in, two words
exchanged, a noun phrase or verb left out, "not" or a number put in.
"""

import random
import re
from collections.abc import Callable, Sequence
from typing import Any

from nsdr.language.texts import TEXT_KINDS, sample

__all__ = ["drawn_rows", "paraphrased"]

Rule = tuple[str, tuple[str, ...]]
"""A regular expression and its replacements."""

A = r"(the (?:\w+ ){0,2}\w+)"
"""A single object: "the red metal cube"."""
THEM = r"((?:\w+ ){0,2}\w+s)"
"""A class of objects: "red metal cubes"."""

_FORMS: tuple[Rule, ...] = (
    # Whole sentences.
    (rf"^How many {THEM} (enter|exit) the scene", (r"What is the number of \1 that \2 the scene", r"Count the \1 that \2 the scene", r"How many of the \1 \2 the scene")),
    (rf"^How many {THEM} are (moving|stationary)", (r"What number of \1 are \2", r"Count the \1 that are \2", r"How many \1 do we see \2")),
    (rf"^How many (moving|stationary) {THEM} are there", (r"What is the number of \1 \2", r"Count the \1 \2", r"How many \1 \2 do we see")),
    (r"^How many collisions happen", ("How many collisions are there", "What is the number of collisions", "Count the collisions", "How many times do objects collide", "How many collisions occur", "How often does a collision happen")),
    (rf"^Are there any {THEM} that (enter|exit) the scene", (r"Do any \1 \2 the scene", r"Are any \1 to \2 the scene", r"Do we see any \1 that \2 the scene")),
    (r"^Are there any ((?:\w+ ){0,2}\w+?)s that (enter|exit) the scene", (r"Does any \1 \2 the scene", r"Is there a \1 that \2s the scene", r"Is there any \1 that \2s the scene", r"Does a \1 \2 the scene")),
    (rf"^Are there any (moving|stationary) {THEM}", (r"Are any \2 \1", r"Do we see any \1 \2", r"Are there \2 that are \1", r"Are there \1 \2")),
    (r"^Are there any (moving|stationary) ((?:\w+ ){0,2}\w+?)s\b", (r"Is any \2 \1", r"Is there a \1 \2", r"Is a \2 \1", r"Is there any \1 \2")),
    (r"^Are there collisions", ("Is there any collision", "Does a collision happen", "Do collisions happen", "Do objects collide", "Do any collisions occur")),
    (r"^What (color|material|shape) is", (r"Which \1 is", r"What is the \1 of", r"Which \1 has", r"Tell me the \1 of")),
    (r"^What is the (color|material|shape) of", (r"Which \1 is", r"What's the \1 of", r"Name the \1 of", r"Say the \1 of", r"What \1 has")),
    (r"^What (?:is the )?(color|material|shape) (?:is|of) (the .*)\?$", (r"\2 has which \1?", r"What \1 does \2 have?", r"Which \1 does \2 have?")),
    (r"^What (?:is the )?material (?:is|of) (the .*)\?$", (r"What is \1 made of?", r"Of what material is \1?")),
    (r"^What (?:is the )?color (?:is|of) the (first|second|last) object that (enters|exits) the scene", (r"Which color \2 the scene \1",)),
    (r"^What (?:is the )?(color|shape|material) (?:is|of) the object to collide with (the [\w ]+)\?$", (r"What \1 is the object \2 collides with?", r"Which \1 does the object that \2 collides with have?")),
    (r"^(.*) (when|before|after) (.*)\?$", (r"\2 \3, \1?",)),
    # Explanatory.
    (r"^Which of the following is responsible for", ("What causes", "What caused", "Which of these causes", "Which of the following leads to", "What is the reason for", "Which is responsible for", "Which of these is a cause of", "What is responsible for", "Which of the following contributes to", "What brings about")),
    (r"^Which of the following is not responsible for", ("What does not cause", "What did not cause", "Which of these is not a cause of", "Which of the following doesn't lead to", "Which of these isn't responsible for", "Which is not a reason for", "Which of the following has nothing to do with", "Which does not contribute to")),
    (rf"^Which of the following is responsible for the collision between {A} and {A}\?", (r"Why do \1 and \2 collide?", r"What makes \1 and \2 collide?", r"Why does \1 collide with \2?")),
    (rf"^Which of the following is responsible for {A}'s (?:exit|exiting the scene)\?", (r"Why does \1 exit the scene?", r"What makes \1 exit the scene?")),
    (rf"the collision between {A} and {A}", (r"the collision of \1 and \2", r"the collision of \1 with \2", r"the crash between \1 and \2", r"the crash of \1 and \2", r"the impact between \1 and \2", r"\1's collision with \2", r"\1 hitting \2", r"\1 colliding with \2")),
    (rf"{A}'s colliding with", (r"\1 colliding with", r"\1 hitting", r"\1's hitting", r"\1 bumping into", r"\1 crashing into", r"\1 striking", r"\1's crash with", r"\1 running into")),
    (rf"{A}'s (?:entrance|entering the scene)", (r"the entrance of \1", r"\1 entering", r"\1 coming in", r"\1's arrival", r"the arrival of \1", r"\1's coming in", r"\1 appearing", r"the appearance of \1", r"that \1 enters")),
    (rf"{A}'s (?:exit|exiting the scene)", (r"the exit of \1", r"\1 exiting", r"\1 leaving", r"\1's leaving", r"\1's departure", r"the departure of \1", r"\1 going out", r"\1's leaving the scene", r"that \1 exits")),
    (rf"^the presence of {A}$", (r"\1", r"\1's presence", r"\1 being there", r"the existence of \1", r"that \1 is there", r"the fact that \1 exists")),
    # What happens.
    (r"^(What|Which event) will happen next", (r"\1 happens next", r"\1 comes next", r"\1 is going to happen next", r"\1 will happen after this", r"\1 happens after the video", r"\1 will come next", r"\1 happens afterwards", r"Which of these happens next")),
    (r"will not happen", ("would not happen", "won't happen", "does not happen", "would not occur", "will not occur", "doesn't happen")),
    (r"will happen", ("would happen", "happens", "is going to happen", "will occur", "would occur", "will take place")),
    (rf"[Ii]f {A} is removed", (r"if \1 were removed", r"if \1 was removed", r"if we remove \1", r"if you remove \1", r"if \1 is taken away", r"if we take away \1", r"if \1 was not there", r"if \1 were not there", r"if \1 is gone", r"if \1 did not exist", r"if \1 were absent", r"had \1 not been there", r"with \1 removed", r"suppose \1 is removed", r"imagine \1 is not there", r"if \1 were missing")),
    (r"[Ii]f the (.+?) is removed", (r"if there were no \1", r"if there was no \1", r"if there is no \1")),
    (rf"[Ww]ithout {A}", (r"in the absence of \1", r"with no sign of \1", r"if \1 were not there")),
    (rf"^{A} and {A} collide$", (r"\1 and \2 hit each other", r"\1 and \2 bump into each other", r"\1 and \2 crash", r"\1 and \2 will collide", r"there is a collision between \1 and \2", r"a collision of \1 and \2 happens", r"\1 and \2 touch")),
    (rf"^{A} collides with", (r"\1 hits", r"\1 bumps into", r"\1 crashes into", r"\1 strikes", r"\1 runs into", r"\1 will collide with", r"\1 touches", r"\1 will hit")),
)  # fmt: skip

_WORDS: tuple[Rule, ...] = (
    (r"object to collide with", ("object that hits", "object that collides with", "object colliding with", "object hitting", "object to hit", "object that bumps into", "object to bump into", "object that crashes into", "object striking", "object that touches", "object that runs into")),
    (r"when the video begins", ("when the video starts", "at the start", "at the beginning", "at the start of the video", "at the beginning of the video", "in the first frame", "as the video begins", "when the clip starts", "initially")),
    (r"when the video ends", ("at the end", "at the end of the video", "in the last frame", "when the clip ends", "as the video ends", "when the video is over", "finally", "at the end of the clip")),
    (rf"(before|after) {A} (enters|exits) the scene", (r"\1 \2 \3",)),
    (rf"before {A} enters the scene", (r"before \1's entrance", r"before the entrance of \1", r"before \1 came in", r"until \1 enters")),
    (rf"after {A} enters the scene", (r"after \1's entrance", r"after the entrance of \1", r"after \1 came in", r"once \1 is in the scene", r"once \1 has entered")),
    (rf"(before|after) {A} exits the scene", (r"\1 \2's exit", r"\1 \2 left", r"\1 the exit of \2")),
    (rf"when {A} (enters|exits) the scene", (r"as \1 \2", r"when \1 \2", r"while \1 \2 the scene")),
    (r"that enters the scene", ("entering the scene", "to enter", "that comes in", "to appear", "to come into view", "that shows up", "that appears", "to arrive")),
    (r"that exits the scene", ("leaving the scene", "to leave", "that leaves", "that disappears", "that goes out of view", "to go out", "to leave the picture")),
    (r"enters the scene", ("enters", "comes in", "comes into the scene", "appears", "arrives", "comes into view", "shows up", "enters the picture")),
    (r"exits the scene", ("exits", "leaves", "leaves the scene", "goes out", "disappears", "goes out of view", "goes away", "leaves the picture")),
    (r"enter the scene", ("enter", "come in", "come into the scene", "appear", "arrive", "come into view", "show up")),
    (r"exit the scene", ("exit", "leave", "leave the scene", "go out", "disappear", "go out of view", "leave the picture")),
    (r"that (?:is|are) moving", ("in motion", "that moves", "which is moving", "that is in motion", "that move")),
    (r"that (?:is|are) stationary", ("at rest", "that is at rest", "that is not moving", "that stands still", "that isn't moving", "that does not move", "that never moves", "that stay still")),
    (r"(are|is) moving", (r"\1 in motion", "move", r"\1 still moving")),
    (r"(are|is) stationary", (r"\1 at rest", r"\1 still", r"\1 not moving", "do not move", r"\1 standing still", "stay still", "never move")),
    (r"\bstationary\b", ("resting", "motionless", "still", "unmoving")),
    (r"\bobject\b", ("thing", "item")),
    (r"\bobjects\b", ("things", "items")),
    (r"\bcubes\b", ("blocks", "boxes")),
    (r"\bcube\b", ("block", "box")),
    (r"\bsphere(s?)\b", (r"ball\1",)),
    (r"\bmetal\b", ("metallic", "shiny")),
    (r"\bthe\b(?= \w+(?: \w+)?$)", ("a",)),
    (r"^([Ww]hat|[Ww]hich event)\b", ("which of these", "which of the following", "what event")),
    (r"[Ww]hich of the following", ("which of these", "which")),
)  # fmt: skip

_FORM_PROBABILITY = 0.5
"""Probability that a matching rule of `_FORMS` is applied (0-1)."""
_WORD_PROBABILITY = 0.25
"""Probability that a matching rule of `_WORDS` is applied (0-1)."""


def paraphrased(text: str, rng: random.Random) -> str:
    """A random paraphrase of a grammar text, with the same program; it may be the text itself."""
    for rules, probability in ((_FORMS, _FORM_PROBABILITY), (_WORDS, _WORD_PROBABILITY)):
        for pattern, wordings in rules:
            if rng.random() < probability:
                text = re.sub(pattern, _replacement(wordings, rng), text, count=1)
    return text[:1].upper() + text[1:]


def _replacement(wordings: Sequence[str], rng: random.Random) -> Callable[[re.Match[str]], str]:
    return lambda match: match.expand(rng.choice(wordings))


_STRANGE = (
    "big", "small", "black", "left", "two", "three", "almost", "all", "both", "every", "or", "most", "faster", "slowly",
    "except", "third", "white", "only", "twice", "other", "near", "behind", "same",
)  # fmt: skip
_TYPO_PROBABILITY = 0.1
"""Share of the rewordings that get a misspelt word (0-1)."""
_TRAP_SHARE = 0.4
"""Share of texts that must be refused (0-1)."""
_STRANGE_SHARE = 0.7
"""Share of strange words among the spoilt texts; the others are shuffled (0-1)."""
_SHUFFLED_WORDS = 5
"""Shortest text that is shuffled (words)."""
_LONG_LETTERS = 6
"""Letters of the shortest word that is misspelt."""


def drawn_rows(count: int, seed: int) -> list[dict[str, Any]]:
    """Rows of `kind`, `text` and `program` (postfix tokens; None for a text that must be refused)."""
    rng = random.Random(seed)
    rows: list[dict[str, Any]] = []
    while len(rows) < count:
        kind = rng.choice(TEXT_KINDS)
        text, program = sample(kind, rng)
        if rng.random() < _TRAP_SHARE:
            rows.append({"kind": kind, "text": _spoilt(text, rng), "program": None})
            continue
        reworded = paraphrased(text, rng)
        if rng.random() < _TYPO_PROBABILITY:
            reworded = _misspelt(reworded, rng)
        rows.append({"kind": kind, "text": reworded, "program": " ".join(program)})
    return rows


def _misspelt(text: str, rng: random.Random) -> str:
    """The text with two neighbouring letters of a long word exchanged."""
    words = text.split()
    long = [i for i, word in enumerate(words) if word.isalpha() and len(word) >= _LONG_LETTERS]
    if long:
        i = rng.choice(long)
        at = rng.randrange(1, len(words[i]) - 2)
        word = words[i]
        words[i] = word[:at] + word[at + 1] + word[at] + word[at + 2 :]
    return " ".join(words)


def _spoilt(text: str, rng: random.Random) -> str:
    """A text with a strange word put in, or with its words in another order."""
    words = text.rstrip("?").split()
    if rng.random() < _STRANGE_SHARE or len(words) < _SHUFFLED_WORDS:
        words.insert(rng.randrange(1, len(words)), rng.choice(_STRANGE))
        return " ".join(words)
    before = list(words)
    while words == before:
        rng.shuffle(words)
    return " ".join(words)
