"""Rules for requests of strangers on the page and through agents: limits on their texts, and messages without folders."""

import re
from collections.abc import Sequence

from nsdr.errors import DataError

MAX_QUESTION_CHARACTERS = 500
"""Length of a question (characters)."""
MAX_CHOICES = 26
"""Choices of a question: as many as letters that can name them."""
MAX_CHOICES_CHARACTERS = 3000
"""Length of all choices of a question together (characters). Unreadable ones of this length take about a second."""
MAX_PROGRAM_CHARACTERS = 5000
"""Length of a program in postfix, or of all programs of choices together (characters)."""


def check_asked(question: str, choices: Sequence[str]) -> None:
    """Refuse a question or choices that are too long, or too many choices.

    Raises:
        DataError: says which, and the limit.
    """
    _check(len(question), MAX_QUESTION_CHARACTERS, "the question", "characters")
    _check(len(choices), MAX_CHOICES, "a question", "choices")
    _check(sum(map(len, choices)), MAX_CHOICES_CHARACTERS, "all choices together", "characters")


def check_programs(program: str, choice_programs: Sequence[str]) -> None:
    """Refuse programs that are too long, or too many of them; raises `DataError` as `check_asked`."""
    _check(len(program), MAX_PROGRAM_CHARACTERS, "the program", "characters")
    _check(len(choice_programs), MAX_CHOICES, "a question", "choice programs")
    _check(sum(map(len, choice_programs)), MAX_PROGRAM_CHARACTERS, "all choice programs together", "characters")


def _check(number: int, most: int, what: str, unit: str) -> None:
    if number > most:
        raise DataError(f"{what} may have at most {most:,} {unit}, not {number:,}")


def without_folders(message: str) -> str:
    """The message with absolute paths shortened to the names of files, as folders are none of a stranger's business.

    Folders with spaces are told from words only at the start, where errors name their file.
    """
    message = re.sub(r"\A/(?:[^/:\n]+/)+", "", message)
    return re.sub(r"(?<![\w.~/<])/(?:[^\s/:'\"]+/)+(?=[^\s/:'\"]+)", "", message)
