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
from nsdr.clevrer.files.annotations import read_annotation, read_truth
from nsdr.clevrer.files.compact_proposals import read_compact_proposals
from nsdr.clevrer.files.predictions import read_predictions, scene_from_predictions
from nsdr.clevrer.files.proposals import read_ground_truth, read_proposals
from nsdr.clevrer.files.questions import read_questions
from nsdr.clevrer.files.scenes import scene_from_annotation, scene_from_ground_truth
from nsdr.errors import DataError
from nsdr.io.reading import read_json, read_npz, read_yaml
from tests.robustness.case import Change, text_writer
from tests.robustness.documents import document_writer
from tests.robustness.good import DOCUMENTS


def _blocks(path: Path) -> None:
    for block in read_truth(path).values():
        scene_from_ground_truth(block, block["n_frames"])


READERS: dict[str, Callable[[Path], object]] = {
    "questions": read_questions,
    "annotations": lambda path: scene_from_annotation(read_annotation(path)),
    "ground truth": lambda path: scene_from_ground_truth(*read_ground_truth(path)),
    "blocks": _blocks,
    "proposals": read_proposals,
    "predictions": lambda path: scene_from_predictions(read_predictions(path)),
    "scenes": lambda path: load(Scene, path),
    "manifest": read_manifest,
}
OTHERS: dict[str, Callable[[Path], object]] = {
    "x.json": read_json,
    "x.npz": read_npz,
    "x.yaml": read_yaml,
    "submission.json": read_submission,
    "proposals.npz": lambda path: list(read_compact_proposals(path)),
}
QUICK = settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=5,
)


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


@pytest.mark.parametrize("kind", READERS)
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


@pytest.mark.parametrize("name", [*(DOCUMENTS[kind][0] for kind in READERS), *OTHERS])
@QUICK
@given(content=st.binary(max_size=200) | VALUES.map(lambda value: json.dumps(value).encode()))
def test_any_content_is_read_or_refused(name: str, content: bytes, tmp_path: Path) -> None:
    readers = {DOCUMENTS[kind][0]: reader for kind, reader in READERS.items()} | OTHERS
    (tmp_path / name).write_bytes(content)
    _read(readers[name], tmp_path / name)
