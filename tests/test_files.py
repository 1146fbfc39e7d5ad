"""The official files: layout, download, large lists, questions, annotations, submissions."""

import http.server
import io
import json
import shutil
import threading
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from nsdr import DataError
from nsdr.clevrer.answers.answer_files import read_submission, submission_document, write_submission
from nsdr.clevrer.dataset import CLEVRER
from nsdr.clevrer.download import download
from nsdr.clevrer.example import QUESTIONS, VIDEO
from nsdr.clevrer.files.annotations import read_annotation, write_annotation
from nsdr.clevrer.files.proposals import read_ground_truth
from nsdr.clevrer.files.questions import Choice, read_questions, without_answers, write_questions
from nsdr.cli.main import main
from nsdr.evaluation import EvaluationConfig, run_evaluation
from nsdr.evaluation.score import score_scenes
from nsdr.symbolic import Executor
from tests.robustness import good


def question_file(path: Path, video: int = 3) -> None:
    """How many collisions happen in the scene of `good`."""
    path.parent.mkdir(parents=True, exist_ok=True)
    (scene,) = good.questions(video)
    path.write_text(json.dumps([{**scene, "questions": scene["questions"][:1]}]))


@pytest.fixture
def root(tmp_path):
    """A small data set: videos 3 and 4 with their annotations, in the official folders and beside them."""
    folder = tmp_path / "clevrer"
    videos = folder / "videos" / "train" / "video_00000-01000"
    videos.mkdir(parents=True)
    (videos / "video_00003.mp4").write_bytes(VIDEO.read_bytes())
    (videos.parent / "video_00004.mp4").write_bytes(VIDEO.read_bytes())
    annotations = folder / "annotations" / "train"
    annotations.mkdir(parents=True)
    (annotations / "annotation_00003.json").write_text(json.dumps(good.annotation(3)))
    (annotations / "annotation_00000-01000").mkdir()
    (annotations / "annotation_00000-01000" / "annotation_00004.json").write_text(json.dumps(good.annotation(4)))
    (folder / "processed_proposals").mkdir()
    (folder / "processed_proposals" / "sim_00003.json").write_text(json.dumps(good.proposals(3)))
    question_file(folder / "questions" / "train.json")
    return folder


def test_files_are_found_in_folders(root) -> None:
    train = CLEVRER(root).split("train")
    assert train.video(3).name == "video_00003.mp4"
    assert train.video(4).read_bytes() == VIDEO.read_bytes()
    assert train.annotation(3)["scene_index"] == 3
    assert train.annotation(4)["scene_index"] == 4
    assert train.proposals(3).n_frames == 128
    assert [s.scene_index for s in train.questions()] == [3]
    with pytest.raises(DataError, match=r"has no video_00005\.mp4 \(videos of train\)"):
        train.video(5)
    with pytest.raises(DataError, match=r"has no questions/test\.json"):
        CLEVRER(root).split("test").questions()
    with pytest.raises(DataError, match="split is 'dev'"):
        CLEVRER(root).split("dev")
    with pytest.raises(DataError, match="no such folder"):
        CLEVRER(root / "nowhere")


def test_inventory_and_verify(root, capsys) -> None:
    rows = {(r.split, r.kind): r for r in CLEVRER(root).inventory()}
    assert rows["train", "videos"].found == 2
    assert rows["train", "videos"].missing[:4] == (0, 1, 2, 5)
    assert rows["train", "questions"].found == 1
    assert ("test", "annotations") not in rows
    assert main(["data", "verify", str(root)]) == 1
    out = capsys.readouterr().out
    assert "train       videos              2     10000  0, 1, 2, 5, 6, ..." in out
    assert "incomplete" in out


class _Server(http.server.BaseHTTPRequestHandler):
    """Serves `files`; the first `cuts` answers end after `cut` bytes."""

    files: dict[str, bytes] = {}  # noqa: RUF012
    cut = 1000
    cuts = 0
    ranges: list[str | None] = []  # noqa: RUF012

    def do_GET(self) -> None:
        data = self.files.get(self.path)
        if data is None:
            self.send_error(404)
            return
        wanted = self.headers.get("Range")
        type(self).ranges.append(wanted)
        start = int(wanted.removeprefix("bytes=").rstrip("-")) if wanted else 0
        if start >= len(data):
            self.send_error(416)
            return
        self.send_response(206 if wanted else 200)
        self.send_header("Content-Length", str(len(data) - start))
        if wanted:
            self.send_header("Content-Range", f"bytes {start}-{len(data) - 1}/{len(data)}")
        self.end_headers()
        if type(self).cuts > 0:
            type(self).cuts -= 1
            self.wfile.write(data[start : start + self.cut])
            self.close_connection = True
            return
        self.wfile.write(data[start:])

    def log_message(self, *_) -> None:
        pass


@pytest.fixture
def server() -> Iterator[str]:
    _Server.files = {"/questions/train.json": bytes(range(256)) * 40}
    _Server.cuts, _Server.ranges = 0, []
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), _Server) as running:
        thread = threading.Thread(target=running.serve_forever)
        thread.start()
        yield f"http://127.0.0.1:{running.server_port}"
        running.shutdown()
        thread.join()


def fetch(server: str, folder: Path) -> Path:
    """The training questions from the server."""
    (path,) = download(folder, "train", ["questions"], base_url=server)
    return path


@pytest.fixture
def impatient(monkeypatch) -> None:
    """Connections that broke are tried again at once, and small files come in pieces, too."""
    monkeypatch.setattr("huggingface_hub.constants.DOWNLOAD_CHUNK_SIZE", 500)
    monkeypatch.setattr("huggingface_hub.file_download.time.sleep", lambda _: None)


def test_download_resumes_after_broken_connections(server, tmp_path, impatient) -> None:
    _Server.cuts = 3
    path = fetch(server, tmp_path)
    assert path.read_bytes() == _Server.files["/questions/train.json"]
    assert _Server.ranges == [None, "bytes=1000-", "bytes=2000-", "bytes=3000-"]
    fetch(server, tmp_path)
    assert len(_Server.ranges) == 4  # complete files are skipped


def test_download_gives_up_and_a_later_call_resumes(server, tmp_path, impatient) -> None:
    _Server.cut, _Server.cuts = 1000, 1
    part = tmp_path / "questions" / "train.json.part"
    part.parent.mkdir()
    part.write_bytes(_Server.files["/questions/train.json"][:500])
    _Server.cut, _Server.cuts = 0, 100
    with pytest.raises(DataError, match="run the command again to continue"):
        fetch(server, tmp_path)
    _Server.cut, _Server.cuts = 1000, 1
    assert fetch(server, tmp_path).read_bytes() == _Server.files["/questions/train.json"]
    assert _Server.ranges[0] == "bytes=500-"


def test_a_partial_file_that_is_another_files_is_dropped(server, tmp_path) -> None:
    part = tmp_path / "questions" / "train.json.part"
    part.parent.mkdir()
    part.write_bytes(_Server.files["/questions/train.json"] + b"more")
    with pytest.raises(DataError, match="run the command again"):
        fetch(server, tmp_path)
    assert fetch(server, tmp_path).read_bytes() == _Server.files["/questions/train.json"]


def test_downloaded_zips_are_unpacked(server, tmp_path) -> None:
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as archive:
        archive.writestr("annotation_00000-01000/annotation_00004.json", json.dumps(good.annotation(4)))
    _Server.files["/annotations/train/annotation_train.zip"] = content.getvalue()
    (folder,) = download(tmp_path, "train", ["annotations"], base_url=server)
    assert CLEVRER(tmp_path).split("train").annotation(4)["scene_index"] == 4
    assert [p.name for p in folder.parent.iterdir()] == ["annotation_train"]
    assert download(tmp_path, "train", ["annotations"], base_url=server) == [folder]
    assert len(_Server.ranges) == 1
    (folder / "own.txt").write_text("kept")
    (folder.parent / "annotation_train.zip").write_bytes(content.getvalue())  # of a kill between unpacking and deleting
    download(tmp_path, "train", ["annotations"], base_url=server)
    assert [p.name for p in folder.parent.iterdir()] == ["annotation_train"]
    assert (folder / "own.txt").read_text() == "kept"
    shutil.rmtree(folder)
    with zipfile.ZipFile(folder.parent / "annotation_train.zip", "w") as archive:
        archive.writestr("a" * 300, "")
    with pytest.raises(DataError, match=r"annotation_train: cannot be written \(File name too long"):
        download(tmp_path, "train", ["annotations"], server)
    (folder.parent / "annotation_train.zip").write_bytes(b"half")
    with pytest.raises(DataError, match=r"annotation_train\.zip: not a readable zip .*; delete it"):
        download(tmp_path, "train", ["annotations"], base_url=server)
    assert not folder.exists()


def test_download_errors(server, tmp_path) -> None:
    with pytest.raises(DataError, match=r"video_train\.zip: cannot be fetched .*404"):
        download(tmp_path, "train", ["videos"], base_url=server)
    with pytest.raises(DataError, match="split is 'dev'"):
        download(tmp_path, "dev")
    with pytest.raises(DataError, match="cannot download 'weights'"):
        download(tmp_path, "train", ["weights"])
    assert main(["data", "download", str(tmp_path)]) == 2


def test_questions_round_trip(tmp_path) -> None:
    scenes = read_questions(QUESTIONS)
    write_questions(tmp_path / "q.json", scenes)
    assert read_questions(tmp_path / "q.json") == scenes
    assert json.loads((tmp_path / "q.json").read_text()) == json.loads(QUESTIONS.read_text())


def test_annotations_round_trip(tmp_path) -> None:
    write_annotation(tmp_path / "a.json", good.annotation())
    assert read_annotation(tmp_path / "a.json") == good.annotation()


def test_an_annotation_has_its_own_length(root, tmp_path) -> None:
    """As `nsdr generate dataset --scene.n-frames 64` writes them, and as some of the release are."""
    short = good.annotation(3)
    short["motion_trajectory"] = short["motion_trajectory"][:64]
    path = root / "annotations" / "train" / "annotation_00003.json"
    write_annotation(path, short)
    assert len(read_annotation(path)["motion_trajectory"]) == 64
    report = evaluate_file(root / "questions" / "train.json", "annotations", root / "annotations" / "train")
    assert (report.errors, report["descriptive"]["accuracy"]) == (0, 1.0)
    command = ["evaluate", "--root", str(root), "--split", "train", "--source", "annotations", "--programs", "gold"]
    assert main([*command, "-o", str(tmp_path / "r.json")]) == 0
    assert json.loads((tmp_path / "r.json").read_text())["descriptive"]["accuracy"] == 1.0


def test_ground_truth_blocks(root) -> None:
    block, frames = read_ground_truth(root / "processed_proposals" / "sim_00003.json")
    assert frames == 128
    assert block == good.block()


RESULTS = [
    {"scene_index": 9, "question_id": 1, "choices": [{"choice_id": 0, "answer": "wrong", "correct": True}]},
    {"scene_index": 9, "question_id": 0, "answer": "2", "correct": True},
    {"scene_index": 7, "question_id": 0, "error": "failed", "correct": False},
]


def test_submission(tmp_path) -> None:
    write_submission(tmp_path / "s.json", RESULTS)
    content = read_submission(tmp_path / "s.json")
    assert content == submission_document(RESULTS)
    assert content == [
        {"scene_index": 7, "questions": [{"question_id": 0, "answer": "error"}]},
        {
            "scene_index": 9,
            "questions": [
                {"question_id": 0, "answer": "2"},
                {"question_id": 1, "choices": [{"choice_id": 0, "answer": "wrong"}]},
            ],
        },
    ]
    (tmp_path / "s.json").write_text(
        '[{"scene_index": 1, "questions": [{"question_id": 0, "choices": [{"choice_id": 0}]}]}]'
    )
    with pytest.raises(DataError, match=r"questions\[0\]\.choices\[0\]: expected 'answer'"):
        read_submission(tmp_path / "s.json")


def evaluate_file(questions: Path, source: str, data: Path, **options: Any) -> dict[str, Any]:
    return run_evaluation(EvaluationConfig(questions=str(questions), data=str(data), source=source, **options))


@pytest.mark.parametrize(
    ("source", "folder"),
    [("annotations", "annotations/train"), ("ground-truth", "processed_proposals")],
)
def test_evaluation_on_true_scenes(root, source: str, folder: str) -> None:
    report = evaluate_file(root / "questions" / "train.json", source, root / folder, programs="gold")
    assert (report["descriptive"]["accuracy"], report["descriptive"]["n"]) == (1.0, 1)
    assert report["descriptive"]["subtypes"]["count"]["interval"] == pytest.approx((0.207, 1.0), abs=0.001)
    assert report["predictive"]["n_questions"] == 0
    assert report["predictive"]["per_option"] is None


def test_evaluation_on_predictions_with_both_semantics(root, tmp_path) -> None:
    document = good.predictions()
    document["predictions"][0]["collisions"] *= 2
    (tmp_path / "sim_00003.json").write_text(json.dumps(document))
    questions = root / "questions" / "train.json"
    paper = evaluate_file(questions, "predictions", tmp_path, programs="gold")
    official = evaluate_file(questions, "predictions", tmp_path, programs="gold", semantics="official")
    assert paper.results[0]["answer"] == "1"
    assert official.results[0]["answer"] == "2"
    assert official.results[0]["correct"] is False


def test_failed_questions_count_as_wrong_and_are_listed(root, capsys) -> None:
    (root / "annotations" / "train" / "annotation_00003.json").write_text("{}")
    arguments = ["--questions", str(root / "questions" / "train.json"), "--programs", "gold"]
    arguments += ["--source", "annotations", "--data", str(root / "annotations" / "train")]
    arguments += ["-o", str(root / "out.json"), "--submission", str(root / "sub.json")]
    assert main(["evaluate", *arguments]) == 1
    assert "1 of 1 questions failed: scene 3" in capsys.readouterr().err
    assert not (root / "sub.json").exists()
    assert main(["evaluate", *arguments, "--keep-going"]) == 0
    report = json.loads((root / "out.json").read_text())
    assert report["descriptive"]["accuracy"] == 0.0
    assert "`scene_index`" in report["results"][0]["error"]
    assert read_submission(root / "sub.json")[0]["questions"] == [{"question_id": 0, "answer": "error"}]


def test_failures_of_single_choices_are_counted(example_scene) -> None:
    (scene,) = read_questions(QUESTIONS)
    question = next(q for q in scene.questions if q.type == "predictive")
    absent = Choice(9, "the yellow cube", ("objects", "yellow", "filter_color", "unique"), "wrong")
    asked = replace(scene, questions=(replace(question, choices=(*question.choices, absent)),))
    report = score_scenes([(asked, Executor(example_scene))])
    assert report.errors == 1
    assert "error" not in report.results[0]
    assert "no object in this video is yellow; it has: " in report.results[0]["choices"][-1]["error"]
    assert report["predictive"]["per_question"] == 1.0
    assert str(report).endswith("\nquestions with choices that failed and are judged wrong: 1")


def test_questions_without_answers_are_answered_and_not_scored(root, capsys) -> None:
    file = root / "questions" / "train.json"
    labelled = read_questions(file)
    write_questions(root / "test.json", [without_answers(s) for s in labelled])
    arguments = ["--questions", str(root / "test.json"), "--source", "annotations"]
    arguments += ["--data", str(root / "annotations" / "train")]
    assert main(["evaluate", *arguments, "-o", str(root / "out.json"), "--submission", str(root / "sub.json")]) == 0
    out = capsys.readouterr().out
    assert out == "1 questions have no answers in their file: they are answered, not scored\n"
    report = json.loads((root / "out.json").read_text())
    assert report["unlabelled"] == 1
    assert report["descriptive"]["accuracy"] is None
    assert "correct" not in report["results"][0]
    assert read_submission(root / "sub.json")[0]["questions"][0]["answer"] == labelled[0].questions[0].answer
    assert main(["evaluate", *arguments]) == 2
    found = capsys.readouterr()
    assert found.out == ""
    assert "test.json: the questions have no answers to score; name a file for ours by --submission or -o" in found.err
    (example,) = read_questions(QUESTIONS)
    choices = [q for q in example.questions if q.choices]
    half = replace(
        example, questions=(choices[0], *without_answers(replace(example, questions=(choices[1],))).questions)
    )
    report = score_scenes([(half, DataError("no scene"))])
    assert [("correct" in r, "correct" in r["choices"][0]) for r in report.results] == [(True, True), (False, False)]
    assert (report.errors, report.unlabelled) == (2, 1)
    assert "1 questions have no answers in their file" in str(report)


def test_question_types_are_selected_and_validated(root, example_scene) -> None:
    scenes = read_questions(QUESTIONS)
    report = score_scenes([(scenes[0], Executor(example_scene))], types=["predictive"])
    assert report["predictive"]["per_question"] == 1.0
    assert report["descriptive"]["n"] == 0
    questions = root / "questions" / "train.json"
    with pytest.raises(DataError, match="unknown question type 'riddle'"):
        evaluate_file(questions, "annotations", root, types=["riddle"])
    with pytest.raises(DataError, match="runs on predictions"):
        evaluate_file(questions, "annotations", root, semantics="official")
    with pytest.raises(DataError, match="no such file or folder"):
        evaluate_file(questions, "annotations", root / "nowhere")
