"""The page of facts about the data set, released beside generated."""

import re
from pathlib import Path

import pytest

from nsdr.generate.statistics import RELEASED_QUESTIONS, TITLES, released_statistics


def test_the_docs_have_the_released_numbers_of_the_code() -> None:
    page = (Path(__file__).parent.parent / "docs" / "dataset.md").read_text()
    for key, number in RELEASED_QUESTIONS["questions by kind"].items():
        assert f"| {key} | {number:,} |" in page
    released = released_statistics()
    for name in ("objects", "collisions"):
        shares = released[name]
        table = page.split(f"### {TITLES[name].capitalize()}\n")[1].split("\n### ")[0]
        rows = [line.strip("| ").split(" | ") for line in table.splitlines() if re.match(r"\| \w", line)]
        found = {row[0].split("-")[0]: float(row[2]) for row in rows}
        assert {key: found[key] for key in shares} == pytest.approx(
            {k: 100 * v for k, v in shares.items()}, abs=0.06
        ), name
