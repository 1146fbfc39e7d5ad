"""Reads the answer in a short text: a word for an open question, letters or quoted options for a multiple-choice question."""

import re
import unicodedata
from collections.abc import Collection, Iterable, Sequence
from functools import cache

from nsdr.clevrer.answers.prompts import option_letters
from nsdr.clevrer.files.questions import answer_patterns, answer_words, is_beyond
from nsdr.errors import DataError
from nsdr.world.vocabulary import DIRECTIONS, SPEED_UNIT, STATIONARY, Vocabulary

__all__ = ["UnreadableError", "is_bare", "plain", "read_candidate", "read_letters", "read_word"]

NUMBERS = "zero one two three four five six seven eight nine ten eleven twelve thirteen fourteen fifteen"
SAME_SIGNS = {0x2019: "'", 0x2013: "-", 0x2014: "-", 0x2212: "-"}
"""Typographic apostrophe, dashes and minus sign, as plain ones."""
DENIALS = frozenset(
    {"not", "non", "none", "nothing", "cannot", "neither", "nor", "never", "without", "except", "than", "least"}
    | {"unable", "impossible", "unclear", "unsure", "unknown", "uncertain", "sorry"}
)
"""Words with which a sentence names an answer word without giving it as the answer."""
_CORRECT = "(?:correct|right|true)"
_OPTIONS = "(?:options?|choices?|answers?)"
_OF_THESE = (
    rf"(?: of)?(?: (?:the|these|them|those))?(?: {_OPTIONS})?(?: (?:above|listed|given))?(?: (?:is|are) {_CORRECT})?"
)
NONE = re.compile(
    rf"(?:(?:the )?(?:{_CORRECT} )?{_OPTIONS} (?:is|are) )?(?:there (?:is|are) )?"
    rf"(?:none|neither|no (?:{_CORRECT} )?{_OPTIONS}){_OF_THESE}",
    re.IGNORECASE,
)
ALL = re.compile(rf"all{_OF_THESE}", re.IGNORECASE)
LETTERS = re.compile(
    rf"(?:(?:\b{_OPTIONS}[\s(\[:]*)?\b[A-Z]\b[\s()\[\]{{}}.,;&+\"']*(?:and\b[\s()\[\]{{}}.,;&+\"']*)?)+", re.IGNORECASE
)
"""Letters alone, large or small, or after a word such as "option"."""
JUDGING = frozenset({"option", "options", "choice", "choices", "answer", "answers", "the", "is"})
"""Words that may stand between a letter and its judgement."""
FILLERS = JUDGING | {"letter", "letters", "only", "are", "it", "correct", "right", "true", "both", "and"}
"""Words that may stand around capital letters without changing what they say."""
OPINION = re.compile(r"\bI (?:think|believe|say|choose|pick|select)\b(?: that\b)?", re.IGNORECASE)
LETTER = re.compile(r"^\(?[A-Z](?:[).:]+\s*|\s+-\s+)", re.IGNORECASE)
"""The letter that stands before an option."""
NO_ANSWER = re.compile(
    r"(?:(?:i|it|this)(?: am|'m| is|'s)? )?(?:not sure|unsure|unclear|unknown|not known|do not know|can ?not (?:tell|say|know)"
    r"|can ?not be (?:known|told|said|determined))(?: from (?:the|this) video)?"
    r"|(?:none|neither) of the (?:above|others|(?:other )?(?:options|choices|answers|candidates))"
)
"""What a candidate says that names no answer on purpose."""
VERDICTS = {
    **dict.fromkeys(("yes", "correct", "right", "true"), True),
    **dict.fromkeys(("no", "incorrect", "wrong", "false"), False),
}
QUOTE = re.compile("\ue000([0-9]+)\ue001")
"""What replaces the quoted text of an option: its number between two private characters, which `plain` text has not."""
OTHER_SIGN = re.compile(r"[^\w\s.,;:!&+()\[\]{}\"'•\ue000\ue001-]|\b[A-Z] ?- ?[A-Z]\b")
"""Signs that do not stand in a list, and a range of letters."""
LABELLED = re.compile(rf"(?:(?<!\w)([A-Z])[).:]*\s?(?:-\s)?)?{QUOTE.pattern}")


class _Forms:
    """What answers in the words of a vocabulary look like.

    Attributes:
        vocabulary: the vocabulary.
        same_words: other spellings and synonyms of answer words.
        shape_nouns: nouns that name a shape, such as "ball"; they are read where a text has no answer word, as in "a ball".
        beginning: the beginning of a sentence that says an answer, such as "the object is".
        at_rest: a sentence that says that an object does not move.
    """

    def __init__(self, vocabulary: Vocabulary) -> None:
        self.vocabulary = vocabulary
        self.same_words = {word: str(i) for i, word in enumerate(NUMBERS.split())}
        self.same_words |= {synonym: color.word for color in vocabulary.colors for synonym in color.synonyms}
        self.same_words |= {
            synonym: material.word for material in vocabulary.materials for synonym in material.synonyms
        }
        self.same_words |= {shape.plurals[shape.word]: shape.word for shape in vocabulary.shapes}
        self.shape_nouns = {noun: shape for noun, (shape, _) in vocabulary.nouns.items() if shape}
        noun = "|".join(noun for noun, (_, number) in vocabulary.nouns.items() if number == "N")
        subject = rf"(?:(?:it|the (?:\w+ ){{0,3}}(?:{noun})) )?"
        self.beginning = re.compile(rf"{subject}(?:is |moves )?(?:moving )?(?:to )?(?:the |an? )?")
        self.at_rest = re.compile(rf"{subject}(?:is not moving|does not move|not moving)")

    def bare_answer(self, text: str) -> str:
        """What a sentence says of its subject: "red metal cube" of "It is the red metal cube."."""
        sentence = _sentence(text)
        return STATIONARY if self.at_rest.fullmatch(sentence) else self.beginning.sub("", sentence, count=1)

    def one_word(self, text: str, asked_for: Collection[str]) -> str:
        """The one word that a word or sentence names, of those that are asked for."""
        lower = text.casefold().replace("n't", " not ")
        tokens = re.findall(r"[^\s,;:!?\"()\[\]{}/]+", re.sub(r"(?<=[a-z])-(?=[a-z])", " ", lower))
        words = [self._same(_without_marks(token.strip("'<>"))) for token in tokens]
        words = [w for w in words if w]
        numbers = "0" in asked_for
        named = {w for w in words if w in asked_for or (numbers and re.match(r"[.-]?\d", w))}
        if named <= set(self.shape_nouns):
            named |= {self.shape_nouns[w] for w in words if w in self.shape_nouns}.intersection(asked_for)
        leading = re.match(r"(yes|no) ?[,.;:!-]", lower)
        if leading and len(named & {"yes", "no"}) == 1 and not any(w[-1].isdigit() for w in named):
            return leading[1]
        if len(named) > 1:
            raise UnreadableError(f"several answer words: {', '.join(sorted(named)[:4])}")
        if not named.intersection(asked_for):
            raise UnreadableError("no answer word")
        if len(words) > 1 and ("?" in text or DENIALS & set(words) or "no" in words[:-1]):
            raise UnreadableError("a question or a denial")
        if re.search(r"[.!;]\s+\w|\n", text):
            raise UnreadableError("more than one sentence")
        return named.pop()

    def _same(self, word: str) -> str:
        word = self.same_words.get(word, word)
        return word.lstrip("0") or "0" if re.fullmatch("[0-9]+", word) else word


_forms = cache(_Forms)


class UnreadableError(DataError):
    """A response from which no answer can be read; the message says why."""


def plain(text: str) -> str:
    """The text in Unicode's compatibility form, without marks of markdown and formulas, control and private characters.

    Spaces and line breaks are single.
    """
    text = unicodedata.normalize("NFKC", text).translate(SAME_SIGNS)
    text = "".join(c if c == "\n" or unicodedata.category(c)[0] != "C" else " " for c in text)
    text = re.sub(r"[^\S\n]+", " ", re.sub(r"```\w*|[*`_$]+", " ", text))
    return re.sub(r" ?\n[ \n]*", "\n", text).strip()


def is_bare(text: str) -> bool:
    """Whether a text is a single word or number, or letters only."""
    words = re.findall(r"\w+", text)
    return len(words) == 1 or (bool(words) and all(len(w) == 1 or w.casefold() == "and" for w in words))


def read_candidate(text: str, kind: str, answer: str, vocabulary: Vocabulary) -> str | None:
    """The answer that a candidate of an open question says, with or without its letter.

    Args:
        text: the candidate.
        kind: what is asked for, a `nsdr.symbolic.Kind`; only words of this kind count.
        answer: the question's answer; a candidate with the same words says it.
        vocabulary: of attribute words.

    Returns:
        An answer such as "3", "frame 10" or "red metal cube"; None for a candidate such as "not sure" or "none of the above".

    Raises:
        UnreadableError: it says no answer, or several.

    >>> read_candidate("B. The object is stationary.", "direction", "left", Vocabulary())
    'stationary'
    """
    text = LETTER.sub("", plain(text), count=1)
    forms, words = _forms(vocabulary), answer_words(vocabulary)
    bare = forms.bare_answer(text)
    if bare == forms.bare_answer(plain(answer)):
        return answer
    if NO_ANSWER.fullmatch(_sentence(text)):
        return None
    if kind in words:
        return forms.one_word(text, words[kind])
    if kind == "frame" and (frame := re.fullmatch(r"(?:(?:at|in) )?(?:frame )?(\d+)", bare)):
        return f"frame {int(frame[1])}"
    if kind == "speed" and re.fullmatch(r"\d+\.\d", bare):
        return f"{bare} {SPEED_UNIT}"
    if kind == "direction" and STATIONARY not in (bare, answer) and (bare in DIRECTIONS) != (answer in DIRECTIONS):
        raise UnreadableError("a direction in the image for one in the scene, or the reverse")
    patterns = answer_patterns(vocabulary)
    if kind in patterns and patterns[kind].fullmatch(bare):
        return bare
    raise UnreadableError("no answer")


def read_word(text: str, vocabulary: Vocabulary) -> str:
    """The one answer word that a word or sentence of `plain` text names, or the answer beyond CLEVRER that it is.

    Raises:
        UnreadableError: no answer word, several different ones, a denial, a question, or a number that is not whole.
    """
    forms = _forms(vocabulary)
    bare = forms.bare_answer(text)
    if is_beyond(bare, vocabulary):
        return bare
    return forms.one_word(text, frozenset().union(*answer_words(vocabulary).values()))


def _sentence(text: str) -> str:
    """The text in small letters, without signs at its ends and the short forms of "not"."""
    lower = text.casefold().strip(" .!\"'")
    return re.sub(r" +", " ", lower.replace("can't", "cannot").replace("n't", " not"))


def _without_marks(token: str) -> str:
    """The token without full stops and hyphens at its ends; those at its start are kept where a number follows: "-3", ".5"."""
    token = token.rstrip(".-")
    word = token.lstrip(".-")
    return token[len(token) - len(word) - 1 :] if word != token and word[:1].isdigit() else word


def read_letters(text: str, options: Sequence[str]) -> frozenset[str]:
    """The letters that a `plain` text gives as right: alone, in a sentence, with or as the options' texts, or as judgements.

    Raises:
        UnreadableError: no letters, letters beyond the options, other words beside them, or a contradiction.
    """
    letters = option_letters(len(options))
    bare = re.sub(r"\s+", " ", text).strip(" .,;:!\"'()[]{}<>")
    if NONE.fullmatch(bare):
        return frozenset()
    if ALL.fullmatch(bare) or (len(options) == 2 and bare.casefold() == "both"):
        return frozenset(letters)
    if LETTERS.fullmatch(bare):
        return _known(re.findall(r"\b[A-Z]\b", bare.upper()), letters)
    if re.fullmatch("[A-Z]+", bare) and len(set(bare)) == len(bare):
        return _known(bare, letters)
    normal = [" ".join(re.findall(r"\w+", plain(option).casefold())) for option in options]
    marked = _marked(text, normal)
    judged = _judged(marked, normal, letters)
    return _given(marked, normal, letters) if judged is None else judged


def _known(found: Iterable[str], letters: str) -> frozenset[str]:
    """The letters found.

    Raises:
        UnreadableError: some are beyond the options.
    """
    named = frozenset(found)
    if beyond := sorted(named - set(letters)):
        raise UnreadableError(f"{', '.join(beyond)}: the options end at {letters[-1]}")
    return named


def _marked(text: str, normal: Sequence[str]) -> str:
    """The text with a mark in place of each quoted option; where one option's text is part of another's, of the longer one."""
    text = OPINION.sub(" ", text.replace("it's", "it is").replace("It's", "It is"))
    for quoted in sorted({n for n in normal if n}, key=len, reverse=True):
        pattern = r"\W+".join(map(re.escape, quoted.split()))
        mark = f" \ue000{normal.index(quoted)}\ue001"
        text = re.sub(rf"(?<!\w){pattern}(?!\w)", mark, text, flags=re.IGNORECASE)
    return re.sub(r" +", " ", text)


def _quoted(match: re.Match[str], normal: Sequence[str], letters: str) -> str:
    """The letter of a match of `LABELLED`.

    Raises:
        UnreadableError: the letter is that of another text, or there is none and several options have this text.
    """
    same = [letter for letter, n in zip(letters, normal, strict=True) if n == normal[int(match[2])]]
    if match[1] is None and len(same) > 1:
        raise UnreadableError(f"the text of options {', '.join(same)} without a letter")
    if match[1] is not None and match[1] not in same:
        raise UnreadableError(f"{match[1]} with the text of option {same[0]}")
    return match[1] or same[0]


def _judged(marked: str, normal: Sequence[str], letters: str) -> frozenset[str] | None:
    """The letters judged right where each line or part of the text judges one option and none is left out; else None."""
    for separators in (r"\n", r"[,;\n]", r"[,;\n]|\. "):
        judged: list[tuple[str, bool]] = []
        for part in (p for p in re.split(separators, marked) if re.search(r"\w", p)):
            words = re.findall(r"\w+", QUOTE.sub(" ", part))
            quotes = list(LABELLED.finditer(part))
            about = {_quoted(q, normal, letters) for q in quotes} | {w for w in words if re.fullmatch("[A-Z]", w)}
            verdict = VERDICTS.get(words[-1].casefold()) if words else None
            between = [w for w in words[:-1] if w.casefold() not in JUDGING and w not in about]
            if verdict is None or len(about) != 1 or between:
                break
            judged.append((about.pop(), verdict))
        else:
            if sorted(letter for letter, _ in judged) == list(letters):
                return frozenset(letter for letter, right in judged if right)
    return None


def _given(marked: str, normal: Sequence[str], letters: str) -> frozenset[str]:
    """The letters in a text of letters, marks of quoted options and words of `FILLERS` only."""
    found = {_quoted(match, normal, letters) for match in LABELLED.finditer(marked)}
    rest = re.findall(r"\w+", LABELLED.sub(" ", marked))
    other = [w for w in rest if w.casefold() not in FILLERS and not re.fullmatch("[A-Z]", w)] or OTHER_SIGN.findall(
        marked
    )
    if other:
        raise UnreadableError(f"more than letters and options: {' '.join(other)[:40]}")
    found |= _known([w for w in rest if re.fullmatch("[A-Z]", w)], letters)
    if not found:
        raise UnreadableError("no letters")
    return frozenset(found)
