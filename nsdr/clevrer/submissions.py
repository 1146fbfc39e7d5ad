"""Submission files for the test split (EvalAI)."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from nsdr.clevrer.schema import get
from nsdr.errors import DataError
from nsdr.io.files import read_json, write_json

__all__ = ["read_submission", "submission_document", "write_submission"]


def submission_document(results: Iterable[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """The submission of results as `nsdr.evaluation.score.evaluate` lists them; scenes and questions in ascending order.

    Args:
        results: each with `scene_index`, `question_id`, and `answer` or `choices: [{choice_id, answer}]`.
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
    """The content of a submission file, checked.

    Raises:
        DataError: names the file, the position inside the JSON and what was expected there.
    """
    content = read_json(path)
    if not isinstance(content, list):
        raise DataError(f"{path}: expected a list of scenes, got {type(content).__name__}")
    for s, scene in enumerate(content):
        where = f"{path}: [{s}]"
        get(scene, "scene_index", int, where)
        for q, question in enumerate(get(scene, "questions", list, where)):
            position = f"{where}.questions[{q}]"
            get(question, "question_id", int, position)
            if "choices" not in question:
                get(question, "answer", str, position)
                continue
            for c, choice in enumerate(get(question, "choices", list, position)):
                get(choice, "choice_id", int, f"{position}.choices[{c}]")
                if get(choice, "answer", str, f"{position}.choices[{c}]") not in ("correct", "wrong"):
                    raise DataError(
                        f"{position}.choices[{c}].answer: expected correct or wrong, got {choice['answer']!r}"
                    )
    return content
