"""The table of export formats: what each column of a row holds of a question, its video and its answer."""

import json
from collections.abc import Callable, Mapping, Sequence
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
from nsdr.world.world import CLEVRER_WORLD, World


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
        images: paths of the frames that stand for the video, in order; none where the format takes the video.
        world: the world of the video, whose words the examples of prompts have.
    """

    question: Question
    split: str
    scene_index: int
    video: str
    seed: int | None = None
    reasoning: str | None = None
    scene: str | None = None
    images: Sequence[str] = ()
    world: World = CLEVRER_WORLD


Column = Callable[[Sample], Any]
"""The value of a column for a sample."""


@dataclass(frozen=True)
class Format:
    """A format of rows, one for each question.

    Attributes:
        purpose: what its rows are for.
        columns: the columns by name. Formats differ in the column of the prompt, in the place of the video and in the form of
            the answer.
        suffix: of its files: ".jsonl" (JSON Lines) or ".parquet".
        n_frames: number of frames that stand for the video unless another is asked for; 0 where the format takes the video.
    """

    purpose: str
    columns: Mapping[str, Column]
    suffix: str = ".jsonl"
    n_frames: int = 0

    def row(self, sample: Sample) -> dict[str, Any]:
        """The row of a sample."""
        return {name: value(sample) for name, value in self.columns.items()}


VIDEO = "<video>"
"""What stands for the video in the prompts of frameworks that take it in a column."""


def _source(sample: Sample) -> str:
    """The name of the world in small letters, such as "clevrer", by which verl and Video-R1 tell data sets apart."""
    return sample.world.name.lower()


def _request(sample: Sample) -> list[dict[str, Any]]:
    """The user's message: the video, then the prompt, as chat templates of video models expect them."""
    content = [
        {"type": "video", "video": sample.video},
        {"type": "text", "text": prompt(sample.question, sample.world)},
    ]
    return [{"role": "user", "content": content}]


def _conversation(sample: Sample) -> list[dict[str, Any]]:
    """The user's message, and the assistant's with the reasoning (if exported) and the answer; the former alone without one."""
    text = _response(sample)
    return [*_request(sample), *([] if text is None else _said("assistant", [{"type": "text", "text": text}]))]


def _response(sample: Sample) -> str | None:
    """The reasoning (if exported), which ends with the solution, or the solution alone; None without an answer."""
    return None if is_unanswered(sample.question) else sample.reasoning or solution(sample.question)


def _solution(sample: Sample) -> str | None:
    return None if is_unanswered(sample.question) else solution(sample.question)


def _said(role: str, content: Any) -> list[dict[str, Any]]:
    return [{"role": role, "content": content}]


def _with_video(sample: Sample) -> str:
    """The prompt with a mark where the video goes."""
    return VIDEO + prompt(sample.question, sample.world)


def _texts_of_options(sample: Sample) -> list[str]:
    return [c.text for c in sample.question.choices]


def _ground_truth(sample: Sample) -> str | None:
    """Solution and options in JSON: EasyR1 gives reward functions nothing else of a row."""
    right = _solution(sample)
    return None if right is None else json.dumps({"solution": right, "options": _texts_of_options(sample)})


def _type_in_video_r1(sample: Sample) -> str:
    question = sample.question
    if question.choices:
        return "multiple choice"
    return "numerical" if (question.answer or "").isdecimal() else "free-form"


def _problem_in_video_r1(sample: Sample) -> str:
    """The question and how to answer it; Video-R1 puts the options below."""
    return f"{sample.question.text} {prompt(sample.question, sample.world).splitlines()[-1]}"


def _lettered(sample: Sample) -> list[str]:
    return [f"{letter}. {c.text}" for letter, c in zip(_letters(sample), sample.question.choices, strict=True)]


def _letters(sample: Sample) -> list[str]:
    return list(option_letters(len(sample.question.choices)))


def _extra_info(sample: Sample) -> dict[str, Any]:
    """What verl gives reward functions: all columns of `ABOUT`, and a number for its logs."""
    return {"index": sample.scene_index * 1000 + sample.question.id} | {k: f(sample) for k, f in ABOUT.items()}


ABOUT: dict[str, Column] = {
    "id": lambda s: f"{s.scene_index}-{s.question.id}",
    "split": attrgetter("split"),
    "scene_index": attrgetter("scene_index"),
    "question_id": attrgetter("question.id"),
    "question_type": attrgetter("question.type"),
    "subtype": attrgetter("question.subtype"),
    "question": attrgetter("question.text"),
    "options": _texts_of_options,
    "letters": _letters,
    "tags": lambda s: [c.tag for c in s.question.choices],
    "program": attrgetter("question.program"),
    "option_programs": lambda s: [c.program for c in s.question.choices],
    "seed": attrgetter("seed"),
    "pair": attrgetter("question.pair"),
    "pair_kind": attrgetter("question.pair_kind"),
    "scene": attrgetter("scene"),
}
"""Columns beside the prompt, the video and the answer, which reward functions and analyses read."""
REWARDED: dict[str, Column] = {"solution": _solution, "reasoning": attrgetter("reasoning"), **ABOUT}
"""Columns of formats whose frameworks give reward functions all columns of a row."""
FORMATS = {
    "trl": Format(
        "TRL's GRPOTrainer and SFTTrainer: prompts and completions as messages, frames in `images`",
        {
            "prompt": lambda s: _said("user", prompt(s.question, s.world)),
            "completion": lambda s: None if (text := _response(s)) is None else _said("assistant", text),
            "images": lambda s: list(s.images),
            "video": attrgetter("video"),
            **REWARDED,
        },
        n_frames=16,
    ),
    "verl": Format(
        "verl: prompts, videos, ground truth and extra_info, in parquet files",
        {
            "data_source": _source,
            "prompt": lambda s: _said("user", _with_video(s)),
            "videos": lambda s: [{"video": s.video}],
            "ability": attrgetter("question.type"),
            "reward_model": lambda s: {"style": "rule", "ground_truth": _solution(s)},
            "extra_info": _extra_info,
        },
        suffix=".parquet",
    ),
    "easyr1": Format(
        "EasyR1: problem, answer (JSON, with the options) and videos",
        {"problem": _with_video, "answer": _ground_truth, "videos": lambda s: [s.video], "id": ABOUT["id"]},
    ),
    "swift": Format(
        "ms-swift: messages that end with the answer, videos, and columns for rewards",
        {
            "messages": lambda s: (
                _said("user", _with_video(s)) + ([] if (text := _response(s)) is None else _said("assistant", text))
            ),
            "videos": lambda s: [s.video],
            **REWARDED,
        },
    ),
    "video_r1": Format(
        "Video-R1: problem, options, solution and path, with its types of problems",
        {
            "problem_id": lambda s: s.scene_index * 1000 + s.question.id,
            "problem": _problem_in_video_r1,
            "data_type": lambda _: "video",
            "problem_type": _type_in_video_r1,
            "options": _lettered,
            "process": lambda s: s.reasoning or "",
            "solution": _solution,
            "path": attrgetter("video"),
            "data_source": _source,
        },
    ),
    "chat": Format(
        "conversations that end with the answer, the video in the user's message",
        {"messages": _conversation, "video": attrgetter("video"), **ABOUT},
    ),
    "lmms_eval": Format(
        "the task for lmms-eval in integrations/lmms_eval",
        {
            "scene_index": attrgetter("scene_index"),
            "question_id": attrgetter("question.id"),
            "type": attrgetter("question.type"),
            "prompt": lambda s: prompt(s.question, s.world),
            "target": _solution,
            "options": _texts_of_options,
            "video": attrgetter("video"),
        },
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
