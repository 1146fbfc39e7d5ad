"""Generation of balanced questions about scenes with known ground truth, and statistics of question sets."""

from typing import TYPE_CHECKING

from nsdr.io.lazy import lazy_exports

if TYPE_CHECKING:
    from nsdr.generate.questions.selection import (
        Candidates,
        QuestionConfig,
        find_candidates,
        generate_questions,
        select_questions,
    )
    from nsdr.generate.questions.statistics import count_questions, write_question_statistics

_HOME = {
    "nsdr.generate.questions.selection": [
        "Candidates",
        "QuestionConfig",
        "find_candidates",
        "generate_questions",
        "select_questions",
    ],
    "nsdr.generate.questions.statistics": ["count_questions", "write_question_statistics"],
}

__all__ = [
    "Candidates",
    "QuestionConfig",
    "count_questions",
    "find_candidates",
    "generate_questions",
    "select_questions",
    "write_question_statistics",
]

__getattr__, __dir__ = lazy_exports(__name__, _HOME, __all__)
