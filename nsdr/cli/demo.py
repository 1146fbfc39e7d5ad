"""`nsdr demo`: questions of all four types about the clip that ships with the package."""

import textwrap
from pathlib import Path

from nsdr.clevrer.example import QUESTIONS, VIDEO
from nsdr.clevrer.files.questions import Question, read_questions
from nsdr.cli.status import failures_line
from nsdr.errors import NsdrError
from nsdr.io.files import check_output
from nsdr.pipeline import Pipeline
from nsdr.types import Answer

__all__ = ["run_demo"]


def run_demo(checkpoint: str | Path = "default", image: str | Path = "nsdr_demo.png", device: str = "auto") -> int:
    """Perceive the clip, answer its questions from pixels, compare with the truth, write an annotated image.

    Returns:
        The exit status: 1 if questions could not be answered.
    """
    from nsdr.visualize import write_annotated_image

    check_output(image, (".png", ".jpg"))
    pipeline = Pipeline.from_pretrained(checkpoint, device=device)
    print(f"Watching {VIDEO.name} ...")
    perception = pipeline.perceive(VIDEO)
    scene = perception.scene
    collisions = sum(e.kind == "collision" for e in scene.events)
    print(f"{scene.n_frames} frames, {len(scene.objects)} objects, {collisions} collisions\n")
    right, failed = 0, []
    questions = read_questions(QUESTIONS)[0].questions
    for question in questions:
        try:
            answer = pipeline.answer(VIDEO, question.text, [c.text for c in question.choices] or None)
        except NsdrError as e:
            print(f"[{question.type}] {question.text}\n  could not be answered: {e}\n")
            failed.append(f"{question.text!r}: {e}")
            continue
        agrees = _agrees(answer, question)
        right += agrees
        _print(question, answer, agrees)
    print(f"{right} of {len(questions)} answers equal the ground truth")
    write_annotated_image(str(image), str(VIDEO), perception)
    print(f"Image: {image}")
    return failures_line(len(failed), len(questions), "questions", "".join(failed[:1]), keep_going=False)


def _agrees(answer: Answer, question: Question) -> bool:
    if question.choices:
        return [c.answer for c in answer.choices] == [c.answer for c in question.choices]
    return answer.answer == question.answer


def _print(question: Question, answer: Answer, agrees: bool) -> None:
    print(f"[{question.type}] {question.text}")
    print(textwrap.fill(" ".join(answer.program), 110, initial_indent="  program: ", subsequent_indent=" " * 11))
    if answer.answer is not None:
        print(f"  answer:  {answer.answer} (truth: {question.answer})")
    for choice, true in zip(answer.choices, question.choices, strict=True):
        print(f"  {choice.answer or 'error':<7}  {choice.choice} (truth: {true.answer})")
    print(f"  {'equal to' if agrees else 'DIFFERS from'} the ground truth\n")
