"""Reads the answers in the free text of language models, without guessing."""

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

from nsdr.clevrer.answers.answer_forms import UnreadableError, is_bare, plain, read_letters, read_word
from nsdr.clevrer.answers.prompts import NO_OPTION, instructions, option_letters
from nsdr.clevrer.files.questions import Question
from nsdr.io.worlds import WorldSource, as_world
from nsdr.world.vocabulary import Vocabulary
from nsdr.world.world import CLEVRER_WORLD

__all__ = ["Response", "read_response", "read_response_to"]

THINKING = re.compile(r"<\s*think(?:ing)?\s*>", re.IGNORECASE)
THOUGHT = re.compile(r"<\s*/\s*think(?:ing)?\s*>", re.IGNORECASE)
THOUGHTS = re.compile(f"{THINKING.pattern}.*?{THOUGHT.pattern}", re.IGNORECASE | re.DOTALL)
TAG = re.compile(r"<\s*(?:(/)\s*)?answers?\s*>", re.IGNORECASE)
LAST_PAIR = re.compile(r"<\s*answers?\s*>[^<>]*<\s*/\s*answers?\s*>\s*\Z", re.IGNORECASE)
LABEL = re.compile(
    r"\b(final\s+)?(?:answers?|(?:correct|right)\s+(?:options?|choices?))(?:\s*[:=]|\s+(?:is|are)\b\s*:?)",
    re.IGNORECASE,
)
RETRACTION = re.compile(r"\b(?:wait|actually|correction|oops|sorry|wrong|incorrect)\b|\bno,", re.IGNORECASE)
REASON = re.compile(r"\b(?:because|since)\b", re.IGNORECASE)
FENCE = re.compile(r"```(?:json)?([^`]*)```", re.IGNORECASE)
BOX = re.compile(r"\\boxed\s*\{")
BOXED = re.compile(r"((?:[^{}]|\{(?:[^{}]|\{[^{}]*\})*\})*)\}")
"""What stands in a box, with braces in braces."""
LATEX_TEXT = re.compile(r"\\(?:text|textbf|mathrm|mathbf)\s*\{([^{}]*)\}")
ANSWER_KEYS = ("answer", "answers", "final_answer")
"""Keys of a JSON object that hold an answer."""
Answer = str | frozenset[str]
MAX_LENGTH = 100_000
"""Longest response that is read (characters)."""


@dataclass(frozen=True)
class Response:
    """What was read in a response.

    Attributes:
        answer: the answer word of an open question, or the letters of the options given as right (none may be); None if it
            cannot be read.
        how: where it was found: "tags", "boxed", "json", "label" (after "Answer:"), "bare" (the whole response is a word or
            letters), "text" (it is a sentence or quotes options), "line" (the first or last), or "choices" where an EvalAI
            submission judges each one; "" if it cannot be read.
        problem: why it cannot be read; "" if it can.
        failed: letters of the options on which the system says that it failed, in a submission.
    """

    answer: Answer | None
    how: str
    problem: str
    failed: frozenset[str] = frozenset()


def read_response(text: str, options: Sequence[str] = (), world: WorldSource = CLEVRER_WORLD) -> Response:
    """Read a model's answer.

    What stands in `<think>` tags is passed over. Of several `<answer>` pairs or boxes the last one counts. A response that
    contradicts itself, names several different words, has letters beyond the options or says more than an answer does is
    not read.

    >>> read_response("<think>A or B?</think><answer>A, C</answer>", ["it exits", "it enters", "it rests"])
    Response(answer=frozenset({'A', 'C'}), how='tags', problem='', failed=frozenset())

    Args:
        text: the response.
        options: texts of the options A, B, …; empty for an open question.
        world: whose words answers have.

    Raises:
        DataError: more options than letters, or the world's file cannot be read. No text raises.
    """
    option_letters(len(options))
    if len(text) > MAX_LENGTH:
        return Response(None, "", f"{len(text)} characters; at most {MAX_LENGTH} are read")

    try:
        answer, how = _Reader(options, as_world(world).vocabulary).read(text)
    except UnreadableError as e:
        return Response(None, "", str(e))
    return Response(answer, how, "")


def read_response_to(question: Question, text: str, world: WorldSource = CLEVRER_WORLD) -> Response:
    """`read_response` with the options of a question."""
    return read_response(text, [c.text for c in question.choices], world)


class _Reader:
    """Reads responses to an open question, or to one with options."""

    def __init__(self, options: Sequence[str], vocabulary: Vocabulary) -> None:
        self.options, self.vocabulary = options, vocabulary

    def read(self, text: str) -> tuple[Answer, str]:
        """The answer and where it was found."""
        text = re.sub(r"<\|\w+\|>|</s>", "", _thought_through(text))  # without end-of-text tokens
        for instruction in instructions(self.vocabulary):  # a prompt that is repeated holds examples in tags
            text = text.replace(instruction, "")
        if not text.strip():
            raise UnreadableError("an empty response")
        if (inside := _tagged(text)) is not None:
            return self.inside(inside), "tags"
        if (inside := _boxed(text)) is not None:
            return self.inside(inside), "boxed"
        if (value := _json(text)) is not None:
            return self.of_json(value), "json"
        text = plain(text)
        if labels := _labelled(text):
            answers = {self.after_label(label) for label in labels}
            if len(answers) > 1:
                raise UnreadableError("several different answers")
            return answers.pop(), "label"
        try:
            return self.words(text), "bare" if is_bare(text) else "text"
        except UnreadableError:
            lines = text.splitlines()
            bare = [i for i, line in enumerate(lines) if is_bare(line)]
            if not bare or bare[0] != bare[-1] or bare[0] not in (0, len(lines) - 1):
                raise
            return self.first(lines[bare[0]], "" if bare[0] else "\n".join(lines[1:])), "line"

    def words(self, text: str) -> Answer:
        """The answer that a `plain` text is."""
        return read_letters(text, self.options) if self.options else read_word(text, self.vocabulary)

    def inside(self, text: str) -> Answer:
        """The answer in tags or a box, which may hold a box, JSON or a label itself."""
        if not text.strip():
            raise UnreadableError("an empty answer")
        if (boxed := _boxed(text)) is not None:
            text = boxed
        if (value := _json(text)) is not None:
            return self.of_json(value)
        labels = _labelled(plain(text))
        return self.after_label(labels[0]) if len(labels) == 1 else self.words(plain(text))

    def after_label(self, text: str) -> Answer:
        """The answer in all that follows a label, or in its first line up to a reason."""
        try:
            return self.words(text)
        except UnreadableError:
            first = REASON.split(text.splitlines()[0])[0] if text else ""
            return self.first(first, text[len(first) :])

    def first(self, first: str, rest: str) -> Answer:
        """The answer of the first words, where the rest names no option beyond it, and takes no word back."""
        answer = self.words(first)
        if isinstance(answer, str) and RETRACTION.search(rest):
            raise UnreadableError("a word, and then a text that may take it back")
        if isinstance(answer, frozenset) and (others := set(_other_letter(self.vocabulary).findall(rest)) - answer):
            raise UnreadableError(f"{', '.join(sorted(others))}, after an answer without it")
        return answer

    def of_json(self, value: Any) -> Answer:
        """The answer of a JSON value: a text, a number or a list of options, or one of these under an answer's key."""
        if isinstance(value, dict):
            keys = [key for key in value if key.casefold() in ANSWER_KEYS]
            if len(keys) != 1:
                raise UnreadableError(f"a JSON object without one of the keys {', '.join(ANSWER_KEYS)}")
            value = value[keys[0]]
        if isinstance(value, list) and all(isinstance(v, str) for v in value):
            value = "\n".join(value) if value else NO_OPTION
        if isinstance(value, bool) or not isinstance(value, str | int):
            raise UnreadableError("a JSON value that is neither a text, a whole number nor a list of texts")
        return self.words(plain(str(value)))


@cache
def _other_letter(vocabulary: Vocabulary) -> re.Pattern[str]:
    """A letter that an explanation names; neither the pronoun "I" nor the article of "A red cube"."""
    nouns = "|".join((*vocabulary.adjectives, *vocabulary.nouns, "collision"))
    return re.compile(rf"\b(?:[B-HJ-Z]|A(?! (?:{nouns})\b))\b")


def _thought_through(text: str) -> str:
    """The text without its thinking, whose opening tag many templates put in the prompt.

    Thinking that never ends reaches to an answer pair that ends the text, or to the end.
    """
    end = max((tag.end() for tag in THOUGHT.finditer(text)), default=0)
    text = THOUGHT.split(THOUGHTS.sub(" ", text[:end]))[-1] + text[end:]
    before, *thinking = THINKING.split(text, maxsplit=1)
    if not thinking:
        return text
    if last := LAST_PAIR.search(thinking[0]):
        return last[0]
    if not before.strip():
        raise UnreadableError("it ends inside its thinking")
    return before


def _tagged(text: str) -> str | None:
    """What stands in the last answer tags; they may lack either tag."""
    tags = list(TAG.finditer(text))
    if not tags:
        return None
    opening = next((i for i in reversed(range(len(tags))) if not tags[i][1]), None)
    if opening is None:
        return text[: tags[0].start()]
    closing = tags[opening + 1].start() if opening + 1 < len(tags) else len(text)
    return text[tags[opening].end() : closing]


def _boxed(text: str) -> str | None:
    """What stands in the last `\\boxed{}`."""
    if not (boxes := list(BOX.finditer(text))):
        return None
    if closed := BOXED.match(text, boxes[-1].end()):
        return LATEX_TEXT.sub(r"\1", closed[1])
    raise UnreadableError("a box that is not closed")


def _json(text: str) -> Any:
    """The list, object or text that a response is in JSON, or that stands in its last code fence; None if there is none."""
    fenced = FENCE.findall(text)
    text = (fenced[-1] if fenced else text).strip()
    if not text.startswith(("[", "{", '"')):
        return None
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        return None


def _labelled(text: str) -> list[str]:
    """What stands between each "Answer:" or the like and the next; only the last "Final answer:" where there is one."""
    labels = list(LABEL.finditer(text))
    ends = [*(label.start() for label in labels[1:]), len(text)]
    found = [(bool(label[1]), text[label.end() : end].strip()) for label, end in zip(labels, ends, strict=False)]
    finals = [rest for final, rest in found if final]
    return finals[-1:] or [rest for _, rest in found]
