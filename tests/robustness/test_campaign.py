"""A sample of the campaign in every test run; `make robustness` runs all of it."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from nsdr.io.limits import Limits
from tests.robustness.answers import answer_controls
from tests.robustness.campaign import run_case
from tests.robustness.case import Case
from tests.robustness.cases import all_cases, sample_cases
from tests.robustness.data_sets import data_set_controls
from tests.robustness.documents import control_cases
from tests.robustness.good import write_good
from tests.robustness.layouts import layout_controls
from tests.robustness.library import library_controls
from tests.robustness.worker import Worker

SAMPLE, SEED = 160, 16
CONTROLS = [*control_cases(), *answer_controls(), *data_set_controls(), *layout_controls(), *library_controls()]
DOCS = Path(__file__).resolve().parents[2] / "docs" / "robustness.md"


@pytest.fixture(scope="module")
def worker() -> Iterator[Worker]:
    worker = Worker()
    yield worker
    worker.close()


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("good")
    write_good(folder)
    return folder


@pytest.mark.parametrize("case", sample_cases(SAMPLE, SEED), ids=lambda case: case.id)
def test_bad_input_is_one_line_that_names_it(case: Case, worker: Worker, good: Path, tmp_path: Path) -> None:
    result, wrong = run_case(case, worker, tmp_path / "case", good)
    assert not wrong, f"nsdr {' '.join(case.argv)}\n{wrong}\n{result}"


@pytest.mark.parametrize("case", CONTROLS, ids=lambda case: case.name)
def test_the_good_inputs_are_accepted(case: Case, worker: Worker, good: Path, tmp_path: Path) -> None:
    result, _ = run_case(case, worker, tmp_path / "case", good)
    assert result.status == 0, result


def test_every_rule_is_in_the_sample() -> None:
    cases = all_cases()
    assert len(cases) >= 600
    assert {c.rule for c in sample_cases(SAMPLE, SEED)} == {c.rule for c in cases}
    assert len(sample_cases(SAMPLE, SEED)) == SAMPLE


def test_the_documented_limits_are_those_of_the_code() -> None:
    rows = [line.split("|") for line in DOCS.read_text().splitlines() if line.startswith("| `")]
    documented = {row[1].strip().strip("`"): int(row[2].strip().replace(",", "")) for row in rows}
    assert documented == vars(Limits())
