"""Tables from experiment files."""

import json
import re
import shutil
from pathlib import Path

import pytest
from msgspec.structs import replace

from nsdr import DataError
from nsdr.clevrer.example import QUESTIONS, TRUTH
from nsdr.clevrer.files.questions import read_questions, write_questions
from nsdr.evaluation.experiments import read_experiment, run_experiment

TEXT = """
title: Example
common: {questions: QUESTIONS, data: FOLDER, source: scenes}
rows:
  - {name: truth}
  - {name: guess, baseline: random}
  - {name: elsewhere, published: [88.1, 87.6, 79.6, 82.9, 68.7, 74.1, 42.2]}
"""


@pytest.fixture
def experiment(tmp_path):
    path = tmp_path / "example.yaml"
    (tmp_path / "data").mkdir()
    shutil.copy(TRUTH, tmp_path / "data" / "scene_500002.json")
    path.write_text(TEXT.replace("QUESTIONS", str(QUESTIONS)).replace("FOLDER", str(tmp_path / "data")))
    return path


def test_rows_are_measured_once_and_again_when_they_change(experiment, tmp_path, monkeypatch) -> None:
    table = run_experiment(experiment, tmp_path / "results").read_text()
    assert re.search(r"\| truth \| 100\.0 \(\d\d\.\d-100\.0\) \| 100\.0 \([^)]*\) / 100\.0 \([^)]*\) \|", table)
    assert re.search(r"\| guess \| \d+\.\d \(\d+\.\d-\d+\.\d\) \|", table)
    assert "| elsewhere | 88.1 | 87.6 / 79.6 | 82.9 / 68.7 | 74.1 / 42.2 | - | - |" in table
    assert f"nsdr experiment {experiment}" in table
    file = tmp_path / "results" / "example.json"
    document = json.loads(file.read_text())
    first = document["rows"][0]
    assert {"seconds", "date", "version", "revision", "machine"} <= set(first)
    document["rows"][0]["seconds"] = 12345  # only a kept row still has it
    document["rows"] = document["rows"][:1]  # killed after the first row
    file.write_text(json.dumps(document))
    run_experiment(experiment, tmp_path / "results")
    rows = json.loads(file.read_text())["rows"]
    assert [r["settings"]["name"] for r in rows] == ["truth", "guess", "elsewhere"]
    assert rows[0]["seconds"] == 12345
    experiment.write_text(experiment.read_text().replace("{name: truth}", "{name: truth, types: [descriptive]}"))
    run_experiment(experiment, tmp_path / "results")
    assert json.loads(file.read_text())["rows"][0]["seconds"] != 12345


def test_rows_name_the_papers_system() -> None:
    _, rows = read_experiment(Path(__file__).parents[1] / "configs" / "experiments" / "table2.yaml")
    (row,) = (row for row in rows if row.name == "NS-DR, the paper's PropNet on patches")
    assert row.evaluation is not None
    settings = row.evaluation.pipeline()
    assert (settings.dynamics.backend, settings.question_parser, settings.extensions) == (
        "propnet_patches",
        "network",
        False,
    )


def test_broken_experiments_are_named(experiment, tmp_path) -> None:
    experiment.write_text(experiment.read_text().replace("baseline: random", "base: random"))
    with pytest.raises(DataError, match=r"example\.yaml: not an experiment file .*base"):
        run_experiment(experiment, tmp_path)
    experiment.write_text(TEXT.replace("random", "clever"))
    with pytest.raises(DataError):
        run_experiment(experiment, tmp_path)
    experiment.write_text(TEXT.replace("baseline: random", "baseline: random, training: train.json"))
    with pytest.raises(
        DataError, match=r"training is 'train\.json'; expected a question file, beside `baseline: frequent`"
    ):
        run_experiment(experiment, tmp_path)


def test_the_most_frequent_answers_are_those_of_the_training_questions(experiment, tmp_path) -> None:
    experiment.write_text(experiment.read_text().replace("baseline: random", "baseline: frequent"))
    table = run_experiment(experiment, tmp_path / "results").read_text()
    assert "guess: the most frequent answers were counted on the questions themselves, not on a training set." in table
    before = json.loads((tmp_path / "results" / "example.json").read_text())["rows"][1]["table"]
    training = read_questions(QUESTIONS)
    flipped = {"yes": "no", "no": "yes"}
    exist = [q for s in training for q in s.questions if q.subtype == "exist"]
    more = [replace(q, id=1000 + i, answer=flipped[q.answer]) for i, q in enumerate(exist * 2)]
    path = tmp_path / "train.json"
    write_questions(path, [replace(training[0], questions=(*training[0].questions, *more)), *training[1:]])
    experiment.write_text(experiment.read_text().replace("frequent}", f"frequent, training: {path}}}"))
    table = run_experiment(experiment, tmp_path / "results").read_text()
    assert f"guess: the most frequent answers were counted on {path}." in table
    after = json.loads((tmp_path / "results" / "example.json").read_text())["rows"][1]["table"]
    assert after["descriptive"]["accuracy"] < before["descriptive"]["accuracy"]


def test_a_question_type_baseline_answers_the_questions_of_its_neighbours(experiment, tmp_path) -> None:
    text = experiment.read_text()
    experiment.write_text(text.replace("source: scenes}", "source: scenes, types: [descriptive]}"))
    run_experiment(experiment, tmp_path / "results")
    truth, guess, _ = json.loads((tmp_path / "results" / "example.json").read_text())["rows"]
    assert guess["table"]["descriptive"]["n"] == truth["table"]["descriptive"]["n"]
    assert guess["table"]["counterfactual"]["n_questions"] == truth["table"]["counterfactual"]["n_questions"] == 0
    experiment.write_text(text.replace(f"questions: {QUESTIONS}, data: {tmp_path}/data", "root: CLEVRER"))
    with pytest.raises(DataError, match="row 'guess': root: a Q-type row reads a question file; give questions"):
        read_experiment(experiment)


def test_the_docs_show_the_tables_as_they_were_measured() -> None:
    """Whole tables are marked `<!-- results/X.md -->`, tables with some of the rows `<!-- rows of results/X.md -->`."""
    root = Path(__file__).parent.parent
    pages = "".join(page.read_text() for page in sorted((root / "docs").glob("*.md")))
    included = re.findall(r"<!-- (rows of )?(results/\w+\.md) -->\n(.*?)<!-- end -->", pages, re.DOTALL)
    assert len(included) == 15
    for some, name, text in included:
        measured = [line for line in (root / name).read_text().splitlines() if line.startswith("|")]
        shown = [line for line in text.splitlines() if line.startswith("|")]
        assert shown == ([row for row in measured if row in shown] if some else measured), name


@pytest.mark.parametrize("path", sorted((Path(__file__).parent.parent / "configs" / "experiments").glob("*.yaml")))
def test_the_shipped_experiments_are_readable(path: Path) -> None:
    _, rows = read_experiment(path)
    assert len({row.name for row in rows}) == len(rows)
    for row in rows:
        if row.evaluation is not None:
            row.evaluation.pipeline()  # raises an error if a row names no backend
