"""Counterfactuals without any physics: the recording, with the removed object deleted from it.

It answers rightly wherever the removal changes nothing else. Only the other options, the inferential ones, show whether a
system knows what the removal changes.
"""

from dataclasses import replace

from msgspec import structs

from nsdr.clevrer.files.questions import OPTION_TAGS, Question, SceneQuestions
from nsdr.errors import DataError, NsdrError
from nsdr.symbolic import Executor
from nsdr.types import Scene

CHANGED = "get_changed"
"""Program token of what-if questions about changed objects, which CLEVRER does not have."""


def keep_recording(scene: Scene) -> Scene:
    """The scene in which the removal of an object changes no collision of the video but takes away the object's own."""
    collisions = [e for e in scene.events if e.kind == "collision"]
    without = {o.id: tuple(e for e in collisions if o.id not in e.objects) for o in scene.objects}
    return replace(scene, counterfactual=without, dynamics=None, uncertain=None, collisions_only=True)


def tag_options(questions: SceneQuestions, scene: Scene) -> SceneQuestions:
    """The questions with all counterfactual options tagged: "observational" where the unchanged recording is right.

    What-if questions about changed objects get no tags.

    Args:
        questions: questions with programs and answers.
        scene: the true scene; its observed collisions are enough.

    Raises:
        DataError: an option cannot be tagged; names the scene, the question and why.
    """
    recording = Executor(keep_recording(scene))
    return structs.replace(
        questions, questions=tuple(_tagged(q, recording, questions.scene_index) for q in questions.questions)
    )


def _tagged(question: Question, recording: Executor, scene_index: int) -> Question:
    if question.type != "counterfactual" or CHANGED in (question.program or ()):
        return question
    where = f"scene {scene_index}, question {question.id}"
    programs = [(c.text, c.program) for c in question.choices if c.program is not None and c.answer is not None]
    if question.program is None or len(programs) < len(question.choices):
        raise DataError(f"{where}: lacks programs or answers, which tags are made of")
    try:
        judged = recording.answer_choices(question.program, programs).choices
    except NsdrError as e:
        raise DataError(f"{where}: {e}") from e
    choices = []
    for choice, found in zip(question.choices, judged, strict=True):
        if found.error:
            raise DataError(f"{where}, choice {choice.id} ({choice.text!r}): {found.error}")
        choices.append(structs.replace(choice, tag=OPTION_TAGS[found.answer != choice.answer]))
    return structs.replace(question, choices=tuple(choices))
