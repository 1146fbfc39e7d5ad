"""Finds the claims of a text about a video, and says whether they hold in its scene."""

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace

from nsdr.claims.checking import StatementChecker, Verdict
from nsdr.claims.reading import read_sentence
from nsdr.claims.statements import Statement
from nsdr.types import Scene
from nsdr.validation import Count, convert, expect

TOLERANCE_FRAMES = 1
"""The largest difference between a stated frame and the scene's. CLEVRER's own files differ by as much: of 29 collisions in
annotations and in the release's `processed_proposals`, 18 have the same frame in both, and 11 are one later in the latter."""

MAX_SENTENCE = 400
"""The longest sentence that is read (characters): more than twice as long as any that `narrate` writes."""
OTHER_COURSES = ("future", "counterfactual")
"""Kinds of claims that are not about the video."""
_PASSED_OVER = re.compile(r"<answer>.*?(?:</answer>|\Z)|</?\w+>|[*_`#>|]+", re.DOTALL | re.IGNORECASE)
_LIST_MARK = re.compile(r"\s*(?:[-•]\s+|\(?\d{1,2}[.)]\s+|step \d+ ?[:.)]\s*)?", re.IGNORECASE)
_OPTION = re.compile(r"\s*(?:[-•]\s*)?\(?(?:(?:option|choice) )?\(?[A-Za-z][).:]\s", re.IGNORECASE)
_SENTENCE = re.compile(r"[^\s].*?(?:(?<![.!?;])[.!?;]+(?=\s|$)|$)")
_OTHER_WORLD = re.compile(
    r"\b(?:if|suppose|supposing|assume|assuming|imagine|hypothetical\w*|would|could|scenario|remov\w+|without|absent|absence|"
    r"counterfactual\w*|had|were|option|options|choice|choices|statement|claim|claims|says|said|question|asks?|asked|whether|"
    r"after the video|future|next|predict\w*|false|wrong|incorrect|possib\w+|maybe|perhaps|might|may|"
    r"missing|not exist|delet\w+|eliminat\w+|ignor\w+|exclud\w+|tak(?:e|ing|en)\b.*\b(?:away|out))\b",
    re.IGNORECASE,
)
"""Words of an unread sentence after which claims cannot be checked: they may be about another course of events, or reported."""
_DENIAL = re.compile(
    r"^\W*(?:no,|wait\b|actually\b|hmm\b|correction\b|oops\b|sorry\b)|"
    r"^\W*(?:but |however,? )?(?:this|that|it|which)\b.*\b(?:not|false|wrong|incorrect|untrue|never|impossible|unclear)\b|"
    r"^\W*(?:but |however,? )?(?:this|that|it)(?:'s| is| was)n't\b|^\W*(?:but )?they (?:do|did)(?: not|n't)\b|"
    r"^\W*(?:false|wrong|incorrect|not (?:true|correct|right|really))\b|^\W*no\W*$|^\W*there (?:is|was) no such\b",
    re.IGNORECASE,
)
"""Sentences that take back what the sentence before them says, unless they are claims themselves."""


@dataclass(frozen=True, kw_only=True)
class Claim(Verdict):
    """A fact that a text states, and whether it holds.

    Attributes:
        text: the sentence that states it.
        start: position of the sentence's first character in the text.
        end: position after its last one.
        statement: what was read.
    """

    text: str
    start: int
    end: int
    statement: Statement

    @property
    def kind(self) -> str:
        """`Statement.kind`."""
        return self.statement.kind

    @property
    def frame(self) -> int | None:
        """The stated frame; None if there is none."""
        frames = [self.statement.frame, *(e.frame for e in self.statement.events)]
        return next((f for f in frames if f is not None), None)


@dataclass(frozen=True)
class Verification:
    """The claims of a text.

    Attributes:
        claims: what was read, in the order of the text.
        skipped: (start, end) of the sentences that make no claim or cannot be read.
    """

    claims: tuple[Claim, ...]
    skipped: tuple[tuple[int, int], ...]


def verify(text: str, scene: Scene, tolerance_frames: int = TOLERANCE_FRAMES) -> Verification:
    """Find each claim of a text, and whether it holds.

    A sentence is read as a whole or skipped (the grammar is in `docs/claims.md`). Questions, options with letters and the
    content of answer tags are skipped. Two sorts of claims cannot be checked: those after a sentence that may open another
    course of events ("Suppose the cube is removed."), and those that the next sentence takes back ("Wait, that is wrong.").

    Args:
        text: a text about a video, such as a language model's reasoning.
        scene: the scene of the video, which counts as the truth.
        tolerance_frames: the largest difference between a stated frame and the scene's.

    Raises:
        DataError: `text` is not a text, or the tolerance is not a whole number of at least 0.
    """
    expect(isinstance(text, str), "verify.text", "a text", text)
    convert(tolerance_frames, Count, "verify.tolerance_frames: ")
    checker = StatementChecker(scene, tolerance_frames)
    words, fps = scene.world.vocabulary, scene.world.timeline.fps
    claims: list[Claim] = []
    skipped: list[tuple[int, int]] = []
    said: list[Claim] = []  # by the sentence before
    uncertain = ""
    last_line = -1
    for sentence in _sentences(text):
        if sentence.line != last_line and (uncertain == "line" or sentence.after_gap):
            uncertain = ""
        last_line = sentence.line
        shown = text[sentence.start : sentence.end]
        statements = read_sentence(sentence.plain, scene.n_frames - 1, words, fps) if sentence.readable else ()
        if not statements and said and not sentence.after_gap and _DENIAL.match(shown):
            taken_back = [replace(c, holds=None, reason="the next sentence takes it back", event=None) for c in said]
            claims[-len(said) :] = taken_back
        said = []
        for statement in statements:
            verdict = checker.check(statement)
            if uncertain and statement.kind not in OTHER_COURSES:
                verdict = Verdict(None, "a sentence before it may open another course of events", verdict.objects)
            said.append(Claim(**vars(verdict), text=shown, start=sentence.start, end=sentence.end, statement=statement))
        claims += said
        if not statements:
            skipped.append((sentence.start, sentence.end))
            if sentence.readable and _OTHER_WORLD.search(sentence.plain):
                uncertain = "paragraph"
        elif not uncertain and any(s.kind in OTHER_COURSES for s in statements):
            uncertain = "line"
    return Verification(tuple(claims), tuple(skipped))


@dataclass(frozen=True)
class _Sentence:
    """The place of a sentence, its text without markup, and whether it may be a claim."""

    start: int
    end: int
    line: int
    after_gap: bool
    plain: str
    readable: bool


def _sentences(text: str) -> Iterator[_Sentence]:
    """The sentences of a text. A sentence ends at the end of its line at the latest."""
    blank = _PASSED_OVER.sub(lambda match: re.sub(r"[^\n]", " ", match[0]), text)
    position, after_gap = 0, False
    for number, line in enumerate(blank.split("\n")):
        option = _OPTION.match(line) is not None
        mark = None if option else _LIST_MARK.match(line)
        for found in _SENTENCE.finditer(line, mark.end() if mark else 0):
            plain = found[0].rstrip(" .!;")
            if not re.search(r"\w", plain):
                continue
            start = position + found.start()
            readable = not option and len(plain) <= MAX_SENTENCE and not plain.endswith("?")
            yield _Sentence(start, start + len(found[0].rstrip()), number, after_gap, plain, readable)
            after_gap = False
        after_gap = after_gap or not line.strip()
        position += len(line) + 1
