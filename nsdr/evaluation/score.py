"""Scores answers the way the paper does: descriptive accuracy; the other types per option and per question."""

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from typing import Any

from nsdr.clevrer.questions import QUESTION_TYPES, Choice, Question, SceneQuestions
from nsdr.errors import ExecutionError, NsdrError, QuestionError
from nsdr.evaluation.intervals import wilson_interval
from nsdr.symbolic import Executor, Program

__all__ = ["Parse", "evaluate", "format_table"]

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
        The table by question type as fractions 0-1, and under `results` every question with its answers. What fails
        is counted wrong and carries its `error`.
    """
    results = []
    for questions, executor in scenes:
        for question in questions.questions:
            if question.type not in types:
                continue
            result: dict[str, Any] = {"scene_index": questions.scene_index, "question_id": question.id}
            result |= {"question_type": question.type, "question_subtype": question.subtype}
            try:
                if isinstance(executor, NsdrError):
                    raise executor
                result |= _answered(executor, question, parse)
            except NsdrError as e:
                result |= {"correct": False, "error": str(e)}
                if question.choices:
                    result["choices"] = [
                        {"choice_id": c.id, "answer": "wrong", "correct": False} for c in question.choices
                    ]
            results.append(result)
    return {**_table(results), "errors": sum("error" in r for r in results), "results": results}


def _answered(executor: Executor, question: Question, parse: Parse | None) -> dict[str, Any]:
    if question.type == "descriptive":
        program = parse(question.text, "descriptive") if parse else _gold(question.program)
        answer = executor.answer(program).answer
        return {"answer": answer, "correct": answer == question.answer}
    program = parse(question.text, "multiple_choice") if parse else _gold(question.program)
    try:
        programs = [(c.text, parse(c.text, "choice") if parse else _gold(c.program)) for c in question.choices]
        answers: list[Any] = [c.answer for c in executor.judge(program, programs).choices]
    except (ExecutionError, QuestionError):
        answers = [_judged_alone(executor, program, choice, parse) for choice in question.choices]
    choices = []
    for choice, answer in zip(question.choices, answers, strict=True):
        row: dict[str, Any] = {"choice_id": choice.id}
        if isinstance(answer, NsdrError):
            # The choice names something that is not in the scene: it cannot be right.
            row["error"] = str(answer)
            answer = "wrong"
        choices.append(row | {"answer": answer, "correct": answer == choice.answer})
    return {"choices": choices, "correct": all(c["correct"] for c in choices)}


def _judged_alone(executor: Executor, program: Program, choice: Choice, parse: Parse | None) -> str | NsdrError:
    try:
        choice_program = parse(choice.text, "choice") if parse else _gold(choice.program)
        return executor.judge(program, [(choice.text, choice_program)]).choices[0].answer
    except (ExecutionError, QuestionError) as e:
        return e


def _gold(program: tuple[str, ...] | None) -> Program:
    if program is None:
        raise QuestionError("the question file has no programs; use parsed ones")
    return Program.parse(program)


def _table(results: list[dict[str, Any]]) -> dict[str, Any]:
    table: dict[str, Any] = {}
    for kind in QUESTION_TYPES:
        rows = [r for r in results if r["question_type"] == kind]
        if kind == "descriptive":
            subtypes = {}
            for name in sorted({str(r["question_subtype"]) for r in rows}):
                of_type = [r for r in rows if str(r["question_subtype"]) == name]
                subtypes[name] = {"accuracy": _share(of_type), "n": len(of_type)}
            table[kind] = {"accuracy": _share(rows), "n": len(rows), "subtypes": subtypes}
        else:
            options = [c for r in rows for c in r["choices"]]
            table[kind] = {"per_option": _share(options), "per_question": _share(rows)}
            table[kind] |= {"n_options": len(options), "n_questions": len(rows)}
    return table


def _share(rows: list[dict[str, Any]]) -> float | None:
    return sum(r["correct"] for r in rows) / len(rows) if rows else None


def format_table(report: dict[str, Any]) -> str:
    """The report as the paper's table: percentages with 95 % Wilson intervals, and the number of questions."""

    def cell(value: float | None, n: int) -> str:
        if value is None:
            return "-"
        low, high = wilson_interval(value, n)
        return f"{100 * value:.1f} [{100 * low:.1f}, {100 * high:.1f}]"

    lines = [f"{'':<22}{'per option':>22}{'per question':>22}{'questions':>11}"]
    for kind in QUESTION_TYPES:
        row = report[kind]
        if kind == "descriptive":
            lines.append(f"{kind:<22}{'':>22}{cell(row['accuracy'], row['n']):>22}{row['n']:>11}")
            for name, part in row["subtypes"].items():
                lines.append(f"  {name:<20}{'':>22}{cell(part['accuracy'], part['n']):>22}{part['n']:>11}")
        else:
            option, question = cell(row["per_option"], row["n_options"]), cell(row["per_question"], row["n_questions"])
            lines.append(f"{kind:<22}{option:>22}{question:>22}{row['n_questions']:>11}")
    if report["errors"]:
        lines.append(f"{report['errors']} questions failed and count as wrong:")
        reasons = Counter(_reason(r["error"]) for r in report["results"] if "error" in r)
        lines += [f"  {count:>5}  {reason}" for reason, count in reasons.most_common(5)]
    return "\n".join(lines)


def _reason(error: str) -> str:
    """An execution error without its inputs, so that similar ones are counted together."""
    head, _, tail = error.partition("(")
    return f"{head.split(' ')[-1]}: {tail.rsplit('): ', 1)[-1]}" if "): " in tail else error[:100]
