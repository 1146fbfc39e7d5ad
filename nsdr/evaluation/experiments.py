"""Tables from one command each: `nsdr experiment configs/experiments/NAME.yaml` writes results/NAME.json and .md.

An experiment is a list of rows, each an `EvaluationConfig`, a baseline or published numbers. Rows of the results file whose
fingerprint is unchanged are kept: a killed experiment goes on.
"""

import os
import platform
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any

import yaml

import nsdr
from nsdr.baselines.q_type import q_type_baselines
from nsdr.clevrer.questions import QUESTION_TYPES, SceneQuestions, read_questions
from nsdr.errors import DataError
from nsdr.evaluation.runner import EvaluationConfig, evaluation_fingerprint, run_evaluation
from nsdr.io.files import read_json, write_json
from nsdr.io.fingerprint import code_revision, fingerprint

__all__ = ["ExperimentRow", "markdown_table", "read_experiment", "run_experiment"]

BASELINES = ("random", "frequent")


@dataclass(frozen=True)
class ExperimentRow:
    """One row of a table.

    Attributes:
        name: as it stands in the table.
        evaluation: what is measured; None for published numbers.
        baseline: "random" or "frequent" for Q-type baselines, whose frequencies are counted on the questions themselves; "" to
            run the evaluation.
        published: numbers to print instead of measuring (%): one for descriptive and two for each other type.
    """

    name: str
    evaluation: EvaluationConfig | None
    baseline: str = ""
    published: tuple[float, ...] = ()

    def settings(self) -> dict[str, Any]:
        """The row as plain values, for the results file."""
        evaluation = {} if self.evaluation is None else asdict(self.evaluation)
        for name in ("cache", "engine", "workers"):
            evaluation.pop(name, None)
        row = {"name": self.name, "baseline": self.baseline, "published": list(self.published)}
        return row | {k: list(v) if isinstance(v, tuple) else v for k, v in evaluation.items()}

    def fingerprint(self) -> str:
        """Of everything the row's numbers depend on."""
        if self.evaluation is None:
            return fingerprint(config=self.settings())
        if self.baseline:
            return fingerprint(inputs=[Path(self.evaluation.questions)], config=self.settings())
        return evaluation_fingerprint(self.evaluation)


def read_experiment(path: str | Path) -> tuple[str, list[ExperimentRow]]:
    """Title and rows of an experiment file; paths in it are relative to the current folder, `common` holds for all rows.

    Raises:
        DataError: names the file and the unknown or missing key.
    """
    try:
        content = yaml.safe_load(Path(path).read_text())
        common = content.get("common", {})
        return content["title"], [_row({**common, **row}) for row in content["rows"]]
    except (OSError, yaml.YAMLError, KeyError, TypeError, AttributeError, DataError) as e:
        raise DataError(f"{path}: not an experiment file ({e}); see configs/experiments") from e


def _row(values: dict[str, Any]) -> ExperimentRow:
    name, baseline = values.pop("name"), values.pop("baseline", "")
    published = tuple(values.pop("published", ()))
    known = {f.name for f in fields(EvaluationConfig)}
    unknown = sorted(set(values) - known)
    if unknown:
        raise DataError(f"unknown key {unknown[0]!r} in row {name!r}")
    if baseline and baseline not in BASELINES:
        raise DataError(f"baseline is {baseline!r}; expected {' or '.join(BASELINES)}")
    if published:
        return ExperimentRow(name, None, "", published)
    if baseline:  # reads no scenes
        values.setdefault("data", values.get("questions", ""))
    return ExperimentRow(name, EvaluationConfig(**values), baseline)


def run_experiment(path: str | Path, output: str | Path = "results", device: str = "auto") -> Path:
    """Measure every row that is not there yet, and write the table.

    Args:
        path: experiment file.
        output: folder for NAME.json and NAME.md.
        device: where networks run, as of `Pipeline.from_pretrained`; rows of all devices count as the same.

    Returns:
        The Markdown file.

    Raises:
        DataError: an unreadable experiment, questions or data.
    """
    title, rows = read_experiment(path)
    file = Path(output) / f"{Path(path).stem}.json"
    known = {row["settings"]["name"]: row for row in read_json(file)["rows"]} if file.exists() else {}
    done: list[dict[str, Any]] = []
    for row in rows:
        value = row.fingerprint()
        kept = known.get(row.name)
        if kept is None or kept.get("fingerprint") != value:
            kept = {"settings": row.settings(), "fingerprint": value, **_measured(row, device)}
        done.append(kept)
        write_json(file, {"title": title, "command": f"nsdr experiment {path}", "rows": done}, indent=1)
    table = file.with_suffix(".md")
    table.write_text(markdown_table(title, f"nsdr experiment {path}", done))
    return table


def _measured(row: ExperimentRow, device: str) -> dict[str, Any]:
    if row.evaluation is None:
        return {"table": _published(row.published)}
    start = time.time()
    report = (
        _baseline(row.evaluation, row.baseline)
        if row.baseline
        else run_evaluation(replace(row.evaluation, device=device))
    )
    return {
        "table": {kind: report[kind] for kind in QUESTION_TYPES},
        "failed_questions": report["errors"],
        "seconds": round(time.time() - start),
        "date": time.strftime("%Y-%m-%d"),
        "version": nsdr.__version__,
        "revision": code_revision(),
        "machine": f"{os.cpu_count()} cores, {platform.machine()}, Python {sys.version.split()[0]}",
    }


def _baseline(config: EvaluationConfig, baseline: str) -> dict[str, Any]:
    scenes = [s for s in read_questions(config.questions) if s.scene_index not in set(config.exclude)]
    accuracy = q_type_baselines(scenes)[baseline]
    report: dict[str, Any] = {"errors": 0}
    for kind in QUESTION_TYPES:
        n = _count(scenes, kind)
        if kind == "descriptive":
            report[kind] = {"accuracy": accuracy.get(kind), "n": n}
        else:
            option, question = accuracy.get(kind, (None, None))
            report[kind] = {"per_option": option, "per_question": question, "n_questions": n}
    return report


def _count(scenes: Sequence[SceneQuestions], kind: str) -> int:
    return sum(q.type == kind for s in scenes for q in s.questions)


def _published(numbers: Sequence[float]) -> dict[str, Any]:
    descriptive, *others = (n / 100 for n in numbers)
    table: dict[str, Any] = {"descriptive": {"accuracy": descriptive}}
    for k, kind in enumerate(QUESTION_TYPES[1:]):
        table[kind] = {"per_option": others[2 * k], "per_question": others[2 * k + 1]}
    return table


def markdown_table(title: str, command: str, rows: Sequence[Mapping[str, Any]]) -> str:
    """The paper's table: accuracy in %, per option / per question for multiple choice, with what it was measured by."""
    lines = [f"# {title}", "", "| | descriptive | explanatory | predictive | counterfactual |", "|---|---|---|---|---|"]
    for row in rows:
        table = row["table"]
        cells = [_percent(table["descriptive"]["accuracy"])]
        for kind in QUESTION_TYPES[1:]:
            option, question = table[kind]["per_option"], table[kind]["per_question"]
            cells.append("-" if option is None else f"{_percent(option)} / {_percent(question)}")
        lines.append(f"| {row['settings']['name']} | {' | '.join(cells)} |")
    counts: set[str] = set()
    runs: set[str] = set()
    for row in rows:
        if "seconds" in row:
            table = row["table"]
            numbers = [table["descriptive"]["n"], *(table[k]["n_questions"] for k in QUESTION_TYPES[1:])]
            counts.add(", ".join(str(n) for n in numbers))
            runs.add(f"{row['date']}, version {row['version']}, revision {row['revision']}, {row['machine']}")
    total = sum(row.get("seconds", 0) for row in rows)
    lines += ["", f"Per option / per question. Questions by type: {'; '.join(sorted(counts))}. Made by `{command}`"]
    lines += [f"in {total} s ({'; '.join(sorted(runs))})."]
    return "\n".join(lines) + "\n"


def _percent(value: float | None) -> str:
    return "-" if value is None else f"{100 * value:.1f}"
