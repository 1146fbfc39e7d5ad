"""Whatever a file holds, a reader returns what it promises or raises `DataError` that names the file."""

import copy
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings, strategies as st

from nsdr import Scene, load
from nsdr.clevrer.answers.answer_files import read_submission
from nsdr.clevrer.dataset import read_manifest
from nsdr.clevrer.files.annotations import read_annotation, read_truth, read_truth_file
from nsdr.clevrer.files.compact_proposals import read_compact_proposals
from nsdr.clevrer.files.predictions import read_predictions, scene_from_predictions
from nsdr.clevrer.files.proposals import read_ground_truth, read_proposals
from nsdr.clevrer.files.questions import read_questions
from nsdr.clevrer.files.scenes import scene_from_annotation, scene_from_ground_truth, scene_from_truth
from nsdr.errors import DataError
from nsdr.io.reading import read_json, read_npz, read_yaml
from tests.robustness.archives import archive_cases
from tests.robustness.case import Case, Change, text_writer
from tests.robustness.documents import OF_ONE_QUESTION, document_cases, document_writer
from tests.robustness.good import DOCUMENTS


def _blocks(path: Path) -> None:
    for block in read_truth(path).values():
        scene_from_ground_truth(block, block["n_frames"])


READERS: dict[str, Callable[[Path], object]] = {
    "questions": read_questions,
    "annotations": lambda path: scene_from_annotation(read_annotation(path)),
    "truth": lambda path: scene_from_truth(read_truth_file(path)),
    "ground truth": lambda path: scene_from_ground_truth(*read_ground_truth(path)),
    "blocks": _blocks,
    "proposals": read_proposals,
    "predictions": lambda path: scene_from_predictions(read_predictions(path)),
    "scenes": lambda path: load(path, Scene),
    "manifest": read_manifest,
    "submission": read_submission,
    "compact": lambda path: list(read_compact_proposals(path)),
}
OTHERS: dict[str, Callable[[Path], object]] = {
    "x.json": read_json,
    "x.npz": read_npz,
    "x.yaml": read_yaml,
}
FILES = {DOCUMENTS[kind][0] if kind in DOCUMENTS else "proposals.npz": read for kind, read in READERS.items()}
QUICK = settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=5,
)


def _needs_more(case: Case) -> bool:
    """Whether a case needs another file, or more memory than there is."""
    return case.rule == "compact, file" or case.name.endswith("header of 10^11 numbers")


OF_SCORING = ("submission, contradiction: no scene", "submission, contradiction: no question")
FOUND_LATER = (*OF_ONE_QUESTION, "other scene", "no question of the file")
"""Changes that a reader accepts, and that are found where the document is used."""
BAD = [
    case
    for case in (*document_cases(), *archive_cases())
    if case.rule.partition(",")[0] in READERS
    and case.name not in FOUND_LATER
    and case.id not in OF_SCORING
    and not _needs_more(case)
]


@pytest.mark.parametrize("rule", dict.fromkeys(case.rule for case in BAD))
def test_bad_documents_are_refused_by_file_and_place(rule: str, tmp_path: Path) -> None:
    """The campaign's cases, without the commands."""
    (tmp_path / "release").mkdir()
    wrong = {}
    for case in (case for case in BAD if case.rule == rule):
        case.write(tmp_path, tmp_path)
        said = _refusal(READERS[rule.partition(",")[0]], tmp_path / case.named)
        if not (case.named in said and case.place in said):
            wrong[case.id] = said
    assert not wrong


def _refusal(read: Callable[[Path], object], path: Path) -> str:
    try:
        read(path)
    except DataError as e:
        return str(e)
    return "accepted"


def _replace_one(data: st.DataObject, document: Any) -> None:
    """Replace or remove one value, at a place that is drawn level by level."""
    while True:
        keys = list(document) if isinstance(document, dict) else list(range(len(document)))
        key = data.draw(st.sampled_from(keys))
        inner = document[key]
        if isinstance(inner, dict | list) and inner and data.draw(st.integers(0, 4)):
            document = inner
        elif data.draw(st.booleans()):
            document[key] = data.draw(VALUES)
            return
        else:
            del document[key]
            return


def _read(reader: Callable[[Path], object], path: Path) -> None:
    message = path.name
    try:
        reader(path)
    except DataError as e:
        message = str(e)
    assert path.name in message
    assert len(message) < 2000


@pytest.mark.parametrize("kind", [kind for kind in READERS if kind in DOCUMENTS])
@QUICK
@given(data=st.data())
def test_a_changed_document_is_read_or_refused(kind: str, data: st.DataObject, tmp_path: Path) -> None:
    change: Change = lambda document: _replace_one(data, document)  # noqa: E731
    document_writer(kind)(change)(tmp_path, tmp_path) if kind != "manifest" else _manifest(change, tmp_path)
    _read(READERS[kind], tmp_path / DOCUMENTS[kind][0])


def _manifest(change: Change, folder: Path) -> None:
    document = copy.deepcopy(DOCUMENTS["manifest"][1]())
    change(document)
    text_writer("manifest.json", json.dumps(document))(folder, folder)


@pytest.mark.parametrize("name", [*FILES, *OTHERS])
@QUICK
@given(content=st.binary(max_size=200) | VALUES.map(lambda value: json.dumps(value).encode()))
def test_any_content_is_read_or_refused(name: str, content: bytes, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(content)
    _read({**FILES, **OTHERS}[name], tmp_path / name)
