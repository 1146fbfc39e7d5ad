"""Submission files of answers to the test split (EvalAI)."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from nsdr.clevrer.files.schema import LARGEST_ID, check_new, get, get_scene_index, get_whole, shown
from nsdr.errors import DataError
from nsdr.io.files import write_json
from nsdr.io.reading import read_json

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
    scenes: set[int] = set()
    for s, scene in enumerate(content):
        where = f"{path}: [{s}]"
        index = get_scene_index(scene, "scene_index", where)
        check_new(index, scenes, f"{where}.scene_index")
        scenes.add(index)
        questions: set[int] = set()
        for q, question in enumerate(get(scene, "questions", list, where)):
            question_where = f"{where}.questions[{q}]"
            number = get_whole(question, "question_id", question_where, 0, LARGEST_ID)
            check_new(number, questions, f"{question_where}.question_id")
            questions.add(number)
            if "choices" not in question:
                if "answer" not in question:
                    raise DataError(
                        f"{question_where}: has neither 'answer' nor, for a question with options, 'choices'"
                    )
                get(question, "answer", str, question_where)
                continue
            choices: set[int] = set()
            for c, choice in enumerate(get(question, "choices", list, question_where)):
                choice_where = f"{question_where}.choices[{c}]"
                number = get_whole(choice, "choice_id", choice_where, 0, LARGEST_ID)
                check_new(number, choices, f"{choice_where}.choice_id")
                choices.add(number)
                if get(choice, "answer", str, choice_where) not in ("correct", "wrong"):
                    raise DataError(f"{choice_where}.answer: expected correct or wrong, got {shown(choice['answer'])}")
    return content
