"""Programs of texts by rules: without torch, in milliseconds.

A text, in normal form, must have one reading by the rules (`nsdr.language`). So no word is lost, none is invented, and their
order matters. A text without a reading is read by what it mentions (`nsdr.question_parser.contents`), if that fits one program.
All others are refused, with what is understood without some of their words.
"""

import re
import unicodedata
from collections.abc import Mapping, Sequence

from nsdr.errors import NsdrError, ProgramError, QuestionError
from nsdr.io.limits import check_limit
from nsdr.language.normal import normal_form
from nsdr.language.reserved import check_vocabulary
from nsdr.language.rules import load_rules
from nsdr.language.texts import START_SYMBOLS, TEXT_KINDS, TOLD, english, in_words
from nsdr.language.words import rewritten
from nsdr.question_parser.base import Parser
from nsdr.question_parser.contents import content_readings
from nsdr.question_parser.tokenizer import split_words
from nsdr.symbolic.program import Program, ProgramSource, program_tokens
from nsdr.world.vocabulary import CLEVRER, Vocabulary

REMEDY = "word it like a question or option of the data set"
PUNCTUATION = frozenset("'\u2018\u2019\",.;:?!-()/&\u2013\u2014\u201c\u201d\u2026")
"""Characters of a text beside letters, digits and spaces."""
MAX_UNUSED = 4
"""Longest sequence of words that a refusal names as not used."""
MAX_EXPLAINED_WORDS = 30
"""Refusals of longer texts do not say which words were not used."""
EXTENSION_SYMBOLS = {"descriptive": "BEYOND", "multiple_choice": "WHATIF"}
"""The symbol of each kind of text beyond CLEVRER; choices are CLEVRER's own."""
DIRECTION_SYMBOLS = {"descriptive": "DIRECTION"}
"""The symbol of questions about directions in the image, which benchmarks ask about CLEVRER's videos."""


class GrammarParser(Parser):
    """Parses texts by rules.

    Differs from the paper: the paper's parser is a network (`QuestionParser`).

    Args:
        extensions: also parse questions beyond CLEVRER (read_beyond.rules).
        vocabulary: the words of objects.

    Raises:
        DataError: a word of the vocabulary has another meaning in questions, or is too like another one; names it.
    """

    def __init__(self, extensions: bool = False, vocabulary: Vocabulary = CLEVRER) -> None:
        check_vocabulary(vocabulary)
        self.extensions, self.vocabulary = extensions, vocabulary

    def parse_batch(self, texts: Sequence[str], kind: str = "descriptive") -> list[Program | NsdrError]:
        """See `Parser`.

        A note names a misspelt word that was corrected, and says how a text was read that has a hedge or no reading by its
        words.
        """
        found: list[Program | NsdrError] = []
        for text in texts:
            try:
                check_text(text, kind)
                found.append(self._parsed(text, kind))
            except NsdrError as e:
                found.append(e)
        return found

    def in_words(self, vocabulary: Vocabulary) -> "GrammarParser":
        """See `Parser`."""
        return GrammarParser(self.extensions, vocabulary)

    def _parsed(self, text: str, kind: str) -> Program:
        words = self.vocabulary
        programs = extension_readings(text, kind, words) if self.extensions else []
        programs = programs or extension_readings(text, kind, words, DIRECTION_SYMBOLS)
        notes: list[str] = []
        if not programs:
            normal = normal_form(text, vocabulary=words)
            if normal.left_out:
                raise QuestionError(f"unknown word {normal.left_out[0]!r:.40}: {_refusal(text, kind, words)}")
            if normal.is_hedged and kind == "choice":
                raise QuestionError(f"{text!r:.200}: an option says what happens, not what may happen; {REMEDY}")
            notes += [f"read {word!r:.40} as {known!r}" for word, known in normal.corrections]
            programs = readings(text, kind, words)
            if not programs and normal.corrections:
                programs = readings(_spelt_right(text, words), kind, words)
        if len(programs) > 1:
            texts = " or as ".join(repr(_said(program, words)) for program in programs)
            raise QuestionError(f"{text!r:.200} can be read as {texts}; {REMEDY}")
        if programs:
            if normal_form(text, vocabulary=words).is_hedged:
                notes.append(read_as(programs[0], words))
            return Program.parse(programs[0], words).with_notes(*notes)
        if any(readings(text, other, words) for other in TEXT_KINDS):
            raise another_kind(text, kind)
        programs = content_readings(text, kind, words)
        if len(programs) == 1:
            return Program.parse(programs[0], words).with_notes(read_as(programs[0], words))
        raise QuestionError(_refusal(text, kind, words))


def check_text(text: str, kind: str) -> None:
    """Refuse texts that are no questions or choices.

    Raises:
        QuestionError: an unknown kind, an empty text, or a character such as an emoji or a control character; names it.
        DataError: more characters than `Limits.text_characters`.
    """
    if kind not in TEXT_KINDS:
        raise QuestionError(f"kind is {kind!r}; expected one of {', '.join(TEXT_KINDS)}")
    check_limit(len(text), "text_characters", "the text")
    for character in text:
        if not (character.isalnum() or character.isspace() or character in PUNCTUATION):
            name = unicodedata.name(character, f"U+{ord(character):04X}").lower()
            raise QuestionError(
                f"{text!r:.80}: has the character {character!r} ({name}); use words and punctuation only"
            )
    if not split_words(text):
        raise QuestionError(f"the text {text!r} is empty")


def readings(text: str, kind: str, vocabulary: Vocabulary) -> list[list[str]]:
    """The programs of a text as a "descriptive" or "multiple_choice" question or as a "choice"; unknown words are left out."""
    words = normal_form(text, vocabulary=vocabulary).words
    symbols = [START_SYMBOLS[kind], *([TOLD] if kind == "descriptive" else [])]
    return [program for symbol in symbols for program in english(vocabulary).read(symbol, words)]


def _spelt_right(text: str, vocabulary: Vocabulary) -> str:
    """The text with its misspelt words corrected, for wordings that are known as a whole: "What happends in the video?"."""
    known = dict(normal_form(text, vocabulary=vocabulary).corrections)
    return re.sub(r"[^\W_]+", lambda word: known.get(word[0], word[0]), text.lower())


def extension_readings(
    text: str, kind: str, vocabulary: Vocabulary, symbols: Mapping[str, str] = EXTENSION_SYMBOLS
) -> list[list[str]]:
    """The programs of a text that asks for more than CLEVRER's questions do; empty if it is none.

    Words that no rule has, misspelt ones among them, leave no reading.
    """
    if kind not in symbols:
        return []
    normal = normal_form(rewritten(text.lower(), "spellings_beyond"), keep_unknown=True, vocabulary=vocabulary)
    return load_rules(vocabulary, "read_english", "read_beyond").read(symbols[kind], normal.words)


def another_kind(text: str, kind: str) -> QuestionError:
    """The error of a text of another kind than it is parsed as."""
    remedy = {
        "descriptive": "give choices with it if it is a multiple-choice question",
        "multiple_choice": "ask it without choices if it is a descriptive question",
        "choice": 'a choice names an object or event, such as "the presence of the red cube"',
    }
    name = {"descriptive": "descriptive question", "multiple_choice": "multiple-choice question"}.get(kind, kind)
    return QuestionError(f"{text!r:.200} is not a {name}; {remedy[kind]}, or {REMEDY}")


def read_as(program: ProgramSource, vocabulary: Vocabulary) -> str:
    """The note that says how a text was read, where that is not what it says word by word."""
    return f"read as {_said(program, vocabulary)!r:.200}"


def unless_confirmed(program: Program, text: str, kind: str) -> Program:
    """The program that a network or language model gives for a text, with a note if the rules do not read the text so."""
    vocabulary = program.vocabulary
    is_read_so = readings(text, kind, vocabulary) == [[*program.tokens]]
    is_confirmed = is_read_so and not normal_form(text, vocabulary=vocabulary).is_hedged
    return program if is_confirmed else program.with_notes(read_as(program, vocabulary))


def _refusal(text: str, kind: str, vocabulary: Vocabulary) -> str:
    """Why a text has no reading: what is understood without its unknown words, or without a few words in sequence."""
    words, left_out = text.split(), normal_form(text, vocabulary=vocabulary).left_out
    unknown = [i for i, word in enumerate(words) if set(left_out).intersection(split_words(word))]
    spans = [range(start, start + n) for n in range(1, MAX_UNUSED + 1) for start in range(len(words) - n + 1)]
    for unused in ([unknown] if unknown else spans) if len(words) <= MAX_EXPLAINED_WORDS else ():
        programs = readings(" ".join(word for i, word in enumerate(words) if i not in unused), kind, vocabulary)
        if programs:
            said = " ".join(words[i].strip(",.;:?!") for i in unused)
            noun, verb = ("words", "were") if len(unused) > 1 else ("word", "was")
            why = f"the {noun} {said!r:.200} {verb} not used"
            return f"{text!r:.200} fits no program (understood: {_said(programs[0], vocabulary)}; {why}); {REMEDY}"
    return f"{text!r:.200} fits no program; {REMEDY}"


def _said(program: ProgramSource, vocabulary: Vocabulary) -> str:
    try:
        return in_words(program, vocabulary).rstrip("?")
    except ProgramError:
        return " ".join(program_tokens(program))
