"""Files of answers that some system gave: JSON Lines, or an EvalAI submission."""

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, NotRequired, TypedDict

from msgspec import Meta

from nsdr.clevrer.answers.prompts import option_letters
from nsdr.clevrer.answers.responses import Response, read_response_to
from nsdr.clevrer.files.questions import Question
from nsdr.clevrer.files.schema import LARGEST_ID, Id, RecordId, check_unique
from nsdr.errors import DataError
from nsdr.io.files import atomic_path, write_json
from nsdr.io.reading import parse_json_lines, read_json, read_json_bytes
from nsdr.io.worlds import WorldSource
from nsdr.validation import convert, expect
from nsdr.world.world import CLEVRER_WORLD

__all__ = [
    "Given",
    "QuestionKey",
    "read_answers",
    "read_given",
    "read_submission",
    "submission_document",
    "write_responses",
    "write_submission",
]

QuestionKey = tuple[int, int]
"""Scene index, and id of the question within the scene."""
Given = str | Mapping[int, str]
"""A system's answer: its response; or of a submission "correct", "wrong" or "error" by the choice's id."""
ERROR = "error"
"""What systems such as the released executor write, as an answer or as a key, where a program failed."""
Word = str | bool | Annotated[int, Meta(ge=-LARGEST_ID, le=LARGEST_ID)] | None
"""An answer in a file: a text, a number, or true or false for "yes" or "no"; null for none."""


EXAMPLE = '{"id": "10003-7", "response": "A, C"}'
"""A row of a file of answers, for error messages."""


class _Row(TypedDict):
    id: RecordId
    response: Word


def read_answers(path: str | Path) -> dict[QuestionKey, Given]:
    """Read a file of answers; what it is, its content says.

    A JSON Lines file has a row for each question, with its `id` ("10003-7": scene and question) and `response`; other keys
    are ignored.

    Raises:
        DataError: the file is missing or malformed, or answers a question twice; names the file and the row.
    """
    data = read_json_bytes(path)
    start = data.lstrip()[:1]
    if start not in (b"[", b"{"):
        expected = f"a row such as {EXAMPLE} for each question, or an EvalAI submission"
        raise DataError(f"{path}: {'not JSON Lines' if start else 'is empty'}; expected {expected}")
    answers: dict[QuestionKey, Given] = {}
    rows = _of_submission(read_submission(path)) if start == b"[" else _of_lines(data, str(path))
    for place, key, given in rows:
        if key in answers:
            raise DataError(f"{path}{place}: question {key[0]}-{key[1]} is answered twice; keep one of the answers")
        answers[key] = given
    if not answers:
        raise DataError(f"{path}: expected at least 1 answer, found none")
    return answers


def read_given(question: Question, given: Given, world: WorldSource = CLEVRER_WORLD) -> Response:
    """What an answer says: of a response, what `read_response` gives; judgements of choices must be complete."""
    if isinstance(given, str):
        return read_response_to(question, given, world)
    ids = [c.id for c in question.choices]
    if set(ids) != set(given):
        expected = f"those of {sorted(ids)}" if ids else "the word that answers an open question"
        return Response(None, "", f"judgements of the choices {sorted(given)}; expected {expected}")
    letters = option_letters(len(ids))
    right, failed = (
        frozenset(letter for letter, i in zip(letters, ids, strict=True) if given[i] == judgement)
        for judgement in ("correct", ERROR)
    )
    return Response(right, "choices", "", failed)


def write_responses(path: str | Path, responses: Iterable[tuple[QuestionKey, str]]) -> None:
    """Write responses as a JSON Lines file, atomically; `read_answers` reads it."""
    with atomic_path(path) as temporary, temporary.open("w", encoding="utf-8") as file:
        for (scene, question), response in responses:
            file.write(json.dumps({"id": f"{scene}-{question}", "response": response}) + "\n")


def _of_lines(data: bytes, name: str) -> Iterator[tuple[str, QuestionKey, str]]:
    """Where the answer stands, its question and the response."""
    for number, content in parse_json_lines(data, name):
        try:
            row: _Row = convert(content, _Row, f"{name}, line {number}: ")
        except DataError as e:
            raise DataError(f"{e}; expected a row such as {EXAMPLE}") from e
        scene, question = map(int, row["id"].split("-"))
        yield f", line {number}", (scene, question), _text(row["response"])


def _text(word: Word) -> str:
    """An answer as a text."""
    if isinstance(word, bool):
        return "yes" if word else "no"
    return "" if word is None else str(word)


def _of_submission(content: Sequence[Mapping[str, Any]]) -> Iterator[tuple[str, QuestionKey, Given]]:
    """Nothing, as the question says where the answer stands; the question and the judgements or the answer."""
    for scene in content:
        for row in scene["questions"]:
            judged = {c["choice_id"]: c["answer"] for c in row.get("choices", ())}
            yield "", (scene["scene_index"], row["question_id"]), judged if "choices" in row else row["answer"]


class _Choice(TypedDict):
    choice_id: Id
    answer: NotRequired[Literal["correct", "wrong", "error"] | bool]
    error: NotRequired[Any]


class _Question(TypedDict):
    question_id: Id
    answer: NotRequired[Word]
    choices: NotRequired[list[_Choice]]
    error: NotRequired[Any]


class _Scene(TypedDict):
    scene_index: Id
    questions: list[_Question]


def submission_document(results: Iterable[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Make a submission from results, with scenes and questions in ascending order.

    Args:
        results: rows of `nsdr.evaluation.Report.results`: `scene_index`, `question_id`, and `answer` or
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

    Returns:
        Scenes with `scene_index` and `questions`, each with `question_id` and `answer`, a text, or `choices`, each with
        `choice_id` and `answer`: "correct", "wrong" or "error". Numbers and truth values are read as the words that they stand
        for; a question or choice with a key `error` in place of an answer has the answer "error".

    Raises:
        DataError: names the file, the location in the file and what was expected there.
    """
    content: list[dict[str, Any]] = read_json(path, list[_Scene])
    check_unique([scene["scene_index"] for scene in content], f"{path}: ", ".scene_index")
    for s, scene in enumerate(content):
        place = f"{path}: [{s}].questions"
        check_unique([q["question_id"] for q in scene["questions"]], place, ".question_id")
        for q, question in enumerate(scene["questions"]):
            has_answer = not {"answer", "choices", ERROR}.isdisjoint(question)
            expect(has_answer, f"{place}[{q}]", "'answer' or, for a question with options, 'choices'", "neither")
            choices = question.get("choices", ())
            check_unique([c["choice_id"] for c in choices], f"{place}[{q}].choices", ".choice_id")
            for c, choice in enumerate(choices):
                expect(not {"answer", ERROR}.isdisjoint(choice), f"{place}[{q}].choices[{c}]", "'answer'", "none")
                choice["answer"] = _judgement(choice.get("answer", ERROR))
            if "choices" not in question:
                question["answer"] = _text(question.get("answer", ERROR))
    return content


def _judgement(answer: str | bool) -> str:
    """What a choice is judged to be."""
    return answer if isinstance(answer, str) else "correct" if answer else "wrong"
