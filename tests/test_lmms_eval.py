"""The task pack for lmms-eval: its functions, without the package."""

import importlib.util
import re
import shutil
from pathlib import Path
from types import ModuleType

import pytest
from msgspec.structs import replace

from nsdr import DataError, read_world
from nsdr.clevrer import read_answers, read_questions
from nsdr.clevrer.example import QUESTIONS, VIDEO
from nsdr.clevrer.files.questions import Question, SceneQuestions, write_questions
from nsdr.evaluation.responses import score_responses
from nsdr.generate.export import ExportConfig, export_dataset
from nsdr.io.files import write_json
from nsdr.io.worlds import stored_world

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
def utils() -> ModuleType:
    return _load()


@pytest.fixture
def exported(tmp_path: Path) -> Path:
    """The rows of the example."""
    write_questions(
        tmp_path / "data/questions/train.json", [replace(s, scene_index=2) for s in read_questions(QUESTIONS)]
    )
    video = tmp_path / "data/videos/train/video_00000-01000/video_00002.mp4"
    video.parent.mkdir(parents=True)
    shutil.copyfile(VIDEO, video)
    export_dataset(ExportConfig(str(tmp_path / "data"), str(tmp_path / "rows"), "lmms_eval"))
    return tmp_path / "rows" / "train.jsonl"


def test_functions_of_the_task_exist(utils: ModuleType) -> None:
    named = set(re.findall(r"!function utils\.(\w+)", (PACK / "clevrer.yaml").read_text()))
    assert {"DATA_FILES", "process_docs", "process_results"} < named
    assert all(hasattr(utils, name) for name in named)


def test_answers_are_read_in_the_words_of_their_world(utils: ModuleType, tmp_path: Path) -> None:
    blocks = read_world("blocks")
    data, rows = tmp_path / "data", tmp_path / "rows"
    question = Question(0, "What shape is the pink object?", "descriptive", "query_shape", None, "brick")
    manifest = {
        "splits": {"train": [0, 1], "validation": [10000, 10000], "test": [15000, 15000]},
        "kinds": ["questions"],
    }
    write_json(data / "manifest.json", {**manifest, "n_frames": 100, **stored_world(blocks)})
    write_questions(data / "questions/train.json", [SceneQuestions(0, "video_00000.mp4", (question,))])
    video = data / "videos/train/video_00000-01000/video_00000.mp4"
    video.parent.mkdir(parents=True)
    shutil.copyfile(VIDEO, video)
    export_dataset(ExportConfig(str(data), str(rows), "lmms_eval"))
    (doc,) = utils.rows(str(rows / "train.jsonl"))
    right, wrong = (utils.process_results(doc, [text])["descriptive"]["right"] for text in ("A brick.", "A ball."))
    assert (right, wrong) == (1, 0)
    (rows / "world.json").unlink()
    with pytest.raises(DataError, match="brick</answer> is no answer in the world clevrer; of rows of another"):
        utils.rows(str(rows / "train.jsonl"))


def test_the_task_gives_the_numbers_of_nsdr_score(
    utils: ModuleType, exported: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("NSDR_PREDICTIONS", str(tmp_path / "p.jsonl"))
    docs = utils.rows(str(exported))
    (shown,) = utils.doc_to_visual(docs[0])
    assert Path(shown).read_bytes() == VIDEO.read_bytes()
    assert "Answer with" in utils.doc_to_text(docs[0])
    responses = [utils.doc_to_target(doc) if i % 3 else "A" for i, doc in enumerate(docs)]
    items: dict[str, list[dict[str, object]]] = {}
    for doc, response in zip(docs, responses, strict=True):
        for metric, item in utils.process_results(doc, [response]).items():
            items.setdefault(metric, []).append(item)
    aggregations = dict(METRICS.findall((PACK / "clevrer.yaml").read_text()))
    assert items.keys() <= aggregations.keys()
    found = {metric: getattr(utils, aggregations[metric])(values) for metric, values in items.items()}

    report = score_responses(read_questions(tmp_path / "data/questions/train.json"), read_answers(tmp_path / "p.jsonl"))
    assert found.pop("unread") == len(report.responses["unread"]) > 0
    assert found.pop("descriptive") == report["descriptive"]["accuracy"]
    for metric, value in found.items():
        kind, _, unit = metric.partition("_")
        assert value == report[kind][unit], metric


def test_missing_videos_and_variables_are_named(
    utils: ModuleType, exported: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(DataError, match="NSDR_ROWS is not set"):
        utils.process_docs(None)
    (shown,) = {doc["video"] for doc in utils.rows(str(exported))}
    Path(shown).unlink()
    monkeypatch.setenv("NSDR_ROWS", str(exported))  # read when the task is run
    with pytest.raises(DataError, match=r"train.jsonl, line 1: .*video_00002.mp4 is missing"):
        utils.process_docs(None)
    with pytest.raises(DataError, match="expected a row of `nsdr export --format lmms_eval`"):
        utils.rows(str(PACK / "rows.jsonl"))
