"""Submission files of answers to the test split (EvalAI)."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from nsdr.clevrer.schema import get
from nsdr.errors import DataError
from nsdr.io.files import read_json, write_json

__all__ = ["read_submission", "submission_document", "write_submission"]


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
    content = read_json(path)
    if not isinstance(content, list):
        raise DataError(f"{path}: expected a list of scenes, got {type(content).__name__}")
    for s, scene in enumerate(content):
        where = f"{path}: [{s}]"
        get(scene, "scene_index", int, where)
        for q, question in enumerate(get(scene, "questions", list, where)):
            question_where = f"{where}.questions[{q}]"
            get(question, "question_id", int, question_where)
            if "choices" not in question:
                get(question, "answer", str, question_where)
                continue
            for c, choice in enumerate(get(question, "choices", list, question_where)):
                choice_where = f"{question_where}.choices[{c}]"
                get(choice, "choice_id", int, choice_where)
                if get(choice, "answer", str, choice_where) not in ("correct", "wrong"):
                    raise DataError(f"{choice_where}.answer: expected correct or wrong, got {choice['answer']!r}")
    return content
