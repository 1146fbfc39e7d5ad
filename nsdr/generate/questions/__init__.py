"""Generation of balanced questions about scenes with known ground truth, and statistics of question sets."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

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
_MODULE_OF = {name: module for module, names in _HOME.items() for name in names}

__all__ = [
    "Candidates",
    "QuestionConfig",
    "count_questions",
    "find_candidates",
    "generate_questions",
    "select_questions",
    "write_question_statistics",
]


def __getattr__(name: str) -> Any:
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'nsdr.generate.questions' has no attribute {name!r}")
    return getattr(import_module(_MODULE_OF[name]), name)


def __dir__() -> list[str]:
    return __all__
