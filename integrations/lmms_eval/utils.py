"""The functions of `clevrer.yaml`: rows of `nsdr export --format lmms_eval`, answers read and judged by `nsdr`.

Environment variables, read when the task is run:
    NSDR_ROWS: a file of such an export, such as DIR/validation.jsonl; videos are found from its folder.
    NSDR_PREDICTIONS: file for the responses, which `nsdr score` reads; not written where it is not set.
"""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from nsdr.clevrer import read_response, write_responses
from nsdr.clevrer.answers.prompts import option_letters
from nsdr.errors import DataError
from nsdr.io.reading import parse_json_lines, read_json_bytes
from nsdr.io.worlds import WORLD_FILE

DATA_FILES = {"test": str(Path(__file__).with_name("rows.jsonl"))}
"""A row that says where the rows are. lmms-eval loads it, and imports every task pack of a folder, before `process_docs` reads
the rows themselves."""


def process_docs(_: Any) -> Any:
    """A row for each question, as a `datasets.Dataset`."""
    from datasets import Dataset

    path = os.environ.get("NSDR_ROWS", "")
    if not path:
        raise DataError("NSDR_ROWS is not set; see the README of the task pack")
    return Dataset.from_list(rows(path))


def rows(path: str) -> list[dict[str, Any]]:
    """The rows of an export, with the paths of the videos from here, and with the file or name of their world.

    Raises:
        DataError: the file is no such export, a video is missing, or a question has no answer or one of another world.
    """
    found, beside = [], Path(path).with_name(WORLD_FILE)
    world = str(beside.resolve()) if beside.is_file() else "clevrer"
    for number, row in parse_json_lines(read_json_bytes(path), path):
        if not isinstance(row, dict) or "target" not in row:
            raise DataError(f"{path}, line {number}: expected a row of `nsdr export --format lmms_eval`")
        if row["target"] is None:
            raise DataError(f"{path}, line {number}: has no answer; export a split with answers")
        if read_response(row["target"], row["options"], world).answer is None:
            raise DataError(
                f"{path}, line {number}: {row['target']} is no answer in the world {world}; of rows of another "
                f"world than CLEVRER's, {beside} has to say the world: export into a new folder"
            )
        video = (Path(path).parent / row["video"]).resolve()
        if not video.exists():
            raise DataError(f"{path}, line {number}: {video} is missing; export with the videos")
        found.append({**row, "video": str(video), "world": world})
    return found


def doc_to_visual(doc: Mapping[str, Any]) -> list[str]:
    """The video's path."""
    return [doc["video"]]


def doc_to_text(doc: Mapping[str, Any], lmms_eval_specific_kwargs: Mapping[str, Any] | None = None) -> str:
    """The prompt, which is the same for every model."""
    return str(doc["prompt"])


def doc_to_target(doc: Mapping[str, Any]) -> str:
    """The right answer in its tags."""
    return str(doc["target"])


def process_results(doc: Mapping[str, Any], results: Sequence[str]) -> dict[str, dict[str, Any]]:
    """The metrics of one response; what cannot be read counts as wrong in the question and in each of its options."""
    options = doc["options"]
    response, expected = (read_response(text, options, doc["world"]) for text in (results[0], doc["target"]))
    about = {"scene_index": doc["scene_index"], "question_id": doc["question_id"]}
    unread = {"unread": {**about, "response": results[0], "problem": response.problem}}
    if not options:
        return {doc["type"]: {**about, **_judged([response.answer == expected.answer])}, **unread}
    letters = option_letters(len(options))
    given = response.answer if isinstance(response.answer, frozenset) else None
    right = [given is not None and (letter in given) == (letter in (expected.answer or ())) for letter in letters]
    per_option, per_question = {**about, **_judged(right)}, {**about, **_judged([all(right)])}
    return {f"{doc['type']}_per_option": per_option, f"{doc['type']}_per_question": per_question, **unread}


def share_right(items: Sequence[Mapping[str, Any]]) -> float:
    """The share of the judgements that is right."""
    return float(sum(item["right"] for item in items) / sum(item["n"] for item in items))


def count_unread(items: Sequence[Mapping[str, Any]]) -> int:
    """The number of responses that cannot be read; writes all of them to the file NSDR_PREDICTIONS."""
    if path := os.environ.get("NSDR_PREDICTIONS"):
        write_responses(path, (((i["scene_index"], i["question_id"]), i["response"]) for i in items))
    return sum(bool(item["problem"]) for item in items)


def _judged(right: Sequence[bool]) -> dict[str, Any]:
    """`score` is what lmms-eval's own standard errors are made of."""
    return {"right": sum(right), "n": len(right), "score": sum(right) / len(right)}
