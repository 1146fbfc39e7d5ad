"""Answers of systems that understand nothing, for trying the scorer."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from nsdr.baselines.recording import keep_recording
from nsdr.clevrer.answers.answer_files import write_responses
from nsdr.clevrer.answers.prompts import answer_text, option_letters
from nsdr.clevrer.files.questions import Question, SceneQuestions
from nsdr.errors import DataError, NsdrError
from nsdr.evaluation.references import constant_answers
from nsdr.evaluation.runner import true_scene_of
from nsdr.evaluation.sources import SOURCES
from nsdr.symbolic import Executor, Program
from nsdr.types import Answer, Scene

__all__ = ["DUMMIES", "write_dummy"]

DUMMIES = ("always-yes", "always-no", "keep-recording")
"""Systems: every option right, none right, or the true recording without the removed object (`keep_recording`)."""


def write_dummy(name: str, scenes: Sequence[SceneQuestions], path: str | Path, source: str = "", data: str = "") -> int:
    """Write the responses of a dummy system as a JSON Lines file.

    Args:
        name: one of `DUMMIES`.
        scenes: the questions; for "keep-recording" with their programs.
        path: the file.
        source: "keep-recording": a name in `nsdr.evaluation.SOURCES` of true scenes, such as "truth".
        data: "keep-recording": the folder or file that the source reads.

    Returns:
        The number of questions that the recording could not answer, whose responses are empty.

    Raises:
        DataError: an unknown name, `source` and `data` missing or superfluous, or unreadable scenes.
    """
    if name not in DUMMIES:
        raise DataError(f"{name!r} is no dummy system; expected one of {', '.join(DUMMIES)}")
    if (name == "keep-recording") != bool(source and data) or bool(source) != bool(data):
        raise DataError("keep-recording needs --source and --data of the true scenes, the others take neither")
    answered = _recorded(scenes, source, data) if source else constant_answers(scenes, name)
    empty = 0

    def rows() -> Iterator[tuple[int, int, str]]:
        nonlocal empty
        for scene, answers in answered:
            for question in scene.questions:
                answer = answers.get(question.id)
                empty += answer is None
                yield scene.scene_index, question.id, "" if answer is None else _response(question, answer)

    write_responses(path, rows())
    return empty


def _recorded(
    scenes: Sequence[SceneQuestions], source: str, data: str
) -> Iterator[tuple[SceneQuestions, dict[int, Answer]]]:
    for scene, true_scene in _true_scenes(scenes, source, data):
        executor = Executor(keep_recording(true_scene))
        answers = {q.id: answer for q in scene.questions if (answer := _run(executor, q)) is not None}
        yield scene, answers


def _true_scenes(scenes: Sequence[SceneQuestions], source: str, data: str) -> Iterator[tuple[SceneQuestions, Scene]]:
    try:
        true_source = SOURCES[source](Path(data), {s.scene_index for s in scenes})
        for scene in scenes:
            yield scene, true_scene_of(true_source, scene)
    except DataError as e:
        raise DataError(f"--source {source} --data {data}: {e}") from e


def _run(executor: Executor, question: Question) -> Answer | None:
    """The answer by the programs of the question file; None where one fails."""
    tokens = [question.program, *(c.program for c in question.choices)]
    if None in tokens:
        raise DataError(f"question {question.id} has no programs in its file, which keep-recording runs")
    programs = [Program.parse(t) for t in tokens if t is not None]
    try:
        if not question.choices:
            return executor.answer(programs[0])
        judged = executor.judge(programs[0], [(c.text, p) for c, p in zip(question.choices, programs[1:], strict=True)])
    except NsdrError:
        return None
    return judged


def _response(question: Question, answer: Answer) -> str:
    if answer.answer is not None:
        return f"<answer>{answer.answer}</answer>"
    letters = option_letters(len(question.choices))
    right = [letter for letter, c in zip(letters, answer.choices, strict=True) if c.answer == "correct"]
    return f"<answer>{answer_text(right)}</answer>"
