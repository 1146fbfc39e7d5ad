"""Checkable reasoning for the questions of a video, told from its true scene."""

from collections.abc import Callable
from contextlib import suppress

from nsdr.claims.narration import Length, narrate
from nsdr.clevrer.answers.prompts import solution
from nsdr.clevrer.files.questions import Question
from nsdr.errors import NsdrError
from nsdr.symbolic import Executor
from nsdr.types import Answer, Scene

__all__ = ["reasoner"]


def reasoner(scene: Scene, length: Length) -> Callable[[Question], str | None]:
    """What tells the reasoning of a question's right answer, as of `nsdr.narrate`, with the tagged answer as its last line.

    It gives None for a question without programs or answers, one that the scene cannot answer (annotations know nothing of the
    time after the video), and one that it answers otherwise than the question's file.

    Args:
        scene: the true scene.
        length: "short" or "long".
    """
    executor = Executor(scene)

    def tell(question: Question) -> str | None:
        if question.program is None or any(c.program is None for c in question.choices):
            return None
        with suppress(NsdrError):
            text = narrate(_answer(executor, question), scene, length)
            if text.splitlines()[-1] == solution(question):
                return text
        return None

    return tell


def _answer(executor: Executor, question: Question) -> Answer:
    assert question.program is not None
    if not question.choices:
        return executor.answer(question.program, question.text)
    programs = [(c.text, c.program) for c in question.choices if c.program is not None]
    return executor.judge(question.program, programs, question.text)
