"""What a text says stands in its program, and the other way round: a check that does not depend on the network.

The text, in normal form, must have one reading by the rules of `grammar.english`, and the program must be that reading. So no
word of the text is lost, none is invented, and their order matters. What has no reading is refused.
"""

import unicodedata
from collections.abc import Iterator, Sequence

from nsdr.errors import ProgramError, QuestionError
from nsdr.io.limits import check_limit
from nsdr.language.english import ENGLISH, START_SYMBOLS
from nsdr.language.rules import filled
from nsdr.question_parser.normal import Normal, normal_form
from nsdr.question_parser.tokenizer import split_words
from nsdr.question_parser.wording import in_words
from nsdr.symbolic.program import CHOICE_KINDS, Program

__all__ = ["REMEDY", "check_coverage", "check_text", "readings", "refusal"]

REMEDY = 'word it like a CLEVRER question, such as "How many cubes enter the scene?" (docs/questions.md)'
PUNCTUATION = frozenset("'\u2018\u2019\",.;:?!-()/\u201c\u201d\u2026")
"""Characters of a text beside letters, digits and spaces."""
MAX_UNUSED = 4
"""Longest sequence of words that a refusal names as not used."""
MAX_EXPLAINED_WORDS = 30
"""Refusals of longer texts do not say which words were not used."""


def check_text(text: str) -> None:
    """Refuse texts that are no questions or choices.

    Raises:
        QuestionError: a character such as an emoji or a control character; names it.
        DataError: more characters than `Limits.text_characters`.
    """
    check_limit(len(text), "text_characters", "the text")
    for character in text:
        if not (character.isalnum() or character.isspace() or character in PUNCTUATION):
            name = unicodedata.name(character, f"U+{ord(character):04X}").lower()
            raise QuestionError(
                f"{text!r:.80}: has the character {character!r} ({name}); use words and punctuation only"
            )


def check_coverage(text: str, tokens: Sequence[str], unknown: str = "error") -> None:
    """Refuse a program that is not the only reading of its text.

    Args:
        text: a question or choice.
        tokens: its program's, as found by the network.
        unknown: as of `normal_form`.

    Raises:
        QuestionError: says what was understood, and which words were not used or which tokens no word stands for.
    """
    try:
        kind = _kind_of(Program.parse(tokens))
    except ProgramError as e:
        raise QuestionError(f"{text!r} fits no program ({e}); {REMEDY}") from e
    found = readings(normal_form(text, unknown), kind)
    if found == [list(tokens)]:
        return
    if not found:
        raise QuestionError(refusal(text, kind, tokens))
    if len(found) > 1:
        texts = " or as ".join(repr(_said(program)) for program in found)
        raise QuestionError(f"{text!r} can be read as {texts}; {REMEDY}")
    extra = [token for token in tokens if tokens.count(token) > found[0].count(token)]
    if extra:
        why = f"no word of the text stands for {extra[0]!r}"
    else:
        lost = [token for token in found[0] if found[0].count(token) > tokens.count(token)]
        why = f"{lost[0]!r} was not used" if lost else "in another order"
    raise QuestionError(f"{text!r} fits no program (understood: {_said(tokens)}; {why}); {REMEDY}")


def readings(normal: Normal, kind: str) -> list[list[str]]:
    """The programs of a text as a "descriptive" or "multiple_choice" question or as a "choice", by the rules alone."""
    found: list[list[str]] = []
    for program in ENGLISH.readings(START_SYMBOLS[kind], normal.forms):
        tokens = filled(program, normal.words)
        if tokens is not None and tokens not in found:
            found.append(tokens)
    return found


def refusal(text: str, kind: str, tokens: Sequence[str] = ()) -> str:
    """Why a text has no reading: what is understood without some of its words, and these words.

    Args:
        text: a question or choice.
        kind: "descriptive", "multiple_choice" or "choice".
        tokens: the network's program; preferred where several readings are equally near.
    """
    near = sorted(_near_readings(text, kind), key=lambda row: (len(row[1]), row[0] != list(tokens)))
    if not near:
        return f"{text!r} fits no program; {REMEDY}"
    program, unused = near[0]
    words = (
        f"the word{'s' if len(unused) > 1 else ''} {' '.join(unused)!r} {'were' if len(unused) > 1 else 'was'} not used"
    )
    return f"{text!r} fits no program (understood: {_said(program)}; {words}); {REMEDY}"


def _near_readings(text: str, kind: str) -> Iterator[tuple[list[str], list[str]]]:
    """Readings of the text without a few words in sequence, and without its unknown words, with these words."""
    unknown = set(normal_form(text, "ignore").left_out)
    words = text.split()
    if len(words) > MAX_EXPLAINED_WORDS:
        return
    is_unknown = [bool(unknown.intersection(split_words(word))) for word in words]
    known = [word for word, is_out in zip(words, is_unknown, strict=True) if not is_out]
    left_out = [word.strip(",.;:?!") for word, is_out in zip(words, is_unknown, strict=True) if is_out]
    lengths = [0] if unknown else range(1, min(MAX_UNUSED, len(known) - 1) + 1)
    for length in lengths:
        nearest = []
        for start in range(len(known) - length + 1 if length else 1):
            kept = " ".join([*known[:start], *known[start + length :]])
            for program in readings(normal_form(kept, "ignore"), kind):
                unused = [word.strip(",.;:?!") for word in known[start : start + length]]
                nearest.append((program, left_out or unused))
        if nearest:
            yield from nearest
            return


def _kind_of(program: Program) -> str:
    if program.needs_choice:
        return "multiple_choice"
    return "choice" if program.result in CHOICE_KINDS else "descriptive"


def _said(tokens: Sequence[str]) -> str:
    try:
        return in_words(tokens).rstrip("?")
    except ProgramError:
        return " ".join(tokens)
