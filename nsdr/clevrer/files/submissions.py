"""Submission files of answers to the test split (EvalAI)."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Literal, NotRequired, TypedDict

from nsdr.clevrer.files.schema import Id, check_unique
from nsdr.io.files import write_json
from nsdr.io.reading import read_typed
from nsdr.validation import expect

__all__ = ["read_submission", "submission_document", "write_submission"]


class _Choice(TypedDict):
    choice_id: Id
    answer: Literal["correct", "wrong"]


class _Question(TypedDict):
    question_id: Id
    answer: NotRequired[str]
    choices: NotRequired[list[_Choice]]


class _Scene(TypedDict):
    scene_index: Id
    questions: list[_Question]


def submission_document(results: Iterable[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Make a submission from results, with scenes and questions in ascending order.

    Args:
        results: rows as listed by `nsdr.evaluation.score.evaluate`: `scene_index`, `question_id`, and `answer` or
            `choices: [{choice_id, answer}]`. A row with neither is submitted as the answer "error".
    """
    scenes: dict[int, list[dict[str, Any]]] = {}
    for result in results:
        row: dict[str, Any] = {"question_id": result["question_id"]}
        if "choices" in result:
            row["choices"] = [{"choice_id": c["choice_id"], "answer": c["answer"]} for c in result["choices"]]
        else:
            row["answer"] = str(result.get("answer", "error"))
        scenes.setdefault(result["scene_index"], []).append(row)
    return [
        {"scene_index": scene, "questions": sorted(rows, key=lambda r: int(r["question_id"]))}
        for scene, rows in sorted(scenes.items())
    ]


def write_submission(path: str | Path, results: Iterable[Mapping[str, Any]]) -> None:
    """Write `submission_document(results)`, atomically."""
    write_json(path, submission_document(results))


def read_submission(path: str | Path) -> list[dict[str, Any]]:
    """Read and check a submission file.

    Raises:
        DataError: names the file, the location in the file and what was expected there.
    """
    content: list[dict[str, Any]] = read_typed(path, list[_Scene])
    check_unique([scene["scene_index"] for scene in content], f"{path}: ", ".scene_index")
    for s, scene in enumerate(content):
        place = f"{path}: [{s}].questions"
        check_unique([q["question_id"] for q in scene["questions"]], place, ".question_id")
        for q, question in enumerate(scene["questions"]):
            has_answer = "answer" in question or "choices" in question
            expect(has_answer, f"{place}[{q}]", "'answer' or, for a question with options, 'choices'", "neither")
            check_unique([c["choice_id"] for c in question.get("choices", ())], f"{place}[{q}].choices", ".choice_id")
    return content
