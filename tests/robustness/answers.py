"""Bad files of answers: JSON Lines. EvalAI submissions are among the documents."""

import json
from collections.abc import Iterator
from typing import Any

from tests.robustness.case import Case, dumped, raw, text_writer
from tests.robustness.files import DAMAGES
from tests.robustness.good import QUESTIONS_OF, json_line_answers

ROWS: dict[str, Any] = {
    "list": [1], "number": 5, "text": "x", "null": None, "empty": {},
    "no response": {"id": "10000-1"}, "list as response": {"id": "10000-1", "response": ["1"]},
    "no question": {"response": "1"}, "id of words": {"id": "zebra", "response": "1"},
    "id as number": {"id": 10000, "response": "1"}, "id as list": {"id": ["10000-1"], "response": "1"},
    "negative id": {"id": "10000--1", "response": "1"}, "id of 5,000 digits": {"id": f"{'9' * 5000}-0", "response": "1"},
    "id with a blank": {"id": "10000-1 ", "response": "1"}, "id of other digits": {"id": "10000-\u0661", "response": "1"},
    "second answer": {"id": "10000-0", "response": "1"},
    "NaN": {"id": "10000-1", "response": raw("NaN")}, "lone surrogate": {"id": "10000-1", "response": "\ud800"},
    "number of 5,000 digits": {"id": "10000-1", "response": raw("9" * 5000)},
    "two objects on a line": raw('{"id": "10000-1", "response": "1"} {"id": "10000-2", "response": "1"}'),
}  # fmt: skip
"""Bad rows in place of the second one."""
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
    yield Case("control", "answers.jsonl", _score("{good}/answers.jsonl"))
    content = json.dumps(json_line_answers()[0]) + "\n\n"
    for mark in (".", "-", "<", "```", "{", "<answer>", "A "):
        rows = [
            {"id": good["id"], "response": "<answer>The" + mark * (99_000 // len(mark)) + "red</answer>"}
            for good in json_line_answers()
        ]
        yield Case("control", f"answers of repeated {mark!r}", _score("a.jsonl"), text_writer("a.jsonl", _text(rows)))
    yield Case("control", "one answer, empty line", _score("a.jsonl"), text_writer("a.jsonl", content))
