"""Tables from one command each: `nsdr experiment configs/experiments/NAME.yaml` writes results/NAME.json and .md.

An experiment is a list of rows, each an `EvaluationConfig`, a baseline (some of which are trained first) or published numbers.
Rows of the results file whose fingerprint is unchanged are kept: a killed experiment goes on. A results file is written by one
experiment at a time.
"""

import os
import platform
import sys
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import nsdr
from nsdr.baselines.q_type import q_type_answers
from nsdr.clevrer.files.questions import OPTION_TAGS, QUESTION_TYPES, read_questions
from nsdr.errors import DataError
from nsdr.evaluation.baselines import USED, BaselineRow, Trainer, evaluate_baseline, training_text
from nsdr.evaluation.measures import blind_text, calibration_text
from nsdr.evaluation.runner import EvaluationConfig, evaluation_fingerprint, run_evaluation, selected_questions
from nsdr.evaluation.score import first_failure, score_answers
from nsdr.io.configuration import config_of
from nsdr.io.files import atomic_path, locked, write_json
from nsdr.io.fingerprint import code_revision, fingerprint
from nsdr.io.reading import read_json, read_yaml

__all__ = ["ExperimentRow", "markdown_table", "read_experiment", "run_experiment"]

BASELINES = ("random", "frequent")


@dataclass(frozen=True)
class ExperimentRow:
    """One row of a table.

    Attributes:
        name: as it stands in the table.
        evaluation: what is measured; None for published numbers.
        baseline: "random" or "frequent" for Q-type baselines; "" to run the evaluation.
        training: question file of the training set, whose most frequent answers "frequent" gives; "" counts them on the
            questions that are scored, and the table says so.
        trained: the trained baseline that answers the questions of `evaluation`; None for others.
        own: settings of the trained baseline's row that are not common ones.
        published: numbers to print instead of measuring (%): one for descriptive and two for each other type.
    """

    name: str
    evaluation: EvaluationConfig | None
    baseline: str = ""
    training: str = ""
    trained: BaselineRow | None = None
    own: tuple[str, ...] = ()
    published: tuple[float, ...] = ()

    def settings(self) -> dict[str, Any]:
        """The row as plain values, for the results file."""
        evaluation = {} if self.evaluation is None else asdict(self.evaluation)
        for name in ("cache", "engine", "workers", "device"):
            evaluation.pop(name, None)
        row: dict[str, Any] = {"name": self.name, "baseline": self.baseline, "training": self.training}
        row |= {"published": list(self.published)} | ({} if self.trained is None else asdict(self.trained))
        return row | {k: list(v) if isinstance(v, tuple) else v for k, v in evaluation.items()}

    def fingerprint(self, trainer: Trainer | None = None) -> str:
        """Of everything the row's numbers depend on."""
        if self.evaluation is None:
            return fingerprint(config=self.settings())
        if self.trained is not None:
            return self.trained.fingerprint(self.evaluation, trainer)
        if self.baseline:
            files = [self.evaluation.questions, *([self.training] if self.training else [])]
            return fingerprint(inputs=[Path(file) for file in files], config=self.settings())
        return evaluation_fingerprint(self.evaluation)


def read_experiment(path: str | Path) -> tuple[str, list[ExperimentRow]]:
    """Title and rows of an experiment file; paths in it are relative to the current folder, `common` holds for all rows.

    Raises:
        DataError: names the file and the unknown or missing key.
    """
    content = read_yaml(path)
    try:
        if not isinstance(content, dict) or set(content) - {"title", "common", "rows"}:
            raise DataError("expected title, common and rows")
        if not isinstance(content.get("title"), str):
            raise DataError(f"title is {content.get('title')!r}; expected a text")
        common, listed = content.get("common", {}), content.get("rows")
        if not isinstance(common, dict) or not isinstance(listed, list) or not listed:
            raise DataError("expected common as `name: value` lines, and rows as a list of such")
        rows = [_row(common, row) for row in listed]
        names = Counter(row.name for row in rows)
        if len(names) < len(rows):
            raise DataError(f"two rows are named {names.most_common(1)[0][0]!r}")
    except DataError as e:
        raise DataError(f"{path}: not an experiment file ({e}); see configs/experiments") from e
    return content["title"], rows


def _row(common: dict[str, Any], row: Any) -> ExperimentRow:
    if not isinstance(row, dict) or not isinstance(row.get("name"), str):
        raise DataError(f"a row is {row!r:.60}; expected settings with a name")
    name = row["name"]
    try:
        values = {**common, **row}
        values.pop("name")
        baseline, published = values.pop("baseline", ""), values.pop("published", None)
        training = values.pop("training", "")
        if training and (not isinstance(training, str) or baseline != "frequent"):
            raise DataError(f"training is {training!r:.60}; expected a question file, beside `baseline: frequent` only")
        if baseline and baseline not in BASELINES:
            raise DataError(f"baseline is {baseline!r}; expected {' or '.join(BASELINES)}")
        if published is not None:
            if baseline or set(row) - {"name", "published"}:
                raise DataError("published numbers stand alone; leave out the row's other settings")
            return ExperimentRow(name, None, published=_published_numbers(published))
        if {"train", "trained"} & set(row):
            return _trained_row(name, common, {k: v for k, v in row.items() if k != "name"})
        if baseline:  # reads no scenes
            if "root" in values:
                raise DataError("root: a Q-type row reads a question file; give questions in its place")
            values.setdefault("data", values.get("questions", ""))
        return ExperimentRow(name, config_of(EvaluationConfig, values), baseline, training)
    except DataError as e:
        raise DataError(f"row {name!r}: {e}") from e


def _trained_row(name: str, common: Mapping[str, Any], row: Mapping[str, Any]) -> ExperimentRow:
    """The row of a trained baseline: of the common settings those that it uses."""
    which = {k: v for k, v in row.items() if k in ("train", "trained", "features")}
    own = {k: v for k, v in row.items() if k not in which}
    unknown = [k for k in own if k not in USED]
    if unknown:
        raise DataError(f"{unknown[0]} would do nothing for a trained baseline; expected some of {', '.join(USED)}")
    values = {**{k: v for k, v in common.items() if k in USED}, **own}
    if "root" not in values:
        values["data"] = values.get("questions", "")  # reads no scenes
    evaluation = config_of(EvaluationConfig, values)
    return ExperimentRow(name, evaluation, trained=config_of(BaselineRow, which), own=tuple(own))


def _published_numbers(numbers: Any) -> tuple[float, ...]:
    expected = 1 + 2 * len(QUESTION_TYPES[1:])
    listed = numbers if isinstance(numbers, list) else []
    if len(listed) == expected and all(isinstance(n, int | float) and 0 <= n <= 100 for n in listed):
        return tuple(listed)
    raise DataError(f"published is {numbers!r:.60}; expected {expected} numbers of 0 to 100")


def run_experiment(
    path: str | Path, output: str | Path = "results", device: str = "auto", trainer: Trainer | None = None
) -> Path:
    """Measure every row that is not there yet, and write the table.

    Args:
        path: experiment file.
        output: folder for NAME.json and NAME.md.
        device: where networks run, as of `Pipeline.from_pretrained`; rows of all devices count as the same.
        trainer: trains the baselines of rows with `train`; None refuses such rows.

    Returns:
        The Markdown file.

    Raises:
        DataError: an unreadable experiment, questions or data, or another process measures it for the same output.
    """
    title, rows = read_experiment(path)
    file = Path(output) / f"{Path(path).stem}.json"
    table, command = file.with_suffix(".md"), f"nsdr experiment {path}"
    values = {row.name: row.fingerprint(trainer) for row in rows}
    with locked(output, file.name):
        known = _earlier(file, values)
        for row in rows:
            if row.name not in known:
                known[row.name] = {
                    "settings": row.settings(),
                    "fingerprint": values[row.name],
                    **_measured(row, device, trainer),
                }
            done = [known[r.name] for r in rows if r.name in known]  # rows that were kept, and are still to come, too
            write_json(file, {"title": title, "command": command, "rows": done}, indent=1)
        with atomic_path(table) as temporary:
            temporary.write_text(markdown_table(title, command, done))
    return table


def _earlier(file: Path, fingerprints: Mapping[str, str]) -> dict[str, dict[str, Any]]:
    """Rows of a results file that hold, by name."""
    if not file.exists():
        return {}
    try:
        rows = {row["settings"]["name"]: row for row in read_json(file)["rows"]}
    except (TypeError, KeyError) as e:
        raise DataError(f"{file}: not the results of an experiment; move it away, or choose another folder") from e
    return {name: row for name, row in rows.items() if row.get("fingerprint") == fingerprints.get(name)}


def _measured(row: ExperimentRow, device: str, trainer: Trainer | None) -> dict[str, Any]:
    if row.evaluation is None:
        return {"table": _published(row.published)}
    start = time.time()
    evaluation = replace(row.evaluation, device=device)
    if row.trained is not None:
        report = evaluate_baseline(row.trained, evaluation, row.own, device, trainer)
    else:
        report = _baseline(row.evaluation, row) if row.baseline else run_evaluation(evaluation)
    return {
        "table": {kind: report[kind] for kind in QUESTION_TYPES},
        "failed_questions": report["errors"],
        **({"training": report["training"]} if "training" in report else {}),
        **({"first_failure": first_failure(report)} if report["errors"] else {}),
        "seconds": round(time.time() - start),
        "date": time.strftime("%Y-%m-%d"),
        "version": nsdr.__version__,
        "revision": code_revision(),
        "machine": f"{os.cpu_count()} cores, {platform.machine()}, Python {sys.version.split()[0]}",
    }


def _baseline(config: EvaluationConfig, row: ExperimentRow) -> dict[str, Any]:
    listed, _ = selected_questions(config)
    scenes = [replace(s, questions=tuple(q for q in s.questions if q.type in config.types)) for s in listed]
    training = read_questions(row.training) if row.training else None
    try:
        return score_answers(q_type_answers(scenes, row.baseline, training=training))
    except DataError as e:
        raise DataError(f"row {row.name!r}: {e}") from e


def failed_questions(table: Path) -> tuple[int, int, str]:
    """Number of questions that failed in all rows of an experiment, of all its questions, and one that failed, with its error.

    Args:
        table: as returned by `run_experiment`.
    """
    rows = [row for row in read_json(table.with_suffix(".json"))["rows"] if "failed_questions" in row]
    failed = [row for row in rows if row["failed_questions"]]
    example = "".join(f"row {r['settings']['name']!r}, {r.get('first_failure', 'see its report')}" for r in failed[:1])
    return sum(r["failed_questions"] for r in failed), sum(sum(_numbers(row["table"])) for row in rows), example


def _numbers(table: Mapping[str, Any]) -> list[int]:
    """Questions by type."""
    return [table["descriptive"]["n"], *(table[k]["n_questions"] for k in QUESTION_TYPES[1:])]


def _published(numbers: Sequence[float]) -> dict[str, Any]:
    descriptive, *others = (n / 100 for n in numbers)
    table: dict[str, Any] = {"descriptive": {"accuracy": descriptive}}
    for k, kind in enumerate(QUESTION_TYPES[1:]):
        table[kind] = {"per_option": others[2 * k], "per_question": others[2 * k + 1]}
    return table


def markdown_table(title: str, command: str, rows: Sequence[Mapping[str, Any]]) -> str:
    """The paper's table: accuracy in %, per option / per question for multiple choice, with what it was measured by."""
    header = ["", "descriptive", *QUESTION_TYPES[1:], *(f"{tag} options" for tag in OPTION_TAGS)]
    lines = [f"# {title}", "", f"| {' | '.join(header)} |", "|---" * len(header) + "|"]
    for row in rows:
        table = row["table"]
        cells = [_percent(table["descriptive"], "accuracy")]
        for kind in QUESTION_TYPES[1:]:
            option, question = (_percent(table[kind], name) for name in ("per_option", "per_question"))
            cells.append("-" if option == "-" else f"{option} / {question}")
        tags = table["counterfactual"].get("tags", {})
        cells += [_percent(tags[tag], "per_option") if tags else "-" for tag in OPTION_TAGS]
        lines.append(f"| {row['settings']['name']} | {' | '.join(cells)} |")
    counts: set[str] = set()
    runs: set[str] = set()
    for row in rows:
        if "seconds" in row:
            counts.add(", ".join(str(n) for n in _numbers(row["table"])))
            runs.add(f"{row['date']}, version {row['version']}, revision {row['revision']}, {row['machine']}")
    total = sum(row.get("seconds", 0) for row in rows)
    lines += [
        "",
        f"Per option / per question, with 95 % intervals. Questions by type: {'; '.join(sorted(counts))}. Made by `{command}`",
    ]
    lines += [f"in {total} s ({'; '.join(sorted(runs))})."]
    for row in rows:
        if row["settings"].get("baseline") == "frequent":
            counted = row["settings"]["training"] or "the questions themselves, not on a training set"
            lines += ["", f"{row['settings']['name']}: the most frequent answers were counted on {counted}."]
    errors = [f"{row['settings']['name']}: {calibration_text(row['table'])}" for row in rows]
    errors = [line for line in errors if not line.endswith(": ")]
    if errors:
        lines += [
            "",
            "Expected calibration error of the probabilities in % (Brier score):",
            "",
            *(f"- {e}" for e in errors),
        ]
    halves = [f"- {row['settings']['name']}: {text}" for row in rows if (text := blind_text(row["table"]))]
    if halves:
        lines += [
            "",
            "Where the text alone predicts the answer / where it does not (`nsdr tag`), per option:",
            "",
            *halves,
        ]
    trained = [f"- {row['settings']['name']}: {training_text(row['training'])}" for row in rows if "training" in row]
    if trained:
        lines += ["", "Trained baselines:", "", *trained]
    return "\n".join(lines) + "\n"


def _percent(row: Mapping[str, Any], name: str) -> str:
    """A share in %, with its interval where it was measured."""
    if row[name] is None:
        return "-"
    interval = row.get("interval" if name == "accuracy" else f"{name}_interval")
    return f"{100 * row[name]:.1f}" + (f" ({100 * interval[0]:.1f}-{100 * interval[1]:.1f})" if interval else "")
