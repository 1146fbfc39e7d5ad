"""Scores files of answers by one protocol: what cannot be read or is missing counts as wrong, and is counted and listed."""

from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

from msgspec.structs import replace

from nsdr.baselines.q_type import q_type_answers
from nsdr.clevrer.answers.answer_files import ERROR, Given, QuestionKey, read_given
from nsdr.clevrer.answers.prompts import option_letters
from nsdr.clevrer.answers.responses import Response
from nsdr.clevrer.files.questions import OPTION_TAGS, QUESTION_TYPES, Question, SceneQuestions
from nsdr.errors import DataError, NsdrError
from nsdr.evaluation.measures import percent
from nsdr.evaluation.report import Report
from nsdr.evaluation.score import score_answers
from nsdr.io.worlds import WorldSource
from nsdr.types import Answer, ChoiceAnswer
from nsdr.types.answers import answer_from_word
from nsdr.world.world import CLEVRER_WORLD

MISSING, UNREAD = "missing: the file has no answer", "unread"
"""How the errors of missing and of unread answers begin."""
SHOWN_CHARACTERS = 300
"""Characters of an unread response that the report keeps."""
LISTED = 5
"""Unread responses, and missing or unknown questions, that the printed report names; the JSON report has them all."""


@dataclass(frozen=True)
class ResponseReport(Report):
    """The scores of a file of answers. Printed, it also has the systems that see nothing, and what was not read, is missing or
    unknown.

    Attributes:
        references: systems that see nothing on the same questions, as in `reference_rows`.
        responses: numbers of `questions`, `answered` ones and `scored` ones; ids of the `missing` and of the `unknown`
            questions; `read_as`, how often answers were found in which form; `unread_by_type`; `unread`, each with its id,
            type, problem and first characters; and `failed_options`, for which a submission says "error".
    """

    references: Mapping[str, Any] = field(default_factory=dict)
    responses: Mapping[str, Any] = field(default_factory=dict)

    def __str__(self) -> str:
        return "\n".join([*self.table_lines(), "", *_reference_lines(self.references), "", *self.response_lines()])

    def response_lines(self) -> list[str]:
        """What was not read, is missing or unknown."""
        responses = self.responses
        asked, answered = responses["questions"], responses["answered"]
        lines = [f"{answered} of {asked} questions have an answer; {responses['scored']} are scored"]
        if responses["missing"]:
            verdict = "they are left out" if responses["scored"] == answered else "they count as wrong"
            lines.append(f"{len(responses['missing'])} have none ({_listed(responses['missing'])}): {verdict}")
        if responses["unknown"]:
            lines.append(
                f"{len(responses['unknown'])} answers are about other questions ({_listed(responses['unknown'])}): ignored"
            )
        lines.append("read from: " + (", ".join(f"{how} {n}" for how, n in responses["read_as"].items()) or "nothing"))
        if unread := responses["unread"]:
            counts = ", ".join(f"{kind} {n}" for kind, n in responses["unread_by_type"].items() if n)
            lines.append(f"{len(unread)} responses cannot be read and count as wrong: {counts}")
            lines += [f"  {u['id']}: {u['problem']}: {u['response'][:60]!r}" for u in unread[:LISTED]]
        if failed := responses["failed_options"]:
            lines.append(f"options with the answer {ERROR!r}, which counts as wrong: {len(failed)} ({_listed(failed)})")
        return lines


def score_responses(
    scenes: Sequence[SceneQuestions],
    given: Mapping[QuestionKey, Given],
    allow_missing: bool = False,
    world: WorldSource = CLEVRER_WORLD,
) -> ResponseReport:
    """Read and score a system's answers.

    Args:
        scenes: questions with their answers.
        given: the system's answers, as in `read_answers`.
        allow_missing: score the answered questions only; else those without an answer count as wrong.
        world: whose words answers have.

    Raises:
        DataError: no answer is about one of the questions, or these have no answers in their file.
    """
    asked = {(s.scene_index, q.id) for s in scenes for q in s.questions}
    if not asked & given.keys():
        raise DataError(
            f"none of the {len(given)} answers is about one of the {len(asked)} questions; is it another split?"
        )
    unread: list[dict[str, Any]] = []
    read_as: Counter[str] = Counter()
    failed: list[str] = []

    def read(question: Question, key: QuestionKey) -> Answer | NsdrError:
        if key not in given:
            return DataError(MISSING)
        response = read_given(question, given[key], world)
        if response.answer is not None:
            read_as[response.how] += 1
            failed.extend(f"{_id(key)}, option {letter}" for letter in sorted(response.failed))
            return answer_of(question, response)
        unread.append(
            {
                "id": _id(key),
                "question_type": question.type,
                "problem": response.problem,
                "response": str(given[key])[:SHOWN_CHARACTERS],
            }
        )
        return DataError(f"{UNREAD}: {response.problem.split(':')[0]}")

    kept = asked & given.keys() if allow_missing else asked
    scored = [replace(s, questions=tuple(q for q in s.questions if (s.scene_index, q.id) in kept)) for s in scenes]
    report = score_answers((s, {q.id: read(q, (s.scene_index, q.id)) for q in s.questions}) for s in scored)
    if report.unlabelled:
        raise DataError(f"{report.unlabelled} questions have no answers in their file; score on train or validation")
    responses = {
        "questions": len(asked),
        "answered": len(asked & given.keys()),
        "scored": len(kept),
        "missing": [_id(key) for key in sorted(asked - given.keys())],
        "unknown": [_id(key) for key in sorted(given.keys() - asked)],
        "read_as": dict(sorted(read_as.items())),
        "unread_by_type": {kind: sum(u["question_type"] == kind for u in unread) for kind in QUESTION_TYPES},
        "unread": unread,
        "failed_options": failed,
    }
    return ResponseReport(report.results, references=reference_rows(scored), responses=responses)


def answer_of(question: Question, response: Response) -> Answer:
    """What was read in a response, as a result of a system: a word, or judgements of the options by their letters.

    An option on which the system failed is judged as "error", which is never right.
    """
    if isinstance(response.answer, str):
        return Answer(question.text, (), answer_from_word(response.answer))
    right = response.answer or frozenset()
    letters = option_letters(len(question.choices))
    judged = [
        ChoiceAnswer(c.text, ERROR if x in response.failed else "correct" if x in right else "wrong", (), ())
        for x, c in zip(letters, question.choices, strict=True)
    ]
    return Answer.of_choices(question.text, (), judged)


def _id(key: QuestionKey) -> str:
    return f"{key[0]}-{key[1]}"


def _listed(ids: Sequence[str]) -> str:
    return ", ".join(ids[:LISTED]) + (", …" if len(ids) > LISTED else "")


CONSTANT = {"always-yes": ("yes", "correct"), "always-no": ("no", "wrong")}
"""The answer to every open question and to every option."""
COLUMN = 15
"""Width of a column of the printed table (characters)."""


def reference_rows(scenes: Sequence[SceneQuestions]) -> dict[str, dict[str, Any]]:
    """By system that sees nothing its accuracies (0-1) by question type, and where there are pairs, under `pairs` by kind.

    The systems are "always-yes" and "always-no"; and "frequent", which gives the most frequent answer of these same questions
    to each type (and so is an upper bound of what the types alone tell), left out where open questions have no CLEVRER
    subtypes.

    Args:
        scenes: questions with answers.
    """
    reports = {
        name: score_answers((s, {q.id: _constant(q, *words) for q in s.questions}) for s in scenes)
        for name, words in CONSTANT.items()
    }
    with suppress(DataError):
        reports["frequent"] = score_answers(q_type_answers(scenes, "frequent"))
    kept = (*QUESTION_TYPES, "pairs")
    return {name: {kind: report[kind] for kind in kept if kind in report.tables} for name, report in reports.items()}


def _reference_lines(rows: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """A table in percentages, of multiple choice per option / per question; of tagged options per option; of pairs."""
    lines = ["systems that see nothing, on the same questions (per option / per question):"]
    header = [*QUESTION_TYPES, *(OPTION_TAGS if any("tags" in row["counterfactual"] for row in rows.values()) else ())]
    header += next(iter(rows.values())).get("pairs", {})
    for name, row in {"": None, **rows}.items():
        cells = header
        if row is not None:
            cells = [percent(row["descriptive"], "accuracy")]
            cells += [
                f"{percent(row[k], 'per_option')} / {percent(row[k], 'per_question')}" for k in QUESTION_TYPES[1:]
            ]
            cells += [percent(tag, "per_option") for tag in row["counterfactual"].get("tags", {}).values()]
            cells += [percent(pair, "accuracy") for pair in row.get("pairs", {}).values()]
        lines.append(f"  {name:<11}" + "".join(f"{cell:>{COLUMN}}" for cell in cells))
    return lines


def _constant(question: Question, word: str, judgement: str) -> Answer:
    judged = [ChoiceAnswer(c.text, judgement, (), ()) for c in question.choices]
    if judged:
        return Answer.of_choices(question.text, (), judged)
    return Answer(question.text, (), answer_from_word(word))
