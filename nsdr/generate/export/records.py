"""The record that every format is made from: one question about one video."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from nsdr.clevrer.answers.prompts import option_letters, prompt, solution
from nsdr.clevrer.files.questions import Question, SceneQuestions

__all__ = ["Record", "scene_records"]


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

    Args:
        scene: the questions.
        split: the video's split.
        video: `Record.video`.
        seed: `Record.seed`.
        tell: gives `Record.reasoning` of a question; None for none.
        true_scene: `Record.scene`.

    Raises:
        DataError: a question has more options than there are letters.
    """
    records = (_record(q, scene.scene_index, split, video, seed) for q in scene.questions)
    told = (None if tell is None else tell(q) for q in scene.questions)
    return tuple(replace(r, reasoning=text, scene=true_scene) for r, text in zip(records, told, strict=True))


def _record(q: Question, scene_index: int, split: str, video: str, seed: int | None) -> Record:
    answers = [c.answer for c in q.choices] or [q.answer]
    return Record(
        id=f"{scene_index}-{q.id}",
        split=split,
        scene_index=scene_index,
        question_id=q.id,
        video=video,
        question_type=q.type,
        subtype=q.subtype,
        question=q.text,
        options=tuple(c.text for c in q.choices),
        letters=tuple(option_letters(len(q.choices))),
        prompt=prompt(q),
        solution=None if None in answers else solution(q),
        tags=tuple(c.tag for c in q.choices),
        blind=tuple(c.blind for c in q.choices) or (q.blind,),
        program=q.program,
        option_programs=tuple(c.program for c in q.choices),
        seed=seed,
    )
