"""Bad files of answers: JSON Lines and CSV. EvalAI submissions are among the documents."""

import json
from collections.abc import Iterator
from typing import Any

from tests.robustness.case import Case, dumped, raw, text_writer
from tests.robustness.files import DAMAGES
from tests.robustness.good import QUESTIONS_OF, csv_answers, json_line_answers

__all__ = ["answer_controls", "answer_file_cases"]

ROWS: dict[str, Any] = {
    "list": [1], "number": 5, "text": "x", "null": None, "empty": {},
    "no response": {"id": "10000-1"}, "no question": {"response": "1"}, "id of words": {"id": "zebra", "response": "1"},
    "id as number": {"id": 10000, "response": "1"}, "id as list": {"id": ["10000-1"], "response": "1"},
    "negative id": {"id": "10000--1", "response": "1"}, "id of 5,000 digits": {"id": f"{'9' * 5000}-0", "response": "1"},
    "id with a blank": {"id": "10000-1 ", "response": "1"}, "id of other digits": {"id": "10000-\u0661", "response": "1"},
    "question without scene": {"question_id": 1, "response": "1"},
    "question as fraction": {"question_id": 1.5, "scene_index": 10000, "response": "1"},
    "question as boolean": {"question_id": True, "scene_index": 10000, "response": "1"},
    "negative question": {"question_id": -1, "scene_index": 10000, "response": "1"},
    "scene as boolean": {"question_id": 1, "scene_index": False, "response": "1"},
    "scene of words": {"question_id": 1, "scene_index": "x", "response": "1"},
    "video of words": {"question_id": 1, "video": "zebra.mp4", "response": "1"},
    "video as list": {"question_id": 1, "video": ["video_10000.mp4"], "response": "1"},
    "id of another scene": {"id": "10000-1", "question_id": 1, "scene_index": 10001, "response": "1"},
    "video of another scene": {"question_id": 1, "scene_index": 10000, "video": "video_10001.mp4", "response": "1"},
    "second answer": {"id": "10000-0", "response": "1"},
    "NaN": {"id": "10000-1", "response": raw("NaN")}, "lone surrogate": {"id": "10000-1", "response": "\ud800"},
    "number of 5,000 digits": {"id": "10000-1", "response": raw("9" * 5000)},
    "two objects on a line": raw('{"id": "10000-1", "response": "1"} {"id": "10000-2", "response": "1"}'),
}  # fmt: skip
"""Bad rows in place of the second one."""
CSV = {
    "no header": "10000-0,1\n10000-1,none\n", "header only": "id,response\n", "no responses": "id,text\n10000-0,1\n",
    "no ids": "number,response\n1,1\n", "other separator": "id;response\n10000-0;1\n", "tabs": "id\tresponse\n10000-0\t1\n",
    "cell missing": "id,response\n10000-0\n", "cell too much": "id,response\n10000-0,1,2\n",
    "unclosed quote": 'id,response\n10000-0,"1\n10000-1,none\n', "text after a quote": 'id,response\n10000-0,"1"x\n',
    "column twice": "id,response,response\n10000-0,1,2\n10000-1,none,A\n", "id twice": "id,id,response\n10000-0,10000-1,1\n",
    "question twice": "id,response\n10000-0,1\n10000-0,1\n", "cell of a megabyte": f"id,response\n10000-0,{'x' * 1_000_000}\n",
    "empty id": "id,response\n,1\n", "fraction as id": "question_id,scene_index,response\n0.0,10000.0,1\n",
    "100,000 columns": "id,response" + ",x" * 100_000 + "\n",
}  # fmt: skip
"""Bad CSV files."""
WHOLE = ("empty list", "empty object", "single quotes", "last byte missing")
"""Damages that a document of one value has, and lines have not."""


def _score(file: str) -> tuple[str, ...]:
    return ("score", file, *QUESTIONS_OF, "-o", "report.json")


def _text(rows: list[Any]) -> str:
    return "".join(f"{dumped(row)}\n" for row in rows)


def answer_file_cases() -> Iterator[Case]:
    """All bad files of answers."""
    good = json_line_answers()
    for name, row in ROWS.items():
        unescaped = row[5:-1] + "\n" if isinstance(row, str) and row.startswith("@raw {") else _text([row])
        content = _text(good[:1]) + unescaped
        yield Case("answers, row", name, _score("a.jsonl"), text_writer("a.jsonl", content), "a.jsonl", "line 2")
    for name, damage in DAMAGES.items():
        if name not in WHOLE:
            write = text_writer("a.jsonl", damage(_text(good).encode()))
            yield Case("answers, file", name, _score("a.jsonl"), write, "a.jsonl")
    for name, content in CSV.items():
        yield Case("answers, CSV", name, _score("a.csv"), text_writer("a.csv", content), "a.csv")
    for name, damage in DAMAGES.items():
        if name in ("UTF-16", "zero bytes", "byte flipped", "Latin-1", "compressed, cut off", "random bytes"):
            yield Case(
                "answers, CSV", name, _score("a.csv"), text_writer("a.csv", damage(csv_answers().encode())), "a.csv"
            )
    for other, content in {
        "of another scene": _text([{"id": "10001-0", "response": "1"}]),
        "damaged": "zebra",
        "missing": None,
    }.items():
        argv = ("score", "{good}/answers.jsonl", "b.jsonl", *_score("")[2:])
        write = text_writer("b.jsonl", content) if content is not None else lambda folder, good: None
        yield Case("answers, second file", other, argv, write, "b.jsonl")


def answer_controls() -> Iterator[Case]:
    """Good files of answers: every one must be accepted."""
    for file in ("answers.jsonl", "answers.csv"):
        yield Case("control", file, _score(f"{{good}}/{file}"))
    content = json.dumps(json_line_answers()[0]) + "\n\n"
    yield Case("control", "one answer, empty line", _score("a.jsonl"), text_writer("a.jsonl", content))
