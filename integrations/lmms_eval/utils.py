"""The functions of `clevrer.yaml`: questions of a CLEVRER file as prompts of `nsdr`, answers read and judged by `nsdr`.

Environment variables:
    NSDR_QUESTIONS: question file with answers, in CLEVRER's format.
    NSDR_VIDEOS: folder of the videos, directly or in the official sub-folders of 1,000.
    NSDR_PREDICTIONS: file for the responses, which `nsdr score` reads; not written where it is not set.
"""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from nsdr.clevrer import prompt, read_questions, read_response, solution, write_responses
from nsdr.clevrer.answers.prompts import option_letters
from nsdr.clevrer.layout import FolderFiles
from nsdr.errors import DataError


def _variable(name: str) -> str:
    value = os.environ.get(name, "")
    if not value:
        raise DataError(f"{name} is not set; see the README of the task pack")
    return value


DATA_FILES = {"test": os.environ.get("NSDR_QUESTIONS", "NSDR_QUESTIONS is not set")}
"""What `datasets` loads; `process_docs` then reads the same file by nsdr's own reader, which checks it. lmms-eval imports every
task pack of a folder, so that a missing variable is an error only when this task is run."""


def process_docs(_: Any) -> Any:
    """A row for each question, as a `datasets.Dataset`."""
    from datasets import Dataset

    return Dataset.from_list(rows(_variable("NSDR_QUESTIONS"), _variable("NSDR_VIDEOS")))


def rows(questions: str, videos: str) -> list[dict[str, Any]]:
    """A row for each question: ids, type, prompt, texts of the options, the right answer, and the path of the video.

    Args:
        questions: question file.
        videos: folder, which is searched with its subfolders for the videos.

    Raises:
        DataError: a video is missing, two files have its name, or a question has no answer.
    """
    files, found = FolderFiles(Path(videos)), []
    for scene in read_questions(questions):
        path = files.find_video(scene.video_filename)
        if path is None:
            raise DataError(f"{videos}: has no {scene.video_filename}, which {questions} asks about")
        for question in scene.questions:
            about = {"scene_index": scene.scene_index, "question_id": question.id, "type": question.type}
            options = [{"text": c.text, "right": c.answer == "correct"} for c in question.choices]
            texts = {"prompt": prompt(question), "target": solution(question), "answer": question.answer or ""}
            found.append({**about, **texts, "options": options, "video": str(path.resolve())})
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
    response = read_response(results[0], [o["text"] for o in options])
    about = {"scene_index": doc["scene_index"], "question_id": doc["question_id"]}
    unread = {"unread": {**about, "response": results[0], "problem": response.problem}}
    if not options:
        return {doc["type"]: {**about, **_judged([response.answer == doc["answer"]])}, **unread}
    letters = option_letters(len(options))
    given = response.answer if isinstance(response.answer, frozenset) else None
    right = [given is not None and (x in given) == o["right"] for x, o in zip(letters, options, strict=True)]
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
