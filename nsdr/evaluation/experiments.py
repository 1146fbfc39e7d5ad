"""Tables from one command each: `nsdr experiment configs/experiments/NAME.yaml` writes results/NAME.json and .md.

An experiment is a list of rows, each an `EvaluationConfig`, a baseline or published numbers.
Rows of the results file whose fingerprint is unchanged are kept: a killed experiment goes on. A results file is written by one
experiment at a time.
"""

import os
import platform
import sys
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta, structs

import nsdr
from nsdr.baselines.q_type import q_type_answers
from nsdr.clevrer.files.questions import OPTION_TAGS, QUESTION_TYPES, read_questions
from nsdr.errors import DataError
from nsdr.evaluation.baselines import USED, baseline_fingerprint, evaluate_baseline, training_text
from nsdr.evaluation.measures import calibration_text, percent
from nsdr.evaluation.report import Report
from nsdr.evaluation.runner import run_evaluation
from nsdr.evaluation.score import score_answers
from nsdr.evaluation.settings import EvaluationConfig, evaluation_fingerprint, selected_questions
from nsdr.io.configuration import config_of
from nsdr.io.files import locked, write_file, write_json
from nsdr.io.fingerprint import code_revision, fingerprint
from nsdr.io.reading import read_json, read_yaml
from nsdr.validation import convert

INTERVAL = " ({:.1f}-{:.1f})"

Percent = Annotated[float, Meta(ge=0, le=100)]
NUMBERS = 2 * len(QUESTION_TYPES) - 1
"""Of a row: one for descriptive questions, and one by option and one by question for each other type."""


class ExperimentFile(msgspec.Struct, forbid_unknown_fields=True):
    """Content of an experiment file; `common` holds for all rows."""

    title: str
    rows: Annotated[list[dict[str, Any]], Meta(min_length=1)]
    common: dict[str, Any] = {}


class ExperimentRow(msgspec.Struct, frozen=True):
    """One row of a table.

    Attributes:
        name: as it stands in the table.
        baseline: "random" or "frequent" for Q-type baselines; "" for others.
        training: question file of the training set, whose most frequent answers "frequent" gives; "" counts them on the
            questions that are scored, and the table says so.
        published: numbers to print instead of measuring (%): one for descriptive, and two for each other type or for none.
        trained: checkpoint of a trained baseline that answers the questions; "" for others.
        features: folder of the features of the videos for it; "" where it sees no video.
        evaluation: what is measured; None for published numbers.
        own: settings of `evaluation` that are the row's and not common ones.
    """

    name: str
    baseline: Literal["", "random", "frequent"] = ""
    training: str = ""
    published: tuple[Percent, ...] | None = None
    trained: str = ""
    features: str = ""
    evaluation: EvaluationConfig | None = None
    own: tuple[str, ...] = ()

    def settings(self) -> dict[str, Any]:
        """The row as plain values, for the results file."""
        evaluation = {} if self.evaluation is None else asdict(self.evaluation)
        for name in ("cache", "engine", "workers", "device"):
            evaluation.pop(name, None)
        row = {name: getattr(self, name) for name in OWN_KEYS} | {"published": self.published or ()} | evaluation
        return {k: list(v) if isinstance(v, tuple) else v for k, v in row.items()}

    def fingerprint(self) -> str:
        """Of everything the row's numbers depend on."""
        if self.evaluation is None:
            return fingerprint(config=self.settings())
        if self.trained:
            return baseline_fingerprint(self.trained, self.features, self.evaluation)
        if self.baseline:
            files = (self.evaluation.questions, self.evaluation.tags_from, self.training)
            return fingerprint(inputs=[Path(file) for file in files if file], config=self.settings())
        return evaluation_fingerprint(self.evaluation)


OWN_KEYS = ("name", "baseline", "training", "published", "trained", "features")
"""Keys of a row that are no settings of `EvaluationConfig`."""


def read_experiment(path: str | Path) -> tuple[str, list[ExperimentRow]]:
    """Title and rows of an experiment file; paths in it are relative to the current folder.

    Raises:
        DataError: names the file and the unknown or missing key.
    """
    try:
        content: ExperimentFile = convert(read_yaml(path), ExperimentFile)
        rows = [_row(content.common, row, f"rows[{i}]") for i, row in enumerate(content.rows)]
        names = Counter(row.name for row in rows)
        if len(names) < len(rows):
            raise DataError(f"two rows are named {names.most_common(1)[0][0]!r}")
    except DataError as e:
        raise DataError(
            f"{path}: not an experiment file ({e}); see 'Evaluate your own model' in the documentation"
        ) from e
    return content.title, rows


def _row(common: Mapping[str, Any], given: Mapping[str, Any], place: str) -> ExperimentRow:
    own = {k: v for k, v in given.items() if k not in OWN_KEYS}
    where = f"row {given['name']!r}: " if isinstance(given.get("name"), str) else f"{place}: "
    row: ExperimentRow = convert({k: v for k, v in given.items() if k in OWN_KEYS}, ExperimentRow, where)
    try:
        if row.training and row.baseline != "frequent":
            raise DataError(f"training is {row.training!r}; expected a question file, beside `baseline: frequent` only")
        if row.published is not None:
            if len(row.published) not in (1, NUMBERS):
                raise DataError(f"published: expected 1 or {NUMBERS} numbers, got {len(row.published)}")
            if given.keys() != {"name", "published"}:
                raise DataError("published numbers stand alone; leave out the row's other settings")
            return row
        if row.features and not row.trained:
            raise DataError("features are of a trained baseline; give trained, the folder of its checkpoint, too")
        unused = [k for k in own if row.trained and k not in USED]
        if unused:
            raise DataError(f"{unused[0]} would do nothing for a trained baseline; expected some of {', '.join(USED)}")
        values = {k: v for k, v in common.items() if not row.trained or k in USED} | own
        if row.baseline and "root" in values:
            raise DataError("root: a Q-type row reads a question file; give questions in its place")
        if (row.baseline or row.trained) and "root" not in values:  # reads no scenes
            values["data"] = values.get("questions", "")
        return structs.replace(row, evaluation=config_of(EvaluationConfig, values), own=tuple(own))
    except DataError as e:
        raise DataError(where + str(e)) from e


def run_experiment(path: str | Path, output: str | Path = "results", device: str = "auto") -> Path:
    """Measure every row that is not there yet, and write the table.

    Args:
        path: experiment file.
        output: folder for NAME.json and NAME.md.
        device: where networks run, as in `Pipeline.from_pretrained`; rows of all devices count as the same.

    Returns:
        The Markdown file.

    Raises:
        DataError: an unreadable experiment, questions or data, or another process measures it for the same output.
    """
    title, rows = read_experiment(path)
    file = Path(output) / f"{Path(path).stem}.json"
    table, command = file.with_suffix(".md"), f"nsdr experiment {path}"
    values = {row.name: row.fingerprint() for row in rows}
    with locked(output, file.name):
        known = {name: r for name, r in _earlier(file).items() if r.get("fingerprint") == values.get(name)}
        for row in rows:
            if row.name not in known:
                about = {"settings": row.settings(), "fingerprint": values[row.name]}
                known[row.name] = about | _measured(row, device)
            done = [known[r.name] for r in rows if r.name in known]  # rows that were kept, and are still to come, too
            write_json(file, {"title": title, "command": command, "rows": done}, indent=1)
        write_file(table, markdown_table(title, command, done))
    return table


def _earlier(file: Path) -> dict[str, dict[str, Any]]:
    """Rows of a results file by name."""
    if not file.exists():
        return {}
    try:
        return {row["settings"]["name"]: row for row in read_json(file)["rows"]}
    except (TypeError, KeyError) as e:
        raise DataError(f"{file}: not the results of an experiment; move it away, or choose another folder") from e


def _measured(row: ExperimentRow, device: str) -> dict[str, Any]:
    if row.evaluation is None:
        given = [n / 100 for n in row.published or ()]
        descriptive, *others = given + [None] * (NUMBERS - len(given))
        table: dict[str, Any] = {"descriptive": {"accuracy": descriptive}}
        for kind, option, question in zip(QUESTION_TYPES[1:], others[::2], others[1::2], strict=True):
            table[kind] = {"per_option": option, "per_question": question}
        return {"table": table}
    start = time.time()
    evaluation = replace(row.evaluation, device=device)
    training: dict[str, Any] = {}
    if row.trained:
        report, training = evaluate_baseline(row.trained, row.features, evaluation, row.own, device)
    elif row.baseline:
        report = _q_type_report(row, evaluation)
    else:
        report = run_evaluation(evaluation)
    return {
        "table": {kind: report[kind] for kind in QUESTION_TYPES},
        "failed_questions": report.errors,
        **({"training": training} if training else {}),
        **({"first_failure": report.first_failure} if report.errors else {}),
        "seconds": round(time.time() - start),
        "date": time.strftime("%Y-%m-%d"),
        "version": nsdr.__version__,
        "revision": code_revision(),
        "machine": f"{os.cpu_count()} cores, {platform.machine()}, Python {sys.version.split()[0]}",
    }


def _q_type_report(row: ExperimentRow, config: EvaluationConfig) -> Report:
    listed, _ = selected_questions(config)
    scenes = [
        msgspec.structs.replace(s, questions=tuple(q for q in s.questions if q.type in config.types)) for s in listed
    ]
    training = read_questions(row.training) if row.training else None
    try:
        return score_answers(q_type_answers(scenes, row.baseline, training=training, world=config.world))
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


def markdown_table(title: str, command: str, rows: Sequence[Mapping[str, Any]]) -> str:
    """The paper's table: accuracy in %, per option / per question for multiple choice, with what it was measured by."""
    header = ["", "descriptive", *QUESTION_TYPES[1:], *(f"{tag} options" for tag in OPTION_TAGS)]
    lines = [f"# {title}", "", f"| {' | '.join(header)} |", "|---" * len(header) + "|"]
    notes: dict[str, list[str]] = {
        "": [],
        "Expected calibration error of the probabilities in % (Brier score):": [],
        "Trained baselines:": [],
    }
    for row in rows:
        name, table = row["settings"]["name"], row["table"]
        cells = [percent(table["descriptive"], "accuracy", INTERVAL)]
        for kind in QUESTION_TYPES[1:]:
            option, question = (percent(table[kind], what, INTERVAL) for what in ("per_option", "per_question"))
            cells.append("-" if option == "-" else f"{option} / {question}")
        tags = table["counterfactual"].get("tags", {})
        cells += [percent(tags[tag], "per_option", INTERVAL) if tags else "-" for tag in OPTION_TAGS]
        lines.append(f"| {name} | {' | '.join(cells)} |")
        if row["settings"].get("baseline") == "frequent":
            counted = row["settings"]["training"] or "the questions themselves, not on a training set"
            notes[""] += ["", f"{name}: the most frequent answers were counted on {counted}."]
        training = training_text(row["training"]) if "training" in row else ""
        for place, text in zip(list(notes)[1:], (calibration_text(table), training), strict=True):
            notes[place] += [f"- {name}: {text}"] if text else []
    measured = [row for row in rows if "seconds" in row]
    counts = {", ".join(map(str, _numbers(row["table"]))) for row in measured}
    runs = {f"{r['date']}, version {r['version']}, revision {r['revision']}, {r['machine']}" for r in measured}
    lines += [
        "",
        f"Per option / per question, with 95 % intervals. Questions by type: {'; '.join(sorted(counts))}. Made by `{command}`",
        f"in {sum(row['seconds'] for row in measured)} s ({'; '.join(sorted(runs))}).",
    ]
    for place, texts in notes.items():
        lines += ["", place, "", *texts] if place and texts else texts
    return "\n".join(lines) + "\n"
