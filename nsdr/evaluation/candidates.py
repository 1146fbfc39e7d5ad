"""Scores questions with candidates of which one is right, as MVBench and TVBench pose them about CLEVRER's videos."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, TypedDict

from msgspec import Meta

from nsdr.clevrer.answers.answer_files import Given, QuestionKey
from nsdr.clevrer.answers.prompts import option_letters
from nsdr.clevrer.answers.responses import read_response
from nsdr.errors import DataError
from nsdr.evaluation.measures import accuracy_interval
from nsdr.io.reading import is_json_lines, parse_json, read_json, read_json_bytes
from nsdr.validation import convert

_VIDEO = re.compile(r"video_(\d{5})\.mp4\Z")


class CandidateQuestion(TypedDict):
    """A row of MVBench's `moving_count.json` or TVBench's `object_count.json`, for example; other keys are ignored."""

    video: Annotated[str, Meta(pattern=r"video_[0-9]{5}\.mp4$")]
    question: str
    candidates: Annotated[list[str], Meta(min_length=2)]
    answer: str


def is_candidate_file(path: str | Path) -> bool:
    """Whether a question file has the benchmarks' layout: rows with `candidates`."""
    data = read_json_bytes(path)
    content = None if is_json_lines(data) else parse_json(data, str(path))
    return isinstance(content, list) and bool(content) and isinstance(content[0], dict) and "candidates" in content[0]


def read_candidate_questions(path: str | Path) -> dict[QuestionKey, CandidateQuestion]:
    """Questions by the number of their video (`video_10009.mp4`) and their place in the file, from 0.

    Raises:
        DataError: the file is malformed, or an answer is not exactly one of its candidates; names the row.
    """
    questions: dict[QuestionKey, CandidateQuestion] = {}
    for number, content in enumerate(read_json(path, list[Any])):
        row: CandidateQuestion = convert(content, CandidateQuestion, f"{path}: [{number}]: ")
        if row["candidates"].count(row["answer"]) != 1:
            expected = f"the answer {row['answer']!r} to be one of the candidates"
            raise DataError(f"{path}: [{number}]: expected {expected}, got {', '.join(row['candidates'])}")
        found = _VIDEO.search(row["video"])
        assert found is not None  # the type's pattern
        questions[int(found[1]), number] = row
    return questions


def score_candidates(
    questions: Mapping[QuestionKey, CandidateQuestion], given: Mapping[QuestionKey, Given], allow_missing: bool = False
) -> dict[str, Any]:
    """The accuracy (0-1) with its 95 % interval, that of guessing, and the counts; what cannot be read is wrong.

    Args:
        questions: as `read_candidate_questions` gives them.
        given: responses, as `nsdr.clevrer.read_answers` gives them: letters, or a candidate's text.
        allow_missing: score the answered questions only; else those without an answer count as wrong.

    Raises:
        DataError: no response is about one of the questions.
    """
    answered = questions.keys() & given.keys()
    if not answered:
        raise DataError(f"none of the {len(given)} answers is about one of the {len(questions)} questions")
    kept = [key for key in questions if key in answered or not allow_missing]
    right: list[bool] = []
    unread: list[str] = []
    for key in kept:
        row = questions[key]
        response = read_response(str(given.get(key, "")), row["candidates"])
        if response.answer is None and key in given:
            unread.append(f"{key[0]}-{key[1]}")
        letter = option_letters(len(row["candidates"]))[row["candidates"].index(row["answer"])]
        right.append(response.answer == frozenset(letter))
    chance = sum(1 / len(questions[key]["candidates"]) for key in kept) / len(kept)
    return {
        "accuracy": sum(right) / len(kept),
        "interval": accuracy_interval(right, [key[0] for key in kept]),
        "chance": chance,
        "questions": len(questions),
        "answered": len(answered),
        "scored": len(kept),
        "unread": unread,
    }


def candidates_text(scores: Mapping[str, Any]) -> str:
    """The scores in two lines."""
    low, high = scores["interval"]
    first = f"accuracy {scores['accuracy']:.1%} ({low:.1%} to {high:.1%}); guessing {scores['chance']:.1%}"
    counts = f"{scores['answered']} of {scores['questions']} questions have an answer; {scores['scored']} are scored"
    return f"{first}\n{counts}; {len(scores['unread'])} responses cannot be read and count as wrong"
