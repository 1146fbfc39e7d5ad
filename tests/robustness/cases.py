"""All cases of the campaign, and a sample of them for every test run."""

import random
from collections.abc import Iterator

from tests.robustness.agents import agent_cases
from tests.robustness.answers import answer_file_cases
from tests.robustness.archives import archive_cases
from tests.robustness.case import Case
from tests.robustness.checkpoints import checkpoint_cases
from tests.robustness.configurations import configuration_cases
from tests.robustness.data_sets import data_set_cases
from tests.robustness.documents import document_cases
from tests.robustness.files import file_cases
from tests.robustness.layouts import layout_cases
from tests.robustness.library import library_cases
from tests.robustness.machines import machine_cases
from tests.robustness.options import option_cases
from tests.robustness.texts import text_cases
from tests.robustness.videos import hostile_video_cases


def all_cases() -> list[Case]:
    """Every case; names are unique."""
    cases = list(_cases())
    assert len({case.id for case in cases}) == len(cases), "two cases have one name"
    return cases


def _cases() -> Iterator[Case]:
    yield from document_cases()
    yield from file_cases()
    yield from archive_cases()
    yield from option_cases()
    yield from configuration_cases()
    yield from text_cases()
    yield from checkpoint_cases()
    yield from answer_file_cases()
    yield from library_cases()
    yield from data_set_cases()
    yield from layout_cases()
    yield from agent_cases()
    yield from hostile_video_cases()
    yield from machine_cases()


def sample_cases(count: int, seed: int) -> list[Case]:
    """At least one case of each rule, and others up to `count`, drawn by a seed."""
    rng, cases = random.Random(seed), all_cases()
    rng.shuffle(cases)
    first = {case.rule: case for case in reversed(cases)}
    rest = [case for case in cases if first[case.rule] is not case]
    return [*first.values(), *rest[: max(count - len(first), 0)]]
