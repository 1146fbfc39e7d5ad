"""Scores answers the way the paper does: descriptive accuracy; the other types per option and per question."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace

from nsdr.clevrer.files.questions import QUESTION_TYPES, Question, SceneQuestions, has_answer
from nsdr.errors import ExecutionError, NsdrError, QuestionError
from nsdr.evaluation.report import Report, Row, without_none
from nsdr.symbolic import Executor, OfficialExecutor, Program
from nsdr.symbolic.program import ProgramSource
from nsdr.types import Answer, ChoiceAnswer

Parse = Callable[[str, str], Program]
"""(text, kind) -> program, as `QuestionParser.parse`."""


def score_scenes(
    scenes: Iterable[tuple[SceneQuestions, Executor | OfficialExecutor | NsdrError]],
    parse: Parse | None = None,
    types: Sequence[str] = QUESTION_TYPES,
) -> Report:
    """Answer and score all questions.

    Args:
        scenes: questions with the executor of the scene they are about, or the error that kept it from being made.
        parse: turns texts into programs; None runs the programs of the question file.
        types: question types to answer.

    Returns:
        The scores. A question that fails as a whole counts as wrong, and a choice that fails is judged wrong. Questions without
        answers in their file are answered and not scored.
    """
    results = []
    notes: dict[str, list[str]] = {}
    for scene, executor in scenes:
        known = executor.scene.notes if isinstance(executor, Executor) else ()
        if known:
            notes[str(scene.scene_index)] = list(known)
        for question in (q for q in scene.questions if q.type in types):
            found = executor if isinstance(executor, NsdrError) else _answer(executor, question, parse)
            said = () if isinstance(found, NsdrError) else found.notes
            results.append(
                _result(scene, question, found) | without_none(notes=[n for n in said if n not in known] or None)
            )
    return Report(results, notes)


def score_answers(answered: Iterable[tuple[SceneQuestions, Mapping[int, Answer | NsdrError]]]) -> Report:
    """Score answers of a system that has no scenes.

    Args:
        answered: questions with the answers by question id, or why a question has none; questions that are not among them are
            left out.

    Returns:
        The scores, as in `score_scenes`.
    """
    results = [
        _result(scene, question, answers[question.id])
        for scene, answers in answered
        for question in scene.questions
        if question.id in answers
    ]
    return Report(results)


def _answer(executor: Executor | OfficialExecutor, question: Question, parse: Parse | None) -> Answer | NsdrError:
    """The answer, or why there is none."""

    def program_of(text: str, program: tuple[str, ...] | None, kind: str) -> ProgramSource:
        if parse:
            return parse(text, kind)
        if program is None:
            raise QuestionError("the question file has no programs; use parsed ones")
        if isinstance(executor, OfficialExecutor):
            return program
        return Program.parse(program, executor.scene.world.vocabulary)

    try:
        if question.type == "descriptive":
            return executor.answer(program_of(question.text, question.program, "descriptive"))
        program = program_of(question.text, question.program, "multiple_choice")
        choices: list[tuple[str, ProgramSource | NsdrError]] = []
        for c in question.choices:
            try:
                choices.append((c.text, program_of(c.text, c.program, "choice")))
            except QuestionError as e:
                choices.append((c.text, e))
        try:
            return executor.answer_choices(program, choices)
        except ExecutionError as e:  # of the question
            failed = [ChoiceAnswer(c.text, None, (), (), str(e)) for c in question.choices]
            return Answer.of_choices(question.text, (), failed)
    except NsdrError as e:
        return e


def _result(scene: SceneQuestions, question: Question, found: Answer | NsdrError) -> Row:
    """A question's row of the report."""
    is_scored = has_answer(question)
    row: Row = {
        "scene_index": scene.scene_index,
        "question_id": question.id,
        "question_type": question.type,
        "question_subtype": question.subtype,
    }
    correct = False
    judged: Sequence[ChoiceAnswer] = [ChoiceAnswer(c.text, "wrong", (), ()) for c in question.choices]
    if isinstance(found, NsdrError):
        row["error"] = str(found)
    elif question.type == "descriptive":
        correct = found.text == question.answer
        row |= {"answer": found.text} | without_none(probability=found.probability)
    else:
        # A choice that fails names something that is not in the scene: it cannot be right.
        judged = [replace(c, answer="wrong") if c.error else c for c in found.choices]
        correct = all(c.answer == choice.answer for c, choice in zip(judged, question.choices, strict=True))
    if question.choices:
        row["choices"] = [
            without_none(
                choice_id=choice.id,
                error=c.error or None,
                answer=c.answer,
                correct=("error" not in row and c.answer == choice.answer) if is_scored else None,
                probability=c.probability,
                tag=choice.tag,
            )
            for choice, c in zip(question.choices, judged, strict=True)
        ]
    row |= without_none(pair=question.pair, pair_kind=question.pair_kind)
    return row | without_none(correct=correct if is_scored else None)
