"""The record that every format is made from, one question about one video, and the reasoning told from its true scene."""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from nsdr.claims.narration import Length, narrate
from nsdr.clevrer.answers.prompts import option_letters, prompt, solution
from nsdr.clevrer.files.questions import Question, SceneQuestions
from nsdr.errors import NsdrError
from nsdr.symbolic import Executor
from nsdr.types import Scene

__all__ = ["Record", "reasoner", "scene_records"]


@dataclass(frozen=True)
class Record:
    """One question about one video.

    Attributes:
        id: "SCENE_INDEX-QUESTION_ID", such as "10003-7".
        split: "train", "validation" or "test".
        scene_index: index of the video.
        question_id: id of the question within the video.
        video: path of the video, relative to the export's folder; without copied or linked videos, to the data set's.
        question_type: one of `nsdr.clevrer.files.questions.QUESTION_TYPES`.
        subtype: subtype of a descriptive question, such as "query_color"; None for multiple choice.
        question: the question alone.
        options: texts of the options; empty for a descriptive question.
        letters: their letters, "A", "B", …
        prompt: question, options and how to answer (`nsdr.clevrer.answers.prompts.prompt`).
        solution: the right answer in its tags (`nsdr.clevrer.answers.prompts.solution`); None if the file has no answers.
        tags: of each option, one of `nsdr.clevrer.files.questions.OPTION_TAGS`; None where it is not known.
        blind: of each option, or of the one descriptive question, whether texts alone predict the answer; None where it is
            not known.
        program: postfix tokens of the question; None if the file has none.
        option_programs: those of each option.
        seed: number from which `nsdr generate scene` simulates the video's scene; None for data that nsdr did not generate.
        reasoning: checkable sentences that end with the solution (`nsdr.narrate`); None if not asked for, or not known.
        scene: path of the true scene (a truth or annotation file), relative like `video`; None if not asked for.
    """

    id: str
    split: str
    scene_index: int
    question_id: int
    video: str
    question_type: str
    subtype: str | None
    question: str
    options: tuple[str, ...]
    letters: tuple[str, ...]
    prompt: str
    solution: str | None
    tags: tuple[str | None, ...]
    blind: tuple[bool | None, ...]
    program: tuple[str, ...] | None
    option_programs: tuple[tuple[str, ...] | None, ...]
    seed: int | None
    reasoning: str | None = None
    scene: str | None = None

    def row(self) -> dict[str, Any]:
        """The attributes by name, in the order of their declaration."""
        return dict(vars(self))


def scene_records(
    scene: SceneQuestions,
    split: str,
    video: str,
    seed: int | None = None,
    tell: Callable[[Question], str | None] | None = None,
    true_scene: str | None = None,
) -> tuple[Record, ...]:
    """The records of one video's questions, in their order.

    The arguments are attributes of `Record` of the same name; `tell` gives its `reasoning`, and `true_scene` is its `scene`.

    Raises:
        DataError: a question has more options than there are letters.
    """
    return tuple(
        Record(
            id=f"{scene.scene_index}-{q.id}",
            split=split,
            scene_index=scene.scene_index,
            question_id=q.id,
            video=video,
            question_type=q.type,
            subtype=q.subtype,
            question=q.text,
            options=tuple(c.text for c in q.choices),
            letters=tuple(option_letters(len(q.choices))),
            prompt=prompt(q),
            solution=None if None in ([c.answer for c in q.choices] or [q.answer]) else solution(q),
            tags=tuple(c.tag for c in q.choices),
            blind=tuple(c.blind for c in q.choices) or (q.blind,),
            program=q.program,
            option_programs=tuple(c.program for c in q.choices),
            seed=seed,
            reasoning=None if tell is None else tell(q),
            scene=true_scene,
        )
        for q in scene.questions
    )


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
        choices = [(c.text, c.program) for c in question.choices if c.program is not None]
        if question.program is None or len(choices) < len(question.choices):
            return None
        with suppress(NsdrError):
            if choices:
                answer = executor.judge(question.program, choices, question.text)
            else:
                answer = executor.answer(question.program, question.text)
            text = narrate(answer, scene, length)
            if text.splitlines()[-1] == solution(question):
                return text
        return None

    return tell
