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

COLUMNS = {
    "id": "`SCENE_INDEX-QUESTION_ID`, such as `10003-7`",
    "split": "the video's split: train, validation or test",
    "scene_index": "the video's index",
    "question_id": "the question's id within the video",
    "video": "path of the video, relative to this folder; without copied videos, to the original data set's",
    "question_type": "descriptive, explanatory, predictive or counterfactual",
    "subtype": "of a descriptive question, such as `query_color`; null for multiple choice",
    "question": "the question alone",
    "options": "texts of the options; a descriptive question has none",
    "letters": "their letters, A, B, …",
    "prompt": "question, options and how to answer",
    "solution": "the right answer, such as `<answer>A,C</answer>`, `<answer>none</answer>` or `<answer>red</answer>`; null if "
    "unknown",
    "tags": "of each counterfactual option: `observational` (the recording without the removed object has the answer) or "
    "`inferential`; null if unknown",
    "program": "postfix tokens of the question, or null",
    "option_programs": "those of each option",
    "seed": "number from which `nsdr generate scene` simulates the scene; null for data that nsdr did not generate",
    "reasoning": "checkable sentences that end with the solution (`nsdr.narrate`); null if not exported, or not known",
    "pair": "`id` of the same question about the video from which this one was made, in a data set of pairs; null otherwise",
    "pair_kind": "how it was made: `changed` (without an object; the answers differ), `mirrored` or `noisy`",
    "scene": "path of the true scene (a truth or annotation file), relative like `video`; null if not exported",
}
"""What every format says about a question: the attributes of `Record`."""


@dataclass(frozen=True)
class Record:
    """One question about one video; `COLUMNS` says what each attribute holds (None stands for null)."""

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
    program: tuple[str, ...] | None
    option_programs: tuple[tuple[str, ...] | None, ...]
    seed: int | None
    reasoning: str | None = None
    pair: str | None = None
    pair_kind: str | None = None
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
            program=q.program,
            option_programs=tuple(c.program for c in q.choices),
            seed=seed,
            reasoning=None if tell is None else tell(q),
            pair=q.pair,
            pair_kind=q.pair_kind,
            scene=true_scene,
        )
        for q in scene.questions
    )


def reasoner(scene: Scene, length: Length) -> Callable[[Question], str | None]:
    """What tells the reasoning of a question's right answer, as in `nsdr.narrate`, with the tagged answer as its last line.

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
                answer = executor.answer_choices(question.program, choices, question.text)
            else:
                answer = executor.answer(question.program, question.text)
            text = narrate(answer, scene, length)
            if text.splitlines()[-1] == solution(question):
                return text
        return None

    return tell
