"""Questions as prompts for language models, and the form in which they are asked to answer."""

from collections.abc import Collection
from string import ascii_uppercase

from nsdr.clevrer.files.questions import Question
from nsdr.errors import DataError
from nsdr.io.worlds import WorldSource, as_world
from nsdr.world.vocabulary import DIRECTIONS, SPEED_UNIT, Vocabulary
from nsdr.world.world import CLEVRER_WORLD

__all__ = ["NO_OPTION", "answer_text", "option_letters", "prompt", "solution"]

NO_OPTION = "none"
"""The answer to a multiple-choice question of which no option is right."""
ONE_WORD = "Answer with one word or number inside answer tags, such as <answer>{}</answer>."
SPEED = f"Answer with the speed to one decimal inside answer tags, such as <answer>1.8 {SPEED_UNIT}</answer>."
DIRECTION = (
    f"Answer with {', '.join(DIRECTIONS[:-1])} or {DIRECTIONS[-1]} inside answer tags, such as <answer>left</answer>."
)
OBJECT = "Answer with color, material and shape of the object inside answer tags, such as <answer>{}</answer>."
LETTERS = (
    "Any number of the options may be right. Answer with the letters of all that are, inside answer tags, such as "
    f"<answer>A,C</answer>, or <answer>{NO_OPTION}</answer>."
)
BEYOND = {"speed": SPEED, "direction": DIRECTION, "faster": OBJECT, "heavier": OBJECT}
"""How to answer descriptive questions beyond CLEVRER that take more than one word, by subtype."""


def instructions(vocabulary: Vocabulary) -> tuple[str, ...]:
    """All that prompts say about how to answer."""
    return tuple(_with_example(text, vocabulary) for text in (ONE_WORD, SPEED, DIRECTION, OBJECT, LETTERS))


def _with_example(instruction: str, vocabulary: Vocabulary) -> str:
    example = vocabulary.example
    return instruction.format(example if instruction == OBJECT else example.split()[0])


def option_letters(n: int) -> str:
    """The letters of `n` options: "ABC" for three.

    Raises:
        DataError: more options than letters.
    """
    if n > len(ascii_uppercase):
        raise DataError(f"{n} options: at most {len(ascii_uppercase)} have letters")
    return ascii_uppercase[:n]


def prompt(question: Question, world: WorldSource = CLEVRER_WORLD) -> str:
    """The question, its options with letters, and how to answer, with an example in the words of the world.

    The video goes with it.

    >>> print(prompt(question))
    What will happen next?
    A. The red cube and the gray sphere collide
    B. The cylinder collides with the red cube
    Any number of the options may be right. Answer with the letters of …
    """
    if not question.choices:
        instruction = BEYOND.get(question.subtype or "", ONE_WORD)
        return f"{question.text}\n{_with_example(instruction, as_world(world).vocabulary)}"
    letters = option_letters(len(question.choices))
    options = [f"{letter}. {c.text}" for letter, c in zip(letters, question.choices, strict=True)]
    return "\n".join([question.text, *options, LETTERS])


def answer_text(answer: str | Collection[str]) -> str:
    """What stands between the tags: a word for an open question, else the letters in order, "A,C", or `NO_OPTION`."""
    return answer if isinstance(answer, str) else ",".join(sorted(answer)) or NO_OPTION


def solution(question: Question) -> str:
    """The right answer in its tags: `<answer>red</answer>`, `<answer>A,C</answer>` or `<answer>none</answer>`.

    Raises:
        DataError: the question has no answer in its file.
    """
    if not question.choices:
        if question.answer is None:
            raise DataError(f"question {question.id} has no answer in its file, as in the test split")
        return f"<answer>{answer_text(question.answer)}</answer>"
    if any(c.answer is None for c in question.choices):
        raise DataError(f"question {question.id} has no answers in its file, as in the test split")
    letters = option_letters(len(question.choices))
    right = {letter for letter, c in zip(letters, question.choices, strict=True) if c.answer == "correct"}
    return f"<answer>{answer_text(right)}</answer>"
