"""Files of answers that some system gave: JSON Lines, CSV, or an EvalAI submission."""

import csv
import io
import json
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, NotRequired, TypedDict

from nsdr.clevrer.answers.answer_forms import UnreadableError
from nsdr.clevrer.answers.prompts import option_letters
from nsdr.clevrer.answers.responses import Response, read_response_to
from nsdr.clevrer.files.questions import Question
from nsdr.clevrer.files.schema import Id, check_unique
from nsdr.errors import DataError
from nsdr.io.files import atomic_path, write_json
from nsdr.io.reading import parse_json_lines, read_json, read_json_bytes
from nsdr.validation import expect, shown

__all__ = [
    "RESPONSE_KEYS",
    "GivenAnswer",
    "read_answers",
    "read_given",
    "read_submission",
    "submission_document",
    "write_responses",
    "write_submission",
]

RESPONSE_KEYS = ("response", "prediction", "answer")
"""Keys of a row that may hold the response; the first one that a row has counts."""
VIDEO_KEYS = ("video", "video_filename")
"""Keys of a row that may hold the video's file name, with or without folders."""
ID = re.compile(r"([0-9]{1,9})-([0-9]{1,9})")
VIDEO = re.compile(r"(?:.*[/\\])?(?:video_)?([0-9]{1,9})(?:\.\w+)?")


@dataclass(frozen=True)
class GivenAnswer:
    """A system's answer to a question.

    Attributes:
        scene_index: index of the video.
        question_id: id of the question within the video.
        where: its place in the file: "line 3" or "question 3 of scene 10003".
        given: the response; or of a submission "correct" or "wrong" by the choice's id.
    """

    scene_index: int
    question_id: int
    where: str
    given: str | Mapping[int, str]


def read_answers(path: str | Path) -> list[GivenAnswer]:
    """Read a file of answers; what it is, its content says.

    JSON Lines and CSV files (with a header) have a row for each question: `id` ("10003-7": scene and question), or
    `question_id` with `scene_index` or `video` ("video_10003.mp4"); and `response`, `prediction` or `answer`.

    Raises:
        DataError: the file is missing or malformed, or answers a question twice; names the file and the row.
    """
    data = read_json_bytes(path)
    start = data.lstrip()[:1]
    if not start:
        raise DataError(f"{path}: is empty; expected JSON Lines, CSV with a header, or an EvalAI submission")
    if start == b"[":
        answers = list(_of_submission(read_submission(path)))
    else:
        rows = parse_json_lines(data, str(path)) if start == b"{" else _csv_rows(data, path)
        answers = [_answer(row, f"line {number}", f"{path}, line {number}") for number, row in rows]
    if not answers:
        raise DataError(f"{path}: expected at least 1 answer, found none")
    seen: dict[tuple[int, int], str] = {}
    for answer in answers:
        key = (answer.scene_index, answer.question_id)
        if key in seen:
            raise DataError(
                f"{path}: question {key[0]}-{key[1]} is answered twice, in {seen[key]} and {answer.where}; keep one of them"
            )
        seen[key] = answer.where
    return answers


def read_given(question: Question, given: str | Mapping[int, str]) -> Response:
    """What an answer says: of a response as of `read_response`; judgements of choices must be complete."""
    if isinstance(given, str):
        return read_response_to(question, given)
    try:
        return Response(_judged(question, given), "choices", "")
    except UnreadableError as e:
        return Response(None, "", str(e))


def write_responses(path: str | Path, responses: Iterable[tuple[int, int, str]]) -> int:
    """Write (scene index, question id, response) rows as a JSON Lines file, atomically; returns their number."""
    count = 0
    with atomic_path(path) as temporary, temporary.open("w", encoding="utf-8") as file:
        for scene, question, response in responses:
            row = {"id": f"{scene}-{question}", "scene_index": scene, "question_id": question, "response": response}
            file.write(json.dumps(row) + "\n")
            count += 1
    return count


def _judged(question: Question, given: Mapping[int, str]) -> frozenset[str]:
    ids = [c.id for c in question.choices]
    if not ids:
        raise UnreadableError("choices, of an open question")
    if set(ids) != set(given):
        raise UnreadableError(f"judgements of the choices {sorted(given)}; expected {sorted(ids)}")
    letters = option_letters(len(ids))
    return frozenset(letter for letter, i in zip(letters, ids, strict=True) if given[i] == "correct")


def _of_submission(content: Sequence[Mapping[str, Any]]) -> Iterator[GivenAnswer]:
    for scene in content:
        for row in scene["questions"]:
            index, number = scene["scene_index"], row["question_id"]
            choices = {c["choice_id"]: c["answer"] for c in row.get("choices", ())}
            given = choices if "choices" in row else row["answer"]
            yield GivenAnswer(index, number, f"question {number} of scene {index}", given)


def _csv_rows(data: bytes, path: str | Path) -> Iterator[tuple[int, dict[str, str]]]:
    """(line number, row) of a CSV file; the line is the one on which the row ends."""
    try:
        reader = csv.DictReader(io.StringIO(data.decode(), newline=""), strict=True)
        known = {"id", "scene_index", *VIDEO_KEYS} & set(reader.fieldnames or ())
        if not known or not set(RESPONSE_KEYS) & set(reader.fieldnames or ()):
            expected = f"id (or question_id and scene_index) and {' or '.join(RESPONSE_KEYS)}"
            found = shown(", ".join(reader.fieldnames or ()))
            raise DataError(
                f"{path}: expected JSON Lines, an EvalAI submission, or CSV with the columns {expected}; got {found}"
            )
        names = [name for name in reader.fieldnames or () if name in {*known, "question_id", *RESPONSE_KEYS}]
        if twice := [name for name, n in Counter(names).items() if n > 1]:
            raise DataError(f"{path}: has the column {twice[0]} twice; expected one")
        for row in reader:
            if None in row or None in row.values():
                raise DataError(
                    f"{path}, line {reader.line_num}: expected {len(reader.fieldnames or ())} cells; quote commas"
                )
            yield reader.line_num, row
    except (csv.Error, UnicodeDecodeError) as e:
        raise DataError(f"{path}: not a readable CSV file ({e})") from e


def _answer(row: Any, place: str, where: str) -> GivenAnswer:
    if not isinstance(row, dict):
        raise DataError(f"{where}: expected an object, got {shown(row)}")
    key = next((k for k in RESPONSE_KEYS if k in row), None)
    if key is None:
        raise DataError(f"{where}: has none of {', '.join(RESPONSE_KEYS)}")
    value = row[key]
    given = value if isinstance(value, str) else "" if value is None else json.dumps(value)
    return GivenAnswer(*_question(row, where), place, given)


def _question(row: Mapping[str, Any], where: str) -> tuple[int, int]:
    """Scene and question of a row.

    Raises:
        DataError: they are missing or malformed, or contradict each other.
    """
    found = set[tuple[int, int]]()
    if "id" in row and ("question_id" not in row or ID.fullmatch(str(row["id"]))):
        match = ID.fullmatch(str(row["id"]))
        if match is None:
            raise DataError(f"{where}.id: {shown(row['id'])}; expected SCENE_INDEX-QUESTION_ID, such as 10003-7")
        found.add((int(match[1]), int(match[2])))
    if "question_id" in row:
        question = _number(row["question_id"], f"{where}.question_id")
        if "scene_index" in row:
            found.add((_number(row["scene_index"], f"{where}.scene_index"), question))
        for key in (k for k in VIDEO_KEYS if k in row):
            video = VIDEO.fullmatch(str(row[key]))
            if video is None:
                raise DataError(f"{where}.{key}: {shown(row[key])}; expected a name such as video_10003.mp4")
            found.add((int(video[1]), question))
    if not found:
        raise DataError(f"{where}: expected id, or question_id with scene_index or video; got {shown(', '.join(row))}")
    if len(found) > 1:
        named = " and ".join(f"{scene}-{question}" for scene, question in sorted(found))
        raise DataError(f"{where}: names the questions {named}; expected one")
    return found.pop()


def _number(value: Any, where: str) -> int:
    if not re.fullmatch(r"[0-9]{1,9}", str(value)) or isinstance(value, bool):
        raise DataError(f"{where}: {shown(value)}; expected a whole number from 0")
    return int(value)


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
    content: list[dict[str, Any]] = read_json(path, list[_Scene])
    check_unique([scene["scene_index"] for scene in content], f"{path}: ", ".scene_index")
    for s, scene in enumerate(content):
        place = f"{path}: [{s}].questions"
        check_unique([q["question_id"] for q in scene["questions"]], place, ".question_id")
        for q, question in enumerate(scene["questions"]):
            has_answer = "answer" in question or "choices" in question
            expect(has_answer, f"{place}[{q}]", "'answer' or, for a question with options, 'choices'", "neither")
            check_unique([c["choice_id"] for c in question.get("choices", ())], f"{place}[{q}].choices", ".choice_id")
    return content
