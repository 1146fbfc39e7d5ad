"""The page of data-set facts, released beside generated."""

import re
from pathlib import Path

import pytest

from benchmarks.dataset_facts import facts_page
from nsdr import DataError
from nsdr.clevrer.files.annotations import read_truth_file
from nsdr.clevrer.files.questions import read_questions
from nsdr.generate.dataset import DatasetConfig, generate_dataset
from nsdr.generate.statistics import RELEASED_QUESTIONS, TITLES, released_statistics


def test_the_page_of_facts_has_released_and_generated_numbers_side_by_side(tmp_path) -> None:
    config = DatasetConfig(
        str(tmp_path / "set"), 2, renderer="none", masks=False, splits={"train": 0.5, "test": 0.5}, workers=1
    )
    page = facts_page(generate_dataset(config))
    assert (
        """dataset --videos 2 --seed 0 --first_scene 0 --splits '{"train": 0.5, "test": 0.5}' --renderer none""" in page
    )
    assert "--masks false --render.width 480 --render.height 320`" in page
    number = {
        name: len([q for s in read_questions(p) for q in s.questions])
        for name, p in (
            ("train", tmp_path / "set" / "questions" / "train.json"),
            ("test", tmp_path / "set" / "truth" / "questions_test.json"),
        )
    }
    assert f"| train | 0-9999 | 10,000 | 1 | 152,572 | {number['train']} |" in page
    assert f"| test | 15000-19999 | 5,000 | 1 | not counted | {number['test']} |" in page
    assert f"| all | | 20,000 | 2 | 305,280 (paper) | {number['train'] + number['test']} |" in page
    truths = [read_truth_file(p) for p in sorted((tmp_path / "set" / "truth").rglob("truth_*.json"))]
    cubes, objects = (
        sum(o["shape"] == "cube" or wanted == "all" for t in truths for o in t["objects"]) for wanted in ("cube", "all")
    )
    assert re.search(rf"\| cube \| \d\d,\d\d\d \| 30\.5 \| {cubes} \| {100 * cubes / objects:.1f} \|", page)
    with pytest.raises(DataError, match=r"manifest\.json: no such file"):
        facts_page(tmp_path)
    (tmp_path / "set" / "questions" / "train.json").unlink()
    (tmp_path / "set" / "truth" / "questions_test.json").unlink()
    with pytest.raises(DataError, match="has no questions or no truth; expected a data set of `nsdr generate dataset`"):
        facts_page(tmp_path / "set")


def test_the_docs_have_the_released_numbers_of_the_code(tmp_path) -> None:
    page = (Path(__file__).parent.parent / "docs" / "dataset.md").read_text()
    for key, number in RELEASED_QUESTIONS["questions by kind"].items():
        assert f"| {key} | {number:,} |" in page
    for name, shares in released_statistics().items():
        table = page.split(f"### {TITLES[name].capitalize()}\n")[1].split("\n### ")[0]
        rows = [line.strip("| ").split(" | ") for line in table.splitlines() if re.match(r"\| \w", line)]
        found = {row[0].split("-")[0]: float(row[2]) for row in rows}
        assert {key: found[key] for key in shares} == pytest.approx(
            {k: 100 * v for k, v in shares.items()}, abs=0.06
        ), name
