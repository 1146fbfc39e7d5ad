"""The table of export formats: what each column of a row holds of a question, its video and its answer."""

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from operator import attrgetter
from typing import Any

from nsdr.claims.narration import Length, narrate
from nsdr.clevrer.answers.prompts import option_letters, prompt, solution
from nsdr.clevrer.files.questions import Question
from nsdr.errors import NsdrError
from nsdr.symbolic import Executor
from nsdr.types import Scene


@dataclass(frozen=True)
class Sample:
    """A question about a video, from which a row of any format is made.

    Attributes:
        question: the question.
        split: the video's split.
        scene_index: the video's index.
        video: path of the video, relative to the export's folder; without copied videos, to the data set's.
        seed: number from which `nsdr generate scene` simulates the scene; None for data that nsdr did not generate.
        reasoning: checkable sentences that end with the solution; None if they are not exported, or not known.
        scene: path of the true scene, relative like `video`; None if it is not exported.
    """

    question: Question
    split: str
    scene_index: int
    video: str
    seed: int | None = None
    reasoning: str | None = None
    scene: str | None = None


Column = Callable[[Sample], Any]
"""The value of a column for a sample."""


@dataclass(frozen=True)
class Format:
    """A format of JSON Lines.

    Attributes:
        purpose: what its rows are for.
        columns: the columns by name. Formats differ in the column of the prompt, in the place of the video and in the form of
            the answer.
    """

    purpose: str
    columns: Mapping[str, Column]

    def row(self, sample: Sample) -> dict[str, Any]:
        """The row of a sample."""
        return {name: value(sample) for name, value in self.columns.items()}


def _request(sample: Sample) -> list[dict[str, Any]]:
    """The user's message: the video, then the prompt, as chat templates of video models expect them."""
    content = [{"type": "video", "video": sample.video}, {"type": "text", "text": prompt(sample.question)}]
    return [{"role": "user", "content": content}]


def _conversation(sample: Sample) -> list[dict[str, Any]]:
    """The user's message, and the assistant's with the reasoning (if exported) and the answer; the former alone without one."""
    if is_unanswered(sample.question):
        return _request(sample)
    text = sample.reasoning or solution(sample.question)  # reasoning ends with the solution
    return [*_request(sample), {"role": "assistant", "content": [{"type": "text", "text": text}]}]


ABOUT: dict[str, Column] = {
    "id": lambda s: f"{s.scene_index}-{s.question.id}",
    "split": attrgetter("split"),
    "scene_index": attrgetter("scene_index"),
    "question_id": attrgetter("question.id"),
    "video": attrgetter("video"),
    "question_type": attrgetter("question.type"),
    "subtype": attrgetter("question.subtype"),
    "question": attrgetter("question.text"),
    "options": lambda s: [c.text for c in s.question.choices],
    "letters": lambda s: list(option_letters(len(s.question.choices))),
    "tags": lambda s: [c.tag for c in s.question.choices],
    "program": attrgetter("question.program"),
    "option_programs": lambda s: [c.program for c in s.question.choices],
    "seed": attrgetter("seed"),
    "pair": attrgetter("question.pair"),
    "pair_kind": attrgetter("question.pair_kind"),
    "scene": attrgetter("scene"),
}
"""Columns beside the prompt and the answer, which reward functions and analyses read."""
FORMATS = {
    "grpo": Format(
        "prompts, solutions and columns for reward functions, for TRL's GRPOTrainer",
        {
            "prompt": _request,
            "solution": lambda s: None if is_unanswered(s.question) else solution(s.question),
            "reasoning": attrgetter("reasoning"),
            **ABOUT,
        },
    ),
    "chat": Format(
        "conversations that end with the answer, for supervised training",
        {"messages": _conversation, **ABOUT},
    ),
}
"""All formats by name."""


def is_unanswered(question: Question) -> bool:
    """Whether a question, or one of its options, has no answer in its file."""
    return None in ([c.answer for c in question.choices] or [question.answer])


def reasoner(scene: Scene, length: Length) -> Callable[[Question], str | None]:
    """A function that tells the reasoning to a question's right answer, as `nsdr.narrate` does; its last line is the answer.

    It returns None for a question without programs or answers, one that the scene cannot answer (annotations know nothing of
    the time after the video), and one that the scene answers otherwise than the question's file.

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
