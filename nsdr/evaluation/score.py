"""Scores answers the way the paper does: descriptive accuracy; the other types per option and per question."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

from nsdr.clevrer.files.questions import OPTION_TAGS, PAIR_KINDS, QUESTION_TYPES, Question, SceneQuestions
from nsdr.errors import ExecutionError, NsdrError, QuestionError
from nsdr.evaluation.measures import accuracy_interval, calibration, calibration_text, percent
from nsdr.symbolic import Executor, OfficialExecutor, Program
from nsdr.symbolic.program import ProgramSource
from nsdr.types import Answer, ChoiceAnswer

Parse = Callable[[str, str], Program]
"""(text, kind) -> program, as `QuestionParser.parse`."""
Row = dict[str, Any]
INTERVAL = " [{:.1f}, {:.1f}]"


def evaluate(
    scenes: Iterable[tuple[SceneQuestions, Executor | OfficialExecutor | NsdrError]],
    parse: Parse | None = None,
    types: Sequence[str] = QUESTION_TYPES,
) -> dict[str, Any]:
    """Answer and score all questions.

    Args:
        scenes: questions with the executor of the scene they are about, or the error that kept it from being made.
        parse: turns texts into programs; None runs the programs of the question file.
        types: question types to answer.

    Returns:
        The table by question type: fractions 0-1, their 95 % intervals as in `accuracy_interval`, and numbers. Where options
        have tags, `tags` has the accuracy on each kind; where there are pairs, `pairs` has, by kind, the share of those with
        both questions right; where answers have probabilities, there is `calibration` as in `nsdr.evaluation.measures`.
        `results` has every question with its answers. What fails carries its `error`: a whole question, which counts as wrong,
        or a single choice, which is judged wrong. `errors` is the number of questions with either. Questions without answers in
        their file are answered, not scored: their results have no `correct`, and `unlabelled` is their number. `notes` has
        those of scenes (`Scene.notes`) by scene index; a result has those about how its texts were read.
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
            results.append(_result(scene, question, found) | _known(notes=[n for n in said if n not in known] or None))
    return _report(results, notes)


def score_answers(answered: Iterable[tuple[SceneQuestions, Mapping[int, Answer | NsdrError]]]) -> dict[str, Any]:
    """Score answers of a system that has no scenes.

    Args:
        answered: questions with the answers by question id, or why a question has none; questions that are not among them are
            left out.

    Returns:
        The report, as in `evaluate`.
    """
    return _report(
        [
            _result(scene, question, answers[question.id])
            for scene, answers in answered
            for question in scene.questions
            if question.id in answers
        ],
        {},
    )


def _answer(executor: Executor | OfficialExecutor, question: Question, parse: Parse | None) -> Answer | NsdrError:
    """The answer, or why there is none."""

    def program_of(text: str, program: tuple[str, ...] | None, kind: str) -> ProgramSource:
        if parse:
            return parse(text, kind)
        if program is None:
            raise QuestionError("the question file has no programs; use parsed ones")
        return program if isinstance(executor, OfficialExecutor) else Program.parse(program)

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
            failed = tuple(ChoiceAnswer(c.text, None, (), (), str(e)) for c in question.choices)
            return Answer(question.text, (), None, choices=failed)
    except NsdrError as e:
        return e


def _result(scene: SceneQuestions, question: Question, found: Answer | NsdrError) -> Row:
    """A question's row of the report."""
    is_scored = None not in ([c.answer for c in question.choices] or [question.answer])  # the test split has no answers
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
        correct = found.answer == question.answer
        row |= {"answer": found.answer} | _known(probability=found.probability)
    else:
        # A choice that fails names something that is not in the scene: it cannot be right.
        judged = [replace(c, answer="wrong") if c.error else c for c in found.choices]
        correct = all(c.answer == choice.answer for c, choice in zip(judged, question.choices, strict=True))
    if question.choices:
        row["choices"] = [
            _known(
                choice_id=choice.id,
                error=c.error or None,
                answer=c.answer,
                correct=("error" not in row and c.answer == choice.answer) if is_scored else None,
                probability=c.probability,
                tag=choice.tag,
            )
            for choice, c in zip(question.choices, judged, strict=True)
        ]
    row |= _known(pair=question.pair, pair_kind=question.pair_kind)
    return row | _known(correct=correct if is_scored else None)


def _known(**values: Any) -> Row:
    return {name: value for name, value in values.items() if value is not None}


def _report(results: list[Row], notes: Mapping[str, list[str]]) -> dict[str, Any]:
    table: dict[str, Any] = {}
    for kind in QUESTION_TYPES:
        rows = [r for r in results if r["question_type"] == kind and "correct" in r]
        if kind == "descriptive":
            names = sorted({str(r["question_subtype"]) for r in rows})
            subtypes = {n: _accuracy([r for r in rows if str(r["question_subtype"]) == n]) for n in names}
            table[kind] = _accuracy(rows) | {"subtypes": subtypes} | _calibration(rows)
        else:
            options = [{**c, "scene_index": r["scene_index"]} for r in rows for c in r["choices"]]
            per_option = partial(_accuracy, name="per_option", what="options")
            table[kind] = per_option(options) | _accuracy(rows, "per_question", "questions")
            table[kind] |= _calibration(options)
            if any("tag" in option for option in options):
                by_tag = {tag: [o for o in options if o.get("tag") == tag] for tag in OPTION_TAGS}
                table[kind]["tags"] = {tag: per_option(tagged) for tag, tagged in by_tag.items()}
    if pairs := _pairs([r for r in results if "correct" in r]):
        table["pairs"] = pairs
    counts = {"errors": sum(bool(_errors(r)) for r in results), "unlabelled": sum("correct" not in r for r in results)}
    return {**table, **counts, "notes": notes, "results": results}


def _pairs(rows: Sequence[Row]) -> Row:
    """By kind of pair the share in which both questions are answered rightly; without kinds of which there are none."""
    by_id = {f"{r['scene_index']}-{r['question_id']}": r for r in rows}
    pairs = [(by_id[r["pair"]], r) for r in rows if r.get("pair") in by_id]
    found = {}
    for kind in PAIR_KINDS:
        of_kind = [(first, second) for first, second in pairs if second["pair_kind"] == kind]
        found[kind] = _accuracy(
            [{**first, "correct": first["correct"] and second["correct"]} for first, second in of_kind]
        )
    return {kind: accuracy for kind, accuracy in found.items() if accuracy["n"]}


def _calibration(rows: Sequence[Mapping[str, Any]]) -> Row:
    """How well the probabilities of answers to be right, or of options to be correct, fit the truth; {} without any."""
    stated = [r for r in rows if "probability" in r]
    if not stated:
        return {}
    true = [r["correct"] == ("choice_id" not in r or r["answer"] == "correct") for r in stated]
    return {"calibration": calibration([r["probability"] for r in stated], true)}


def _accuracy(rows: Sequence[Mapping[str, Any]], name: str = "accuracy", what: str = "") -> Row:
    """The share of the rows that is correct, its interval and their number; none of no rows."""
    n, interval = (f"n_{what}", f"{name}_interval") if what else ("n", "interval")
    if not rows:
        return {name: None, n: 0}
    correct = [bool(r["correct"]) for r in rows]
    found = accuracy_interval(correct, [r["scene_index"] for r in rows])
    return {name: sum(correct) / len(rows), interval: found, n: len(rows)}


def _errors(result: Mapping[str, Any]) -> list[str]:
    """What failed: the question, or some of its choices."""
    return [r["error"] for r in (result, *result.get("choices", ())) if "error" in r]


def first_failure(report: Mapping[str, Any]) -> str:
    """The first question of a report that failed, itself or in a choice, with its error; "" if none did."""
    for r in report["results"]:
        for error in _errors(r):
            return f"scene {r['scene_index']}, question {r['question_id']}: {error}"
    return ""


def format_table(report: dict[str, Any]) -> str:
    """The report as the paper's table: percentages with 95 % intervals of `accuracy_interval`, and the number of questions."""
    results, unlabelled = report["results"], report["unlabelled"]
    lines = []
    if not results or unlabelled < len(results):
        lines.append(f"{'':<22}{'per option':>22}{'per question':>22}{'questions':>11}")
        for kind in QUESTION_TYPES:
            row = report[kind]
            parts = {f"  {name}": part for by in ("subtypes", "tags") for name, part in row.get(by, {}).items()}
            if kind == "descriptive":
                for name, part in {kind: row, **parts}.items():
                    lines.append(f"{name:<22}{'':>22}{percent(part, 'accuracy', INTERVAL):>22}{part['n']:>11}")
            else:
                option, question = (percent(row, name, INTERVAL) for name in ("per_option", "per_question"))
                lines.append(f"{kind:<22}{option:>22}{question:>22}{row['n_questions']:>11}")
                lines += [f"{name:<22}{percent(part, 'per_option', INTERVAL):>22}" for name, part in parts.items()]
        for kind, row in report.get("pairs", {}).items():
            what = f"{kind} pairs, both"
            lines.append(f"{what:<22}{'':>22}{percent(row, 'accuracy', INTERVAL):>22}{row['n']:>11}")
        if found := calibration_text(report):
            lines.append(f"expected calibration error (Brier score): {found}")
    if unlabelled:
        lines.append(f"{unlabelled} questions have no answers in their file: they are answered, not scored")
    if report["errors"]:
        whole = sum("error" in r for r in results)
        partly = report["errors"] - whole
        lines.append(f"{whole} questions failed and count as wrong; choices of {partly} failed and are judged wrong")
    return "\n".join(lines)
