"""The task pack for lmms-eval: its functions, without the package."""

import importlib.util
import re
from pathlib import Path
from types import ModuleType

import pytest

from nsdr import DataError
from nsdr.clevrer import read_answers, read_questions
from nsdr.clevrer.example import QUESTIONS, VIDEO
from nsdr.evaluation.responses import score_responses

PACK = Path(__file__).parents[1] / "integrations" / "lmms_eval"
METRICS = re.compile(r"metric: (\w+), aggregation: !function utils\.(\w+)")


def _load() -> ModuleType:
    spec = importlib.util.spec_from_file_location("clevrer_task", PACK / "utils.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def utils(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.setenv("NSDR_QUESTIONS", str(QUESTIONS))
    return _load()


def test_functions_of_the_task_exist(utils: ModuleType) -> None:
    named = set(re.findall(r"!function utils\.(\w+)", (PACK / "clevrer.yaml").read_text()))
    assert {"DATA_FILES", "process_docs", "process_results"} < named
    assert all(hasattr(utils, name) for name in named)


def test_the_task_gives_the_numbers_of_nsdr_score(
    utils: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("NSDR_PREDICTIONS", str(tmp_path / "p.jsonl"))
    docs = utils.rows(str(QUESTIONS), str(VIDEO.parent))
    assert utils.doc_to_visual(docs[0]) == [str(VIDEO.resolve())]
    assert "Answer with" in utils.doc_to_text(docs[0])
    responses = [utils.doc_to_target(doc) if i % 3 else "A" for i, doc in enumerate(docs)]
    items: dict[str, list[dict[str, object]]] = {}
    for doc, response in zip(docs, responses, strict=True):
        for metric, item in utils.process_results(doc, [response]).items():
            items.setdefault(metric, []).append(item)
    aggregations = dict(METRICS.findall((PACK / "clevrer.yaml").read_text()))
    assert items.keys() <= aggregations.keys()
    found = {metric: getattr(utils, aggregations[metric])(values) for metric, values in items.items()}

    report = score_responses(read_questions(QUESTIONS), read_answers(tmp_path / "p.jsonl"))
    assert found.pop("unread") == len(report.responses["unread"]) > 0
    assert found.pop("descriptive") == report["descriptive"]["accuracy"]
    for metric, value in found.items():
        kind, _, unit = metric.partition("_")
        assert value == report[kind][unit], metric


def test_missing_videos_and_variables_are_named(
    utils: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(DataError, match=r"has no video_500002.mp4, which .*questions_500002.json asks about"):
        utils.rows(str(QUESTIONS), str(tmp_path))
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        (tmp_path / name / VIDEO.name).write_bytes(b"of another data set")
    with pytest.raises(DataError, match=r"a/video_500002\.mp4 and .*b/video_500002\.mp4 have one name"):
        utils.rows(str(QUESTIONS), str(tmp_path))
    monkeypatch.delenv("NSDR_QUESTIONS")
    loaded = _load()  # lmms-eval imports all task packs of a folder, whichever is run
    with pytest.raises(DataError, match="NSDR_QUESTIONS is not set"):
        loaded.process_docs(None)
