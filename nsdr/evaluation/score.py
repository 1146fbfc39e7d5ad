"""Scores answers the way the paper does: descriptive accuracy; the other types per option and per question."""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import Any

from nsdr.baselines.recording import keep_recording, option_tags
from nsdr.clevrer.files.questions import QUESTION_TYPES, Choice, Question, SceneQuestions
from nsdr.errors import ExecutionError, NsdrError, QuestionError
from nsdr.evaluation.measures import accuracy_interval, by_halves, calibration, calibration_text, tags_of
from nsdr.symbolic import Executor, Program
from nsdr.symbolic.failures import general
from nsdr.symbolic.program import ProgramSource
from nsdr.types import Answer, ChoiceAnswer

__all__ = ["Parse", "evaluate", "first_failure", "format_table", "score_answers"]

Parse = Callable[[str, str], Program]
"""(text, kind) -> program, as `QuestionParser.parse`."""


def evaluate(
    scenes: Iterable[tuple[SceneQuestions, Executor | NsdrError]],
    parse: Parse | None = None,
    types: Sequence[str] = QUESTION_TYPES,
) -> dict[str, Any]:
    """Answer and score all questions.

    Args:
        scenes: questions with the executor of the scene they are about, or the error that kept it from being made.
        parse: turns texts into programs; None runs the programs of the question file.
        types: question types to answer.

    Returns:
        The table by question type: fractions 0-1, their 95 % intervals as of `accuracy_interval`, and numbers; also for the
        halves of `nsdr.evaluation.measures`; and where answers have probabilities, `calibration` as of
        `nsdr.evaluation.measures`. Tags are those of the question file, which are of the true scene; counterfactual options
        without one are tagged by the scene that is evaluated. Under `results` every question with its answers. What fails
        carries its `error`: a whole question, which counts as wrong, or a single choice, which is judged wrong. `errors` is the
        number of questions with either. Questions without answers in their file are answered, not scored: their results have
        no `correct`, and `unlabelled` is their number.
    """
    results = []
    for questions, executor in scenes:
        recording = _recording(executor) if "counterfactual" in types else None
        for question in questions.questions:
            if question.type not in types:
                continue
            try:
                if isinstance(executor, NsdrError):
                    raise executor
                result = _answered(executor, question, parse)
                if recording is not None:
                    _tag(result, recording, question, parse)
            except NsdrError as e:
                result = _failed(question, e)
            results.append(_result(questions, question, result))
    return _report(results)


def score_answers(
    answered: Iterable[tuple[SceneQuestions, Mapping[int, Answer | NsdrError]]],
    recordings: Mapping[int, Executor] | None = None,
) -> dict[str, Any]:
    """Score answers of a system that has no scenes.

    Args:
        answered: questions with the answers by question id, or why a question has none; questions that are not among them are
            left out.
        recordings: executors on `keep_recording` of the true scenes by scene index, which tag counterfactual options by the
            programs of the question file where it has no tags; None for its tags only.

    Returns:
        The report, as of `evaluate`.
    """
    results = []
    for scene, answers in answered:
        recording = (recordings or {}).get(scene.scene_index)
        for question in (q for q in scene.questions if q.id in answers):
            found = answers[question.id]
            result = _failed(question, found) if isinstance(found, NsdrError) else _judged(question, found)
            if recording is not None and "error" not in result:
                _tag(result, recording, question, None)
            results.append(_result(scene, question, result))
    return _report(results)


def _judged(question: Question, found: Answer) -> dict[str, Any]:
    if question.type == "descriptive":
        return {"answer": found.answer, "correct": found.answer == question.answer} | _probability(found)
    choices = _judged_choices(question, found.choices)
    return {"choices": choices, "correct": all(c["correct"] for c in choices)}


def _failed(question: Question, error: NsdrError) -> dict[str, Any]:
    result: dict[str, Any] = {"correct": False, "error": str(error)}
    if question.choices:
        result["choices"] = [{"choice_id": c.id, "answer": "wrong", "correct": False} for c in question.choices]
    return result


def _result(scene: SceneQuestions, question: Question, found: Mapping[str, Any]) -> dict[str, Any]:
    about = {"scene_index": scene.scene_index, "question_id": question.id}
    of_question, of_choices = tags_of(question)
    result = {**about, "question_type": question.type, "question_subtype": question.subtype, **found, **of_question}
    if of_choices:
        result["choices"] = [row | tags for row, tags in zip(found["choices"], of_choices, strict=True)]
    return result if _labelled(question) else _unscored(result)


def _report(results: list[dict[str, Any]]) -> dict[str, Any]:
    counts = {"errors": sum(bool(_errors(r)) for r in results), "unlabelled": sum("correct" not in r for r in results)}
    return {**_table(results), **counts, "results": results}


def _recording(executor: Executor | NsdrError) -> Executor | None:
    """The executor of the same scene without physics; None without a scene."""
    if isinstance(executor, NsdrError) or executor.semantics == "official":
        return None
    return Executor(keep_recording(executor.scene))


def _tag(result: Mapping[str, Any], recording: Executor, question: Question, parse: Parse | None) -> None:
    """Add the tags of counterfactual options that have none in the question file, where the recording can judge them."""
    if question.type != "counterfactual" or not _labelled(question) or all(c.tag for c in question.choices):
        return
    with suppress(NsdrError):
        tags = option_tags(recording, _with_programs(question, parse) if parse else question)
        for choice, tag in zip(result["choices"], tags, strict=True):
            if tag is not None:
                choice["tag"] = tag


def _with_programs(question: Question, parse: Parse) -> Question:
    """The question with parsed programs where it has none; options that cannot be parsed stay without."""

    def tokens(text: str, kind: str) -> tuple[str, ...] | None:
        with suppress(QuestionError):
            return parse(text, kind).tokens
        return None

    choices = tuple(replace(c, program=c.program or tokens(c.text, "choice")) for c in question.choices)
    return replace(question, program=question.program or tokens(question.text, "multiple_choice"), choices=choices)


def _labelled(question: Question) -> bool:
    """Whether the file says what is right; the test split's does not."""
    labels = [c.answer for c in question.choices] or [question.answer]
    return None not in labels


def _unscored(result: dict[str, Any]) -> dict[str, Any]:
    """The result without `correct`."""
    unscored = {k: v for k, v in result.items() if k != "correct"}
    if "choices" in unscored:
        unscored["choices"] = [{k: v for k, v in c.items() if k != "correct"} for c in unscored["choices"]]
    return unscored


def _errors(result: dict[str, Any]) -> list[str]:
    """What failed: the question, or some of its choices."""
    return [r["error"] for r in (result, *result.get("choices", ())) if "error" in r]


def first_failure(report: Mapping[str, Any]) -> str:
    """The first question of a report that failed, itself or in a choice, with its error; "" if none did."""
    for r in report["results"]:
        for error in _errors(r):
            return f"scene {r['scene_index']}, question {r['question_id']}: {error}"
    return ""


def _answered(executor: Executor, question: Question, parse: Parse | None) -> dict[str, Any]:
    if question.type == "descriptive":
        program: ProgramSource = parse(question.text, "descriptive") if parse else _gold(executor, question.program)
        return _judged(question, executor.answer(program))
    program = parse(question.text, "multiple_choice") if parse else _gold(executor, question.program)
    programs = [(c.text, _choice_program(executor, c, parse)) for c in question.choices]
    try:
        judged = executor.judge(program, programs).choices
    except ExecutionError as e:  # of the question
        judged = tuple(ChoiceAnswer(c.text, None, (), (), str(e)) for c in question.choices)
    return _judged(question, Answer(question.text, (), None, choices=judged))


def _judged_choices(question: Question, judged: Sequence[ChoiceAnswer]) -> list[dict[str, Any]]:
    choices = []
    for choice, of_choice in zip(question.choices, judged, strict=True):
        row: dict[str, Any] = {"choice_id": choice.id}
        if of_choice.error:
            row["error"] = of_choice.error
        # A choice that fails names something that is not in the scene: it cannot be right.
        answer = "wrong" if of_choice.error else of_choice.answer
        choices.append(row | {"answer": answer, "correct": answer == choice.answer} | _probability(of_choice))
    return choices


def _probability(answer: Answer | ChoiceAnswer) -> dict[str, float]:
    return {} if answer.probability is None else {"probability": answer.probability}


def _choice_program(executor: Executor, choice: Choice, parse: Parse | None) -> ProgramSource | NsdrError:
    try:
        return parse(choice.text, "choice") if parse else _gold(executor, choice.program)
    except QuestionError as e:
        return e


def _gold(executor: Executor, program: tuple[str, ...] | None) -> ProgramSource:
    if program is None:
        raise QuestionError("the question file has no programs; use parsed ones")
    return program if executor.semantics == "official" else Program.parse(program)


def _table(results: list[dict[str, Any]]) -> dict[str, Any]:
    table: dict[str, Any] = {}
    for kind in QUESTION_TYPES:
        rows = [r for r in results if r["question_type"] == kind and "correct" in r]
        if kind == "descriptive":
            names = sorted({str(r["question_subtype"]) for r in rows})
            subtypes = {n: _accuracy([r for r in rows if str(r["question_subtype"]) == n]) for n in names}
            table[kind] = _accuracy(rows) | {"subtypes": subtypes} | _calibration(rows) | by_halves(rows, _accuracy)
        else:
            options = [{**c, "scene_index": r["scene_index"]} for r in rows for c in r["choices"]]
            table[kind] = _accuracy(options, "per_option", "options") | _accuracy(rows, "per_question", "questions")
            table[kind] |= _calibration(options)
            table[kind] |= by_halves(options, partial(_accuracy, name="per_option", what="options"))
    return table


def _calibration(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """How well the probabilities fit the truth, by `nsdr.evaluation.measures`; nothing where rows have none.

    That of an answer is to be right; that of an option, to be correct.
    """
    stated = [r for r in rows if "probability" in r]
    if not stated:
        return {}
    true = [r["correct"] == (r.get("choice_id") is None or r["answer"] == "correct") for r in stated]
    return {"calibration": calibration([r["probability"] for r in stated], true)}


def _accuracy(rows: Sequence[Mapping[str, Any]], name: str = "accuracy", what: str = "") -> dict[str, Any]:
    """The share of the rows that is correct, its interval and their number; none of no rows."""
    n, interval = (f"n_{what}", f"{name}_interval") if what else ("n", "interval")
    if not rows:
        return {name: None, n: 0}
    correct = [bool(r["correct"]) for r in rows]
    found = accuracy_interval(correct, [r["scene_index"] for r in rows])
    return {name: sum(correct) / len(rows), interval: found, n: len(rows)}


def format_table(report: dict[str, Any]) -> str:
    """The report as the paper's table: percentages with 95 % intervals of `accuracy_interval`, and the number of questions."""

    def cell(row: Mapping[str, Any], name: str = "accuracy") -> str:
        if row[name] is None:
            return "-"
        low, high = row["interval" if name == "accuracy" else f"{name}_interval"]
        return f"{100 * row[name]:.1f} [{100 * low:.1f}, {100 * high:.1f}]"

    results, unlabelled = report["results"], report["unlabelled"]
    missing = f"{unlabelled} questions have no answers in their file: they are answered, not scored"
    if results and unlabelled == len(results):
        return "\n".join([missing, *_failures(report)])
    lines = [f"{'':<22}{'per option':>22}{'per question':>22}{'questions':>11}"]
    for kind in QUESTION_TYPES:
        row = report[kind]
        if kind == "descriptive":
            parts = row["subtypes"] | row.get("blind", {})
            for name, part in {kind: row, **{f"  {n}": part for n, part in parts.items()}}.items():
                lines.append(f"{name:<22}{'':>22}{cell(part):>22}{part['n']:>11}")
        else:
            option, question = cell(row, "per_option"), cell(row, "per_question")
            lines.append(f"{kind:<22}{option:>22}{question:>22}{row['n_questions']:>11}")
            halves = row.get("tags", {}) | row.get("blind", {})
            lines += [f"  {name:<20}{cell(part, 'per_option'):>22}" for name, part in halves.items()]
    if found := calibration_text(report):
        lines.append(f"expected calibration error (Brier score): {found}")
    return "\n".join([*lines, *([missing] if unlabelled else []), *_failures(report)])


def _failures(report: dict[str, Any]) -> list[str]:
    if not report["errors"]:
        return []
    whole = sum("error" in r for r in report["results"])
    reasons = Counter(general(e)[:100] for r in report["results"] for e in _errors(r))
    return [
        f"{whole} questions failed and count as wrong; choices of {report['errors'] - whole} failed and are judged wrong:",
        *(f"  {count:>5}  {reason}" for reason, count in reasons.most_common(5)),
    ]
