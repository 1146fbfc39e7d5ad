"""The scores of a system on questions: tables with intervals, and every answer."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import cached_property, partial
from pathlib import Path
from typing import Any

from nsdr.clevrer.files.questions import OPTION_TAGS, PAIR_KINDS, QUESTION_TYPES
from nsdr.errors import DataError
from nsdr.evaluation.measures import accuracy_interval, calibration, calibration_text, percent
from nsdr.io.files import write_json
from nsdr.io.reading import read_json
from nsdr.validation import convert

Row = dict[str, Any]
INTERVAL = " [{:.1f}, {:.1f}]"


@dataclass(frozen=True)
class Report:
    """The scores of a system. Printed, it is the paper's table in percent, with 95 % intervals and numbers of questions.

    `report["counterfactual"]["per_option"]` reads a table.

    Attributes:
        results: every question with `scene_index`, `question_id`, `question_type`, its `answer` or `choices`, whether it is
            `correct` (absent if its file has no answer), and `error` if it failed.
        notes: what a user should know about scenes (`Scene.notes`), by scene index.
    """

    results: Sequence[Row]
    notes: Mapping[str, Sequence[str]] = field(default_factory=dict)

    @cached_property
    def tables(self) -> Mapping[str, Any]:
        """By question type the accuracies (0-1), their 95 % intervals (see `nsdr.evaluation.accuracy_interval`) and numbers.

        Descriptive questions and each of their `subtypes` have `accuracy`, `interval` and `n`; the other types `per_option` and
        `per_question`, with `…_interval` and `n_…`, and by kind of option `tags`, if options have tags. If answers have
        probabilities, there is `calibration` (see `nsdr.evaluation.calibration`). If there are pairs of questions, `pairs` has
        by kind the share of the pairs with both questions right.
        """
        return _tables(self.results)

    def __getitem__(self, name: str) -> Any:
        return self.tables[name]

    @property
    def errors(self) -> int:
        """Number of questions that failed, as a whole or in some of their choices."""
        return sum(bool(_errors(r)) for r in self.results)

    @property
    def unlabelled(self) -> int:
        """Number of questions that have no answers in their file."""
        return sum("correct" not in r for r in self.results)

    @property
    def first_failure(self) -> str:
        """The first question that failed, as a whole or in a choice, with its error; "" if none did."""
        for r in self.results:
            for error in _errors(r):
                return f"scene {r['scene_index']}, question {r['question_id']}: {error}"
        return ""

    def save(self, path: str | Path) -> None:
        """Write the report as JSON, for `Report.load`.

        Raises:
            DataError: the name does not end in `.json`.
        """
        if Path(path).suffix != ".json":
            raise DataError(f"{path}: expected a name ending in .json")
        write_json(path, self.document(), indent=1)

    def document(self) -> dict[str, Any]:
        """The report as plain values for a JSON file."""
        return {**self.tables, "errors": self.errors, "unlabelled": self.unlabelled, **asdict(self)}

    @classmethod
    def load(cls, path: str | Path) -> "Report":
        """Read a report that `save` wrote.

        Raises:
            DataError: the file is missing or no such report; names it.
        """
        content = convert(read_json(path), dict[str, Any], f"{path}: ")
        try:
            return cls(content["results"], content["notes"])
        except KeyError as e:
            raise DataError(f"{path}: not a report of `nsdr.evaluate`: it has no {e}") from e

    def __str__(self) -> str:
        return "\n".join([*self.table_lines(), *self._failures()])

    def _failures(self) -> list[str]:
        if not self.errors:
            return []
        whole = sum("error" in r for r in self.results)
        partly = self.errors - whole
        texts = [f"questions that failed and count as wrong: {whole}"] if whole else []
        texts += [f"questions with choices that failed and are judged wrong: {partly}"] if partly else []
        return ["; ".join(texts)]

    def table_lines(self) -> list[str]:
        """The lines of the printed table."""
        lines = []
        if not self.results or self.unlabelled < len(self.results):
            lines.append(f"{'':<22}{'per option':>22}{'per question':>22}{'questions':>11}")
            for kind in QUESTION_TYPES:
                row = self.tables[kind]
                parts = {f"  {name}": part for by in ("subtypes", "tags") for name, part in row.get(by, {}).items()}
                if kind == "descriptive":
                    for name, part in {kind: row, **parts}.items():
                        lines.append(f"{name:<22}{'':>22}{percent(part, 'accuracy', INTERVAL):>22}{part['n']:>11}")
                else:
                    option, question = (percent(row, name, INTERVAL) for name in ("per_option", "per_question"))
                    lines.append(f"{kind:<22}{option:>22}{question:>22}{row['n_questions']:>11}")
                    lines += [f"{name:<22}{percent(part, 'per_option', INTERVAL):>22}" for name, part in parts.items()]
            for kind, row in self.tables.get("pairs", {}).items():
                what = f"{kind} pairs, both"
                lines.append(f"{what:<22}{'':>22}{percent(row, 'accuracy', INTERVAL):>22}{row['n']:>11}")
            if found := calibration_text(self.tables):
                lines.append(f"expected calibration error (Brier score): {found}")
        if self.unlabelled:
            lines.append(f"{self.unlabelled} questions have no answers in their file: they are answered, not scored")
        return lines


def _tables(results: Sequence[Row]) -> dict[str, Any]:
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
    return table


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


def without_none(**values: Any) -> Row:
    """Those of the values that are not None."""
    return {name: value for name, value in values.items() if value is not None}
