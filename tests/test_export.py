"""Exports, read back as frameworks read them."""

import dataclasses
import json
import os
import re
import shutil
import socket
from collections import Counter
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np
import pytest
from msgspec.structs import replace
from pyarrow import parquet

from nsdr import DataError, Scene, load, verify
from nsdr.baselines.q_type import q_type_answers
from nsdr.clevrer import example
from nsdr.clevrer.answers.prompts import prompt, solution
from nsdr.clevrer.dataset import CLEVRER
from nsdr.clevrer.files.annotations import read_truth_file
from nsdr.clevrer.files.questions import (
    PAIR_KINDS,
    Choice,
    Question,
    SceneQuestions,
    read_questions,
    without_answers,
    write_questions,
)
from nsdr.clevrer.files.scenes import scene_from_truth
from nsdr.cli.main import main
from nsdr.evaluation.responses import score_responses
from nsdr.evaluation.score import score_answers
from nsdr.generate import dataset
from nsdr.generate.dataset import DatasetConfig, Files, generate_dataset
from nsdr.generate.export import FORMATS, Sample, reasoner
from nsdr.generate.export.pairs import _changed
from nsdr.generate.physics.scene_config import SceneConfig
from nsdr.generate.render.view import RenderConfig
from nsdr.io.files import write_json
from nsdr.io.reading import read_json
from nsdr.io.video import even_frames, write_video
from nsdr.io.worlds import stored_world
from nsdr.rewards import evidence
from nsdr.symbolic import Executor
from nsdr.world.camera import Camera
from nsdr.world.physics import Timeline
from nsdr.world.world import World

PAGE = Path(__file__).parent.parent / "docs" / "export.md"
OPEN = Question(0, "What color is it?", "descriptive", "query_color", ("objects", "unique"), "red")
CHOICES = (
    Choice(0, "The red cube and the sphere collide", ("a", "b"), "correct", "observational"),
    Choice(1, "The sphere and the cylinder collide", ("c",), "wrong", "inferential"),
    Choice(2, "The cube and the cylinder collide", ("d",), "correct"),
)
WHAT_IF = Question(3, "What will happen without the cube?", "counterfactual", None, ("e",), None, CHOICES)
NONE_RIGHT = replace(WHAT_IF, id=4, type="explanatory", choices=(replace(CHOICES[1], tag=None),))
CONFIG = DatasetConfig("unused", videos=5, seed=2, first_scene=7, splits={"train": 0.6, "validation": 0.2, "test": 0.2})


def questions_of(index: int) -> SceneQuestions:
    return SceneQuestions(index, f"video_{index:05d}.mp4", (OPEN, WHAT_IF, NONE_RIGHT))


@cache
def video_of(index: int) -> bytes:
    """A video of 20 frames of 96x64 pixels."""
    with TemporaryDirectory() as folder:
        shades = (np.full((64, 96, 3), 60 + 7 * frame + index % 10, np.uint8) for frame in range(20))
        write_video(Path(folder) / "video.mp4", shades, preset="ultrafast")
        return (Path(folder) / "video.mp4").read_bytes()


@pytest.fixture
def root(tmp_path) -> Path:
    """A generated data set with three training, one validation and one test video."""
    root = tmp_path / "root"
    manifest = dataset._manifest(CONFIG)
    for split, indices in CONFIG.indices().items():
        scenes = [questions_of(index) for index in indices]
        for index in indices:
            video = Files(root, split, index).video
            video.parent.mkdir(parents=True, exist_ok=True)
            video.write_bytes(video_of(index))
        if split == "test":
            write_questions(root / "truth" / "questions_test.json", scenes)
            scenes = [without_answers(scene) for scene in scenes]
        write_questions(root / "questions" / f"{split}.json", scenes)
    write_json(root / "manifest.json", manifest)
    return root


@pytest.fixture
def offline(tmp_path, monkeypatch) -> None:
    """No library may open a connection, or write outside of the test's folder."""
    monkeypatch.setattr("huggingface_hub.constants.HF_HUB_OFFLINE", True)  # the variable is read once, for all tests
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    monkeypatch.setenv("HF_HOME", str(tmp_path / "hub"))

    def refuse(*_: object) -> None:
        raise AssertionError("a connection is opened")

    monkeypatch.setattr(socket.socket, "connect", refuse)


def export(root: Path, output: Path, *options: str, status: int = 0) -> Path:
    assert main(["export", str(root), "-o", str(output), *options]) == status
    return output


def rows(path: Path) -> list[dict]:
    return [json.loads(line) for line in path.read_text().splitlines()]


def content(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def test_rows_have_prompt_solution_tags_programs_and_seed() -> None:
    first, second, third = (
        FORMATS["swift"].row(Sample(q, "validation", 10003, "v.mp4", 42)) for q in questions_of(10003).questions
    )
    assert (first["id"], second["id"], second["scene_index"], second["question_id"]) == ("10003-0", "10003-3", 10003, 3)
    for row, question in zip((first, second, third), questions_of(0).questions, strict=True):
        assert row["solution"] == solution(question)
        assert (row["split"], row["videos"], row["seed"]) == ("validation", ["v.mp4"], 42)
    assert (first["options"], first["letters"], first["tags"]) == ([], [], [])
    assert (second["letters"], second["solution"]) == (["A", "B", "C"], "<answer>A,C</answer>")
    assert second["tags"] == ["observational", "inferential", None]
    assert (second["program"], second["option_programs"]) == (("e",), [("a", "b"), ("c",), ("d",)])
    assert third["solution"] == "<answer>none</answer>"


def test_the_page_has_all_columns() -> None:
    page = PAGE.read_text()
    assert all(f"`{name}`" in page for form in FORMATS.values() for name in form.columns)


def test_every_format_has_the_question_its_video_and_its_answer(root, tmp_path, capsys) -> None:
    """The second row, of which options A and C are right, in all formats."""
    found = {}
    for name, form in FORMATS.items():
        out = export(root, tmp_path / name, "--format", name, "--prefix", "data/")
        assert "train: 9 questions about 3 videos" in capsys.readouterr().out
        assert not list(out.glob("test*"))
        table = rows(out / "train.jsonl") if form.suffix == ".jsonl" else parquet.read_table(out / "train.parquet")
        found[name] = (table if isinstance(table, list) else table.to_pylist())[1]
        assert (out / "videos/train/video_00000-01000/video_00000.mp4").read_bytes() == video_of(0)
    video, asked, right = "data/videos/train/video_00000-01000/video_00000.mp4", prompt(WHAT_IF), solution(WHAT_IF)
    texts = [c.text for c in CHOICES]
    user = {"role": "user", "content": "<video>" + asked}
    trl, verl, easyr1 = found["trl"], found["verl"], found["easyr1"]
    assert (trl["prompt"], trl["completion"]) == (
        [user | {"content": asked}],
        [{"role": "assistant", "content": right}],
    )
    assert trl["images"] == [f"data/frames/train/video_00000/{i:03d}.jpg" for i in range(16)]
    assert (trl["solution"], trl["options"]) == (right, texts)
    assert (verl["prompt"], verl["videos"], verl["data_source"]) == ([user], [{"video": video}], "clevrer")
    assert verl["reward_model"] == {"style": "rule", "ground_truth": right}
    assert (verl["extra_info"]["options"], verl["extra_info"]["id"]) == (texts, "0-3")
    assert (easyr1["problem"], easyr1["videos"]) == ("<video>" + asked, [video])
    assert json.loads(easyr1["answer"]) == {"solution": right, "options": texts}
    swift, chat, lmms = found["swift"], found["chat"], found["lmms_eval"]
    assert swift["messages"] == [user, {"role": "assistant", "content": right}]
    assert (swift["videos"], swift["solution"], swift["options"]) == ([video], right, texts)
    parts = [{"type": "video", "video": video}, {"type": "text", "text": asked}]
    assert chat["messages"][0] == {"role": "user", "content": parts}
    assert (lmms["prompt"], lmms["target"], lmms["options"], lmms["video"]) == (asked, right, texts, video)
    r1 = found["video_r1"]
    assert (r1["path"], r1["solution"], r1["data_type"], r1["problem_type"]) == (
        video,
        right,
        "video",
        "multiple choice",
    )
    assert r1["options"] == [f"{letter}. {text}" for letter, text in zip("ABC", texts, strict=True)]
    assert r1["problem"] == f"{WHAT_IF.text} {asked.splitlines()[-1]}"
    kinds = [
        FORMATS["video_r1"].row(Sample(replace(OPEN, answer=a), "train", 0, ""))["problem_type"] for a in ("red", "2")
    ]
    assert kinds == ["free-form", "numerical"]


def test_frames_have_the_number_and_the_width_that_are_asked_for(root, tmp_path, capsys) -> None:
    out = export(root, tmp_path / "out", "--format", "trl", "--frames", "3", "--frame-width", "48", "--videos", "none")
    first = rows(out / "train.jsonl")[0]
    images = [cv2.imread(str(out / path)) for path in first["images"]]
    assert [image.shape for image in images] == [(32, 48, 3)] * 3
    shades = [even_frames(Files(root, "train", 0).video)[i].mean() for i in (0, 10, 19)]  # from first to last
    assert [image.mean() for image in images] == pytest.approx(shades, abs=2)
    assert not (out / "videos").exists()
    export(root, tmp_path / "no", "--format", "chat", "--frames", "3", status=2)
    assert "format chat takes videos, no frames; leave out --frames, or choose trl" in capsys.readouterr().err


def take_in(root: Path, world: World) -> None:
    """Make a data set one of another world, with videos of 20 frames that become brighter."""
    write_json(root / "manifest.json", read_json(root / "manifest.json") | stored_world(world))
    size = world.camera.height, world.camera.width, 3
    for split, indices in CONFIG.indices().items():
        for index in indices:
            shades = (np.full(size, 60 + 7 * frame, np.uint8) for frame in range(20))
            write_video(Files(root, split, index).video, shades, world.timeline.fps, preset="ultrafast")


def test_frames_are_those_of_the_data_sets_world(root, tmp_path, capsys) -> None:
    take_in(root, World("wide", timeline=Timeline(20, 20), camera=Camera(width=640, height=360)))
    trl = ("--format", "trl", "--frames", "3", "--videos", "none", "--frame-width")
    first = rows(export(root, tmp_path / "out", *trl, "640") / "train.jsonl")[0]
    images = [cv2.imread(str(tmp_path / "out" / path)) for path in first["images"]]
    assert [image.shape for image in images] == [(360, 640, 3)] * 3
    assert [image.mean() for image in images] == pytest.approx([60, 130, 193], abs=2)  # frames 0, 10 and 19
    export(root, tmp_path / "no", *trl, "642", status=2)
    assert "frame_width 642: expected 640 or less" in capsys.readouterr().err


def test_frames_are_not_wider_than_the_images_of_the_world(root, tmp_path) -> None:
    take_in(root, World("narrow", timeline=Timeline(20, 20), camera=Camera(width=192, height=128)))
    first = rows(export(root, tmp_path / "out", "--format", "trl", "--videos", "none") / "train.jsonl")[0]
    assert cv2.imread(str(tmp_path / "out" / first["images"][0])).shape == (128, 192, 3)


def test_chat_rows_end_with_the_answer(root, tmp_path) -> None:
    out = export(root, tmp_path / "out", "--format", "chat")
    user, assistant = rows(out / "train.jsonl")[0]["messages"]
    assert user["content"][1]["text"] == prompt(OPEN)
    assert assistant == {"role": "assistant", "content": [{"type": "text", "text": "<answer>red</answer>"}]}


@pytest.fixture(scope="module")
def told(tmp_path_factory) -> Path:
    """A generated data set without videos."""
    folder = str(tmp_path_factory.mktemp("told"))
    scene = SceneConfig(objects={3: 1.0}, n_frames=60)
    config = DatasetConfig(folder, 3, 7, splits={"train": 1}, renderer="none", masks=False, scene=scene, workers=1)
    return generate_dataset(config)


def test_reasoning_comes_before_the_answer(told, tmp_path) -> None:
    out = export(told, tmp_path / "chat", "--format", "chat", "--videos", "none", "--reasoning", "long")
    questions = [q for scene in read_questions(told / "questions" / "train.json") for q in scene.questions]
    found = rows(out / "train.jsonl")
    assert {row["question_type"] for row in found} >= {"descriptive", "explanatory"}
    for row, question in zip(found, questions, strict=True):
        text = row["messages"][1]["content"][0]["text"]
        assert text.splitlines()[-1] == solution(question)
        claims = verify(text, scene_from_truth(read_truth_file(Files(told, "train", row["scene_index"]).truth)))
        assert claims.claims
        assert all(claim.holds is not False for claim in claims.claims)
    assert "reasoning" not in found[0]


def test_true_scenes_go_with_rewards(told, tmp_path, capsys) -> None:
    here = ["--format", "swift", "--videos", "none"]
    out = export(told, tmp_path / "swift", *here, "--reasoning", "short", "--scenes")
    row = rows(out / "train.jsonl")[0]
    assert row["reasoning"].endswith(row["solution"])
    columns = {name: [value] for name, value in row.items()} | {"scene": [str(told / row["scene"])]}
    assert evidence([row["reasoning"]], **columns) == [1.0]
    plain = rows(export(told, tmp_path / "plain", *here) / "train.jsonl")[0]
    assert plain["reasoning"] is None
    assert plain["scene"] is None


def test_true_scenes_are_copied_with_videos(root, tmp_path, capsys) -> None:
    export(root, tmp_path / "missing", "--format", "swift", "--scenes", status=2)
    assert re.search("truth_00000.json.*annotation_00000.json.*without --reasoning", capsys.readouterr().err)
    assert not (tmp_path / "missing").exists()
    for split, indices in CONFIG.indices().items():
        for index in indices:
            write_json(Files(root, split, index).truth, {"scene": index})
    out = export(root, tmp_path / "out", "--format", "swift", "--scenes")
    row = rows(out / "train.jsonl")[3]
    assert json.loads((out / row["scene"]).read_text()) == {"scene": 1}
    write_json(Files(root, "train", 1).truth, {"scene": "another"})
    export(root, out, "--format", "swift", "--scenes", status=2)
    assert "(inputs)" in capsys.readouterr().err


def test_an_answer_that_the_scene_does_not_give_has_no_reasoning() -> None:
    scene = load(example.TRUTH, Scene)
    question = next(q for q in read_questions(example.QUESTIONS)[0].questions if q.type == "descriptive")
    tell = reasoner(scene, "short")
    assert tell(question)
    assert tell(replace(question, answer="yes" if question.answer != "yes" else "no")) is None
    assert tell(replace(question, program=None)) is None


@pytest.fixture(scope="module")
def compared(tmp_path_factory) -> tuple[Path, Path]:
    """A generated data set with counterfactual videos, and its pairs."""
    folder = tmp_path_factory.mktemp("compared")
    scene, render = SceneConfig(objects={3: 1.0}, n_frames=40), RenderConfig(width=96, height=64)
    config = DatasetConfig(
        str(folder / "data"), 2, 7, splits={"train": 1}, masks=False, counterfactual_videos=2, scene=scene,
        render=render, workers=1,
    )  # fmt: skip
    data = generate_dataset(config)
    return data, export(data, folder / "pairs", "--format", "pairs")


@pytest.mark.filterwarnings("ignore:.*(96x64 px|40 frames)")
def test_pairs_differ_where_the_world_does_and_nowhere_else(compared) -> None:
    data, pairs = compared
    sources = {
        q.text + str(q.choices): s for s in read_questions(data / "questions" / "train.json") for q in s.questions
    }
    scenes = {s.scene_index: s for s in read_questions(pairs / "questions" / "train.json")}
    assert sorted(scenes) == list(range(len(scenes)))
    asked = {f"{s.scene_index}-{q.id}": q for s in scenes.values() for q in s.questions}
    counts: Counter[str] = Counter()
    for index, scene in scenes.items():
        kinds = {q.pair_kind or "" for q in scene.questions}
        assert len(kinds) == 1
        (kind,) = kinds
        counts[kind] += 1
        video = Files(pairs, "train", index).video
        if not kind:
            original, first = sources[scene.questions[0].text + str(scene.questions[0].choices)].scene_index, video
            assert video.read_bytes() == Files(data, "train", original).video.read_bytes()
            executors = [
                Executor(scene_from_truth(read_truth_file(Files(data, "train", original, number).truth)))
                for number in range(3)
            ]
        for q in scene.questions if kind else ():
            other = asked[q.pair]
            assert (q.text, [c.text for c in q.choices]) == (other.text, [c.text for c in other.choices])
            assert q.type != "counterfactual" or kind != "changed"
            assert (solution(q) == solution(other)) == (kind != "changed")
        if kind == "changed":
            (number,) = [
                n for n in (1, 2) if Files(data, "train", original, n).video.read_bytes() == video.read_bytes()
            ]
            for q in scene.questions:
                choices = [(c.text, c.program) for c in q.choices]
                answer_choices = executors[number].answer_choices
                found = answer_choices(q.program, choices) if choices else executors[number].answer(q.program)
                assert [c.answer for c in found.choices] == [c.answer for c in q.choices]
                assert q.choices or found.text == q.answer
        elif kind:
            shown, true = (even_frames(path).astype(int) for path in (video, first))
            shown = shown[:, :, ::-1] if kind == "mirrored" else shown
            assert shown.shape == true.shape
            assert np.abs(shown - true).mean() < (4 if kind == "mirrored" else 25)
            assert (np.abs(shown - true).mean() > 3) == (kind == "noisy")
    assert counts[""] == counts["mirrored"] == counts["noisy"] == 2
    assert counts["changed"] > 1
    assert CLEVRER(pairs).manifest["splits"]["train"] == [0, len(scenes)]


def test_who_does_not_look_has_no_changed_pair_right(compared) -> None:
    scenes = read_questions(compared[1] / "questions" / "train.json")
    report = score_answers(q_type_answers(scenes, "frequent"))
    assert report["pairs"]["changed"]["accuracy"] == 0
    assert report["pairs"]["mirrored"]["accuracy"] == report["pairs"]["noisy"]["accuracy"] > 0
    right = score_responses(scenes, {(s.scene_index, q.id): solution(q) for s in scenes for q in s.questions})
    assert {row["accuracy"] for row in right["pairs"].values()} == {1}


def test_pairs_are_exported_as_any_data_set(compared, tmp_path, capsys) -> None:
    data, pairs = compared
    found = rows(export(pairs, tmp_path / "swift", "--format", "swift") / "train.jsonl")
    by_id = {row["id"]: row for row in found}
    for row in found:
        assert (row["pair"] is None) == (row["pair_kind"] is None)
        assert row["pair"] is None or by_id[row["pair"]]["question"] == row["question"]
        assert row["seed"] is None
    assert {row["pair_kind"] for row in found} == {None, *PAIR_KINDS}
    before = content(pairs)
    capsys.readouterr()
    export(data, pairs, "--format", "pairs")
    assert content(pairs) == before  # it is there already
    n_videos = len({video for row in found for video in row["videos"]})
    assert f"train: {len(found)} questions about {n_videos} videos" in capsys.readouterr().out
    for option in (["--scenes"], ["--videos", "none"], ["--reasoning", "short"]):
        export(data, tmp_path / "no", "--format", "pairs", *option, status=2)
        assert "format pairs holds videos and questions only; leave out " + option[0] in capsys.readouterr().err


@pytest.mark.filterwarnings("ignore:.*(96x64 px|40 frames)")
def test_pairs_without_such_worlds_and_with_too_many_videos(compared, tmp_path, monkeypatch, capsys) -> None:
    data = tmp_path / "data"
    shutil.copytree(compared[0], data, ignore=shutil.ignore_patterns("counterfactual"))
    out = export(data, tmp_path / "pairs", "--format", "pairs", "--limit", "1")
    found = read_questions(out / "questions" / "train.json")
    assert [s.questions[0].pair_kind for s in found] == [None, "mirrored", "noisy"]
    monkeypatch.setattr("nsdr.generate.export.pairs.SPLITS", {"train": range(5)})
    export(data, tmp_path / "many", "--format", "pairs", status=2)
    assert "pairs of train need up to 6 videos; there are indices for 5: use --limit" in capsys.readouterr().err
    rows = json.loads((out / "questions" / "train.json").read_text())
    del rows[1]["questions"][0]["pair_kind"]
    (out / "questions" / "train.json").write_text(json.dumps(rows))
    with pytest.raises(DataError, match=r"\[1\].questions\[0\]: expected both pair and pair_kind or neither"):
        read_questions(out / "questions" / "train.json")


def test_pairs_leave_out_questions_without_another_answer(small_scene) -> None:
    nobody_enters = Executor(dataclasses.replace(small_scene, events=small_scene.events[1:3]))
    cube, green, blue = "cube filter_shape", "green filter_color", "blue filter_color"

    def changed(kind: str, program: str, answer: str, *pairs: tuple[str, str]) -> Question | None:
        """The question in a counterfactual video; of the pairs that may collide, the first one is right in the file."""
        happens = "all_events objects {} unique filter_collision objects {} unique filter_collision unique"
        choices = tuple(
            Choice(i, "?", tuple(happens.format(*pair).split()), "wrong" if i else "correct")
            for i, pair in enumerate(pairs)
        )
        subtype = "count" if kind == "descriptive" else None
        return _changed(Question(0, "?", kind, subtype, tuple(program.split()), answer, choices), nobody_enters)

    found = changed("descriptive", "events objects filter_in count", "1")
    assert found is not None
    assert found.answer == "0"
    assert changed("descriptive", "events objects filter_collision count", "2") is None  # the same answer
    assert changed("descriptive", "events objects filter_in unique get_frame", "10") is None  # of no entrance
    sphere = "rubber filter_material sphere filter_shape red filter_color"
    found = changed("predictive", "unseen_events belong_to", "", (cube, blue), (green, sphere))
    assert found is not None
    assert [c.answer for c in found.choices] == ["wrong", "correct"]
    assert changed("predictive", "unseen_events belong_to", "", (cube, blue), (green, blue)) is None  # neither is right
    assert changed("predictive", "unseen_events belong_to", "", (cube, "yellow filter_color"), (green, sphere)) is None
    assert changed("counterfactual", "unseen_events belong_to", "", (cube, blue), (green, sphere)) is None


@pytest.mark.parametrize("name", FORMATS)
def test_datasets_reads_json_lines_without_filling_in_keys(name, root, tmp_path, offline) -> None:
    from datasets import load_dataset

    out = export(root, tmp_path / "out", "--format", name)
    kind = "json" if FORMATS[name].suffix == ".jsonl" else "parquet"
    files = {split: str(out / f"{split}{FORMATS[name].suffix}") for split in ("train", "validation")}
    loaded = load_dataset(kind, data_files=files, cache_dir=str(tmp_path / "cache"))
    for split, path in files.items():
        assert list(loaded[split]) == (rows(Path(path)) if kind == "json" else parquet.read_table(path).to_pylist())


@pytest.mark.parametrize("name", FORMATS)
def test_exports_are_the_same_bytes_twice(name, root, tmp_path) -> None:
    first = export(root, tmp_path / "first", "--format", name)
    os.utime(Files(root, "train", 0).video, (1, 1))
    assert content(export(root, tmp_path / "second", "--format", name)) == content(first)


def test_an_interrupted_export_goes_on(root, tmp_path, monkeypatch) -> None:
    complete = content(export(root, tmp_path / "complete", "--format", "swift"))
    out, copy = tmp_path / "out", shutil.copyfile

    def fail_later(source: Path, target: Path) -> object:
        if "validation" in str(source):
            raise DataError("stopped")
        return copy(source, target)

    monkeypatch.setattr("shutil.copyfile", fail_later)
    export(root, out, "--format", "swift", status=2)
    assert not (out / "validation.jsonl").exists()
    finished = {path: path.stat().st_mtime_ns for path in out.glob("train*")}
    monkeypatch.setattr("shutil.copyfile", copy)
    export(root, out, "--format", "swift")
    assert content(out) == complete
    assert {path: path.stat().st_mtime_ns for path in out.glob("train*")} == finished


def test_a_finished_export_is_left_as_it_is(root, tmp_path) -> None:
    out = export(root, tmp_path / "out", "--format", "swift")
    (out / "train.jsonl").unlink()
    export(root, out, "--format", "swift")
    assert not (out / "train.jsonl").exists()


def test_other_settings_other_data_and_other_files_are_refused(root, tmp_path, capsys) -> None:
    out = export(root, tmp_path / "out", "--format", "swift")
    export(root, out, "--format", "chat", status=2)
    assert "export.json: was made with other settings (format); choose another folder" in capsys.readouterr().err
    write_questions(root / "questions" / "train.json", [questions_of(1)])
    export(root, out, "--format", "swift", status=2)
    assert "(inputs)" in capsys.readouterr().err
    export(root, root, "--format", "swift", status=2)
    assert "holds files that are no export; choose an empty or new folder" in capsys.readouterr().err


def test_the_test_split_is_exported_on_request_and_without_solutions(root, tmp_path, caplog) -> None:
    out = export(root, tmp_path / "out", "--format", "chat", "--split", "test")
    assert "test: 3 of 3 questions have no answer in their file and were exported without a solution" in caplog.text
    for row in rows(out / "test.jsonl"):
        assert [message["role"] for message in row["messages"]] == ["user"]
        assert row["program"] is None
    questions = str(root / "truth" / "questions_test.json")
    out = export(root, tmp_path / "answers", "--format", "swift", "--split", "test", "--questions", questions)
    assert [row["solution"] for row in rows(out / "test.jsonl")] == [solution(q) for q in questions_of(15000).questions]


def test_videos_are_left_out(root, tmp_path, capsys) -> None:
    moved = root / "video_train" / "video_00000.mp4"
    moved.parent.mkdir()
    Files(root, "train", 0).video.rename(moved)
    Files(root, "train", 1).video.unlink()
    export(root, tmp_path / "missing", "--format", "swift", status=2)
    assert "has no video_00001.mp4 (train); fetch it, or give --videos none" in capsys.readouterr().err
    export(root, tmp_path / "missing", "--format", "trl", "--videos", "none", status=2)
    assert "has no video_00001.mp4 (train); fetch it\n" in capsys.readouterr().err
    out = export(root, tmp_path / "none", "--format", "swift", "--videos", "none", "--limit", "2")
    assert not (out / "videos").exists()
    names = dict.fromkeys(row["videos"][0] for row in rows(out / "train.jsonl"))
    assert list(names) == ["video_train/video_00000.mp4", "videos/train/video_00000-01000/video_00001.mp4"]


def test_the_official_layout_has_no_seeds(root, tmp_path) -> None:
    (root / "manifest.json").unlink()
    out = export(root, tmp_path / "out", "--format", "swift")
    assert {row["seed"] for row in rows(out / "train.jsonl")} == {None}


def test_what_is_missing_is_refused_before_the_work(root, tmp_path, capsys) -> None:
    for option in (["--reasoning", "short"], ["--scenes"]):
        export(root, tmp_path / "out", "--format", "swift", *option, status=2)
        assert re.search("truth_00000.json.*annotation_00000.json.*without --reasoning", capsys.readouterr().err)
    document = json.loads((root / "questions" / "train.json").read_text())
    question = next(q for q in document[0]["questions"] if q.get("choices"))
    question["choices"] = [{**question["choices"][0], "choice_id": i} for i in range(30)]
    (root / "questions" / "train.json").write_text(json.dumps(document))
    export(root, tmp_path / "out", "--format", "swift", status=2)
    assert "train.json: scene 0, question" in capsys.readouterr().err
    assert not (tmp_path / "out" / "export.json").exists()


def test_bad_requests_are_named(root, tmp_path, capsys) -> None:
    export(root, tmp_path / "out", "--format", "zebra", status=2)
    assert re.search("--format: expected trl.*chat.*pairs, got zebra", capsys.readouterr().err)
    export(root, tmp_path / "out", "--format", "swift", "--questions", "q.json", status=2)
    assert "a question file is of one split; name it (--split)" in capsys.readouterr().err
    questions = str(root / "questions" / "train.json")
    export(root, tmp_path / "out", "--format", "swift", "--split", "validation", "--questions", questions, status=2)
    assert "scene_index 0: the data set's validation split has 10000 to 10000" in capsys.readouterr().err
    (root / "questions" / "train.json").unlink()
    export(root, tmp_path / "out", "--format", "swift", "--split", "train", status=2)
    assert "has no questions/train.json; leave out --split train" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_the_examples_of_the_docs_run(root, tmp_path, offline, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    for name in FORMATS:
        export(root, tmp_path / name, "--format", name)
    monkeypatch.setattr("datasets.config.HF_DATASETS_CACHE", tmp_path / "cache")
    capsys.readouterr()
    values: dict = {}
    blocks = re.findall(r"<!-- example -->\n```python\n(.*?)```", PAGE.read_text(), re.DOTALL)
    assert len(blocks) == 2
    for code in blocks:
        exec(code, values)
    assert [image.size for image in values["row"]["images"]] == [(240, 160)] * 16
    assert values["assistant"]["content"][0]["text"] == "<answer>red</answer>"
