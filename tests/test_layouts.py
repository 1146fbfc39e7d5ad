"""Data sets, question files and folders of frames as people have them, beside the release's own layout."""

import json
import os
from pathlib import Path
from typing import Any

import cv2
import pytest

from nsdr import DataError
from nsdr.clevrer import read_questions, solution, write_responses
from nsdr.clevrer.dataset import CLEVRER
from nsdr.clevrer.example import QUESTIONS, VIDEO
from nsdr.cli.main import main
from nsdr.io.video import read_video
from tests.robustness import good

from .test_files import question_file

INDEX = 10_002
"""Of a video of the validation split."""
NAMES = {"video": f"video_{INDEX}.mp4", "annotation": f"annotation_{INDEX}.json", "proposal": f"proposal_{INDEX}.json"}
LAYOUTS = {
    "the release's zips, unpacked where its links say": {
        "video": "videos/validation/video_10000-11000",
        "annotation": "annotations/validation/annotation_10000-11000",
        "proposal": "derender_proposals",
        "questions": "questions/validation.json",
    },
    "the release's zips, unpacked by `nsdr data download`": {
        "video": "videos/validation/video_validation/video_10000-11000",
        "annotation": "annotations/validation/annotation_validation/annotation_10000-11000",
        "questions": "questions/validation.json",
    },
    "the release's zips, unpacked in one folder": {
        "video": "video_10000-11000",
        "annotation": "annotation_10000-11000",
        "proposal": "processed_proposals",
        "questions": "validation.json",
    },
    "as SlotFormer wants it": {
        "video": "videos/val/video_10000-11000",
        "annotation": "annotations/val/annotation_10000-11000",
        "questions": "questions/validation.json",
    },
    "as DCL wants it": {
        "video": "video_val",
        "annotation": "annotation_val",
        "proposal": "proposals",
        "questions": "questions/val.json",
    },
    "without folders": {"video": "", "annotation": "", "questions": "questions/validation.jsonl"},
}


def write_layout(root: Path, layout: dict[str, str]) -> Path:
    contents = {
        "video": VIDEO.read_bytes(),
        "annotation": json.dumps(good.annotation(INDEX)).encode(),
        "proposal": json.dumps(good.proposals(INDEX)).encode(),
    }
    for kind, place in layout.items():
        if kind != "questions":
            (root / place).mkdir(parents=True, exist_ok=True)
            (root / place / NAMES[kind]).write_bytes(contents[kind])
    questions = root / layout["questions"]
    question_file(questions, INDEX)
    if questions.suffix == ".jsonl":
        questions.write_text("\n".join(map(json.dumps, json.loads(questions.read_text()))))
    return root


def accuracy(tmp_path: Path, *arguments: object) -> float:
    report = tmp_path / "report.json"
    assert main(["evaluate", *map(str, arguments), "--programs", "gold", "-o", str(report)]) == 0
    return float(json.loads(report.read_text())["descriptive"]["accuracy"])


@pytest.mark.parametrize("layout", LAYOUTS.values(), ids=LAYOUTS)
def test_a_data_set_is_found_in_the_folders_that_people_have(layout: dict[str, str], tmp_path: Path, capsys) -> None:
    root = write_layout(tmp_path / "data", layout)
    split = CLEVRER(root).split("validation")
    assert split.video(INDEX) == root / layout["video"] / NAMES["video"]
    assert split.annotation(INDEX)["scene_index"] == INDEX
    if "proposal" in layout:
        assert split.proposals(INDEX).n_frames == 128
    assert accuracy(tmp_path, "--root", root, "--source", "annotations") == 1.0
    questions = root / layout["questions"]
    assert accuracy(tmp_path, "--questions", questions, "--data", root, "--source", "annotations") == 1.0
    capsys.readouterr()
    assert main(["data", "verify", str(root)]) == 1
    found = {tuple(line.split()[:2]): line.split()[2:4] for line in capsys.readouterr().out.splitlines()}
    assert found["validation", "videos"] == ["1", "5000"]
    assert found["validation", "annotations"] == ["1", "5000"]
    assert found["validation", "questions"] == ["1", "1"]
    assert found["train", "videos"] == ["0", "10000"]


def test_folders_may_be_links(tmp_path: Path) -> None:
    elsewhere = write_layout(tmp_path / "disk", LAYOUTS["as SlotFormer wants it"])
    root = tmp_path / "data"
    root.mkdir()
    (root / "annotations").mkdir()
    for name in ("annotations/val", "videos", "questions"):
        os.symlink(elsewhere / name, root / name)
    assert CLEVRER(root).split("validation").video(INDEX).is_file()
    assert accuracy(tmp_path, "--root", root, "--source", "annotations") == 1.0


def test_what_is_not_found_is_said_with_what_there_is(tmp_path: Path, capsys) -> None:
    root = write_layout(tmp_path / "data", {"annotation": "annos", "questions": "questions/validation.json"})
    assert main(["data", "verify", str(root)]) == 1
    out = capsys.readouterr().out
    assert "annotation_*/, annotation/, annotations/" in out
    assert "annos, questions" in out
    with pytest.raises(DataError, match=rf"annotation_{INDEX}\.json .*annotations/; .* annos, questions"):
        CLEVRER(root).split("validation").annotation(INDEX)


def test_two_files_of_one_name_are_not_guessed_between(tmp_path: Path) -> None:
    root = tmp_path / "data"
    for place in ("videos/first", "videos/second"):
        write_layout(root, {"video": place, "questions": "questions/validation.json"})
    with pytest.raises(DataError, match=r"first/video_10002\.mp4 and .*second/video_10002\.mp4 have one name"):
        CLEVRER(root).split("validation").video(INDEX)
    (root / "videos" / NAMES["video"]).write_bytes(b"nearer")
    assert CLEVRER(root).split("validation").video(INDEX) == root / "videos" / NAMES["video"]


def forms(scene: dict[str, Any]) -> dict[str, str]:
    """The questions of a scene in the forms of files that people have."""
    name, index, questions = scene["video_filename"], scene["scene_index"], scene["questions"]
    rows = [{**q, "scene_index": index, "video_filename": name} for q in questions]
    words = {"yes": True, "no": False, "correct": True, "wrong": False}

    def plain(row: dict[str, Any]) -> dict[str, Any]:
        answer = row.get("answer")
        plain_answer = int(answer) if str(answer).isdecimal() else words.get(str(answer), answer)
        return row | ({"answer": plain_answer} if answer else {})

    as_values = [
        plain(q) | ({"choices": [plain(c) for c in q["choices"]]} if "choices" in q else {}) for q in questions
    ]
    return {
        "lists by video": json.dumps({name: questions}),
        "scenes by number": json.dumps({str(index): scene}, indent=1),
        "scenes by name, without their keys": json.dumps({f"video_{index}": {"questions": questions}}),
        "one scene": json.dumps(scene, indent=1),
        "a scene in each line": json.dumps(scene) + "\n",
        "a question in each line": "\n".join(map(json.dumps, rows)) + "\n",
        "a list of questions": json.dumps(rows),
        "numbers and truth values": json.dumps([{**scene, "questions": as_values}]),
    }


SCENE = json.loads(QUESTIONS.read_text())[0]


@pytest.mark.parametrize("text", forms(SCENE).values(), ids=forms(SCENE))
def test_question_files_are_read_in_every_form(text: str, tmp_path: Path) -> None:
    path = tmp_path / "questions.json"
    path.write_text(text)
    assert read_questions(path) == read_questions(QUESTIONS)
    right = [((SCENE["scene_index"], q.id), solution(q)) for q in read_questions(QUESTIONS)[0].questions]
    write_responses(tmp_path / "answers.jsonl", right)
    report = tmp_path / "r.json"
    assert main(["score", str(tmp_path / "answers.jsonl"), "--questions", str(path), "-o", str(report)]) == 0
    assert json.loads(report.read_text())["descriptive"]["accuracy"] == 1.0


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[]", "holds no scenes"),
        ("{}", "holds no scenes"),
        ('[{"scene_index": 1, "video_filename": "a.mp4", "questions": []}]', "its 1 scenes have none"),
        ('{"first": []}', "'first': expected the name or number of a video"),
        ('{"video_3.mp4": {"scene_index": 4, "questions": []}}', r"video_3\.mp4\.scene_index: expected 3, got 4"),
        ('{"question": "Why?"}\n{"question": "How?"}', "line 1: .*scene_index`"),
        ('{"1": [{"question_id": 0}]}', r"1: .*questions\[0\]`"),
    ],
)
def test_malformed_question_files_name_the_place(text: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "questions.json"
    path.write_text(text)
    with pytest.raises(DataError, match=message):
        read_questions(path)


@pytest.mark.filterwarnings("ignore:.*CLEVRER's videos have 128")
def test_videos_may_be_folders_of_frames(short_video: Path, tmp_path: Path, capsys) -> None:
    """For `parse`, for one video with `--fps`, and for `evaluate`, in a data set and beside a question file."""
    root, frames = tmp_path / "data", read_video(short_video)
    folder = root / "videos" / "val" / f"video_{INDEX}"
    folder.mkdir(parents=True)
    for k, image in enumerate(frames):
        cv2.imwrite(str(folder / f"{k:05d}.png"), image[..., ::-1])
    for place in (root, folder.parent):
        assert CLEVRER(place).split("validation").video(INDEX) == folder
    out, fast = tmp_path / "scenes", ["--set", "stride=2", "--fps", "25"]
    assert main(["parse", str(root / "videos"), "-o", str(out), "--workers", "1", *fast]) == 0
    assert (out / f"scene_{INDEX}.json").is_file()
    assert "does not say its frame rate" not in capsys.readouterr().err
    question_file(root / "questions" / "validation.json", INDEX)
    report, cache = (
        str(tmp_path / "r.json"),
        ["--cache", str(tmp_path / "cache"), "--workers", "1", "--programs", "gold"],
    )
    beside = ["--questions", str(root / "questions" / "validation.json"), "--data", str(root / "videos")]
    for given in (["--root", str(root)], beside):
        assert main(["evaluate", *given, "--source", "videos", "--set", "stride=2", *cache, "-o", report]) == 0
        assert json.loads(Path(report).read_text())["errors"] == 0
