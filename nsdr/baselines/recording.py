"""Answering counterfactuals without any physics: the recording, with the removed object deleted from it.

A control: it is right wherever removing the object changes nothing else, so what a system must get right to understand anything
are the options that it gets wrong. `OPTION_TAGS` name the two kinds.
"""

from dataclasses import replace

from msgspec import structs

from nsdr.clevrer.files.questions import OPTION_TAGS, Question, SceneQuestions
from nsdr.errors import DataError, NsdrError, QuestionError
from nsdr.symbolic import Executor
from nsdr.types import Scene

CHANGED = "get_changed"
"""Program token of what-ifs about changed objects."""


def keep_recording(scene: Scene) -> Scene:
    """The scene with the collisions of the video, except those of the removed object, as every counterfactual."""
    collisions = [e for e in scene.events if e.kind == "collision"]
    without = {o.id: tuple(e for e in collisions if o.id not in e.objects) for o in scene.objects}
    return replace(scene, counterfactual=without, dynamics=None, uncertain=None)


def option_tags(recording: Executor, question: Question) -> list[str | None]:
    """The tag of each option of a counterfactual question; None where the recording cannot judge the option.

    Args:
        recording: executor on `keep_recording` of the scene.
        question: with programs and answers.

    Raises:
        ProgramError: a program is not well-formed.
        ExecutionError: the question's program does not fit the scene.
        QuestionError: the question or an option has no answer, or the question no program.
    """
    if question.program is None or any(c.answer is None for c in question.choices):
        raise QuestionError("has no program or no answers, which tags are made of")
    missing = QuestionError("has no program")
    programs = [(c.text, missing if c.program is None else c.program) for c in question.choices]
    judged = recording.answer_choices(question.program, programs).choices
    return [
        None if found.error else OPTION_TAGS[found.answer != choice.answer]
        for choice, found in zip(question.choices, judged, strict=True)
    ]


def tag_options(questions: SceneQuestions, scene: Scene) -> SceneQuestions:
    """The questions with the tags of all options of counterfactual questions, except what-ifs beyond CLEVRER.

    Args:
        questions: with programs and answers.
        scene: the true scene; its observed collisions are enough.

    Raises:
        DataError: an option cannot be tagged; names the scene, the question and why.
    """
    recording = Executor(keep_recording(scene))
    tagged = []
    for question in questions.questions:
        if question.type == "counterfactual" and CHANGED not in (question.program or ()):
            where = f"scene {questions.scene_index}, question {question.id}"
            try:
                tags = option_tags(recording, question)
            except NsdrError as e:
                raise DataError(f"{where}: {e}") from e
            for choice, tag in zip(question.choices, tags, strict=True):
                if tag is None:
                    why = "has no program" if choice.program is None else f"the scene cannot judge it: {choice.text!r}"
                    raise DataError(f"{where}, choice {choice.id}: {why}")
            choices = tuple(structs.replace(c, tag=tag) for c, tag in zip(question.choices, tags, strict=True))
            question = structs.replace(question, choices=choices)
        tagged.append(question)
    return structs.replace(questions, questions=tuple(tagged))
