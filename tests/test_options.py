"""Options and configurations are refused before work starts, in one line; exit statuses; limits."""

import re
from pathlib import Path

import pytest

from nsdr import DataError
from nsdr.clevrer.example import TRUTH, VIDEO
from nsdr.cli.common import failures_line
from nsdr.cli.main import COMMANDS, main, outcome_of
from nsdr.cli.train import PARTS
from nsdr.dynamics.physics.config import PhysicsConfig
from nsdr.dynamics.propnet.patch_model import PatchPropNetConfig
from nsdr.dynamics.propnet.state_model import PropNetConfig
from nsdr.dynamics.registry import BackendConfig
from nsdr.evaluation import EvaluationConfig
from nsdr.evaluation.experiments import read_experiment
from nsdr.frame_parser.dataset import AugmentConfig
from nsdr.frame_parser.model import FrameParserConfig
from nsdr.generate.dataset import DatasetConfig
from nsdr.generate.physics.bullet import BulletConfig
from nsdr.generate.physics.scene_config import SceneConfig
from nsdr.generate.questions.selection import QuestionConfig
from nsdr.generate.render.view import RenderConfig
from nsdr.io.configuration import parse_config
from nsdr.io.limits import VARIABLE
from nsdr.pipeline import PipelineConfig
from nsdr.question_parser.model import QuestionParserConfig
from nsdr.tracking.tracker import TrackerConfig
from nsdr.training.frame_parser import FrameParserTraining
from nsdr.training.loop import LoopConfig
from nsdr.training.question_parser import QuestionParserTraining
from nsdr.training.track_task import DynamicsTraining

NAN, INF = float("nan"), float("inf")


@pytest.mark.parametrize(
    ("kind", "values", "name"),
    [
        (TrackerConfig, {"score": 1.1}, "score"),
        (TrackerConfig, {"min_frames": -1}, "min_frames"),
        (TrackerConfig, {"score": NAN}, "score"),
        (TrackerConfig, {"min_frames": 1.5}, "min_frames"),
        (PipelineConfig, {"stride": 0}, "stride"),
        (PipelineConfig, {"batch_size": -1}, "batch_size"),
        (BackendConfig, {"collisions": "zebra"}, "collisions"),
        (PhysicsConfig, {"runs": 0}, "runs"),
        (PhysicsConfig, {"yaw_noise": -1.0}, "yaw_noise"),
        (PhysicsConfig, {"restarts": -1}, "restarts"),
        (PropNetConfig, {"hidden": 10**9}, "hidden"),
        (PropNetConfig, {"collision_threshold": True}, "collision_threshold"),
        (PatchPropNetConfig, {"channels": (16, 0, 64)}, "channels"),
        (FrameParserConfig, {"widths": (16, -16, 16, 16)}, "widths"),
        (FrameParserConfig, {"image_std": (0.1, 0.0, 0.1)}, "image_std"),
        (FrameParserConfig, {"backbone": "zebra"}, "backbone"),
        (QuestionParserConfig, {"layers": 0}, "layers"),
        (QuestionParserConfig, {"dropout": 1.5}, "dropout"),
        (AugmentConfig, {"jpeg": 2.0}, "jpeg"),
        (LoopConfig, {"steps": 0}, "steps"),
        (LoopConfig, {"batch_size": 0}, "batch_size"),
        (LoopConfig, {"log_every": 0}, "log_every"),
        (LoopConfig, {"save_every": -1}, "save_every"),
        (LoopConfig, {"learning_rate": NAN}, "learning_rate"),
        (LoopConfig, {"weight_decay": -0.1}, "weight_decay"),
        (LoopConfig, {"precision": "fp8"}, "precision"),
        (FrameParserTraining, {"frames": "f", "run_dir": "r", "evaluation_frames": 0}, "evaluation_frames"),
        (DynamicsTraining, {"proposals": "p", "truth": "t", "run_dir": "r", "network": "zebra"}, "network"),
        (DynamicsTraining, {"proposals": "p", "truth": "t", "run_dir": "r", "noise_world": INF}, "noise_world"),
        (QuestionParserTraining, {"run_dir": "r", "other": 1.1}, "other"),
        (QuestionParserTraining, {"run_dir": "r", "samples": -1}, "samples"),
        (DatasetConfig, {"output": "o", "scene": SceneConfig(held_out=("qube",))}, "held_out"),
        (DatasetConfig, {"output": "o", "scene": SceneConfig(held_out=("red blue",))}, "held_out"),
        (SceneConfig, {"speed": (4.0, 3.0)}, "speed"),
        (SceneConfig, {"objects": {10**6: 1.0}}, "objects"),
        (SceneConfig, {"objects": {4: NAN}}, "objects"),
        (SceneConfig, {"n_frames": 10**8}, "n_frames"),
        (BulletConfig, {"gravity": -1.0}, "gravity"),
        (BulletConfig, {"restitution": 1.5}, "restitution"),
        (RenderConfig, {"width": 48_000, "height": 32_000}, "width"),
        (RenderConfig, {"crf": 99}, "crf"),
        (RenderConfig, {"samples": 0}, "samples"),
        (QuestionConfig, {"per_video": {"count": -1.0}}, "per_video"),
        (DatasetConfig, {"output": "o", "splits": {"train": NAN}}, "splits"),
        (DatasetConfig, {"output": "o", "workers": -1}, "workers"),
        (DatasetConfig, {"output": "o", "engine": "zebra"}, "engine"),
        (DatasetConfig, {"output": "o", "videos": 0}, "videos"),
        (EvaluationConfig, {"questions": "q", "data": "d", "types": ("zebra",)}, "zebra"),
        (EvaluationConfig, {"questions": "q", "data": "d", "types": ()}, "question type"),
        (EvaluationConfig, {"questions": "q", "data": "d", "limit": -1}, "limit"),
        (EvaluationConfig, {"questions": "q", "data": "d", "every": -1}, "every"),
        (EvaluationConfig, {"questions": "q", "data": "d", "programs": "zebra"}, "programs"),
        (EvaluationConfig, {"root": "r", "split": "zebra"}, "split"),
    ],
)
def test_configurations_check_themselves(kind, values, name) -> None:
    with pytest.raises(DataError, match=name):
        kind(**values)


PARSE = ["parse", VIDEO, "-o", "OUT/scene.json"]
EVALUATE = ["evaluate", "--questions", "none.json", "--data", "none", "--source", "scenes"]
DYNAMICS = ["train", "dynamics", "--proposals", "p", "--truth", "t", "--run-dir", "OUT/run"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([*EVALUATE, "--types", "zebra"], "zebra"),
        ([*EVALUATE, "--limit", "-1"], "limit"),
        ([*EVALUATE, "--every", "0"], "every"),
        ([*EVALUATE, "--workers", "-1"], "workers"),
        ([*EVALUATE, "--engine", "zebra"], "engine"),
        (["parse", "OUT", "-o", "OUT/new", "--set", "stride=0"], "stride"),
        (["parse", "OUT", "-o", "OUT/new", "--workers", "-1"], "workers"),
        ([*PARSE, "--set", "tracker.score=2"], "score"),
        ([*PARSE, "--set", "tracker.score=abc"], "tracker.score"),
        ([*PARSE, "--set", "zebra=1"], "zebra"),
        ([*PARSE, "--set", "help=1"], "--set help=1"),
        ([*PARSE, "--config", "OUT/binary.yaml"], "binary.yaml"),
        ([*PARSE, "--config", "OUT/list.yaml"], "list.yaml"),
        ([*PARSE, "--config", "OUT/nested.yaml"], "nested.yaml"),
        ([*PARSE, "--dynamics", "OUT/nested.yaml"], "nested.yaml"),
        ([*DYNAMICS, "--loop.steps", "0"], "steps"),
        ([*DYNAMICS, "--loop.steps", "abc"], "loop.steps"),
        ([*DYNAMICS, "--loop", "5"], "loop"),
        (["train", "dynamics"], "proposals"),
        (["generate", "dataset", "-o", "OUT/new", "--scene.held-out", "[qube]"], "qube"),
        (["generate", "dataset", "-o", "OUT/new", "--config", "OUT"], "a folder"),
        (["data", "frames", "OUT", "--proposals", "OUT", "-o", "OUT/new", "--every", "0"], "every"),
        (["data", "verify", "OUT", "--keep-going"], "--keep-going"),
    ],
)
def test_options_are_refused_in_one_line_and_nothing_is_written(capsys, tmp_path, arguments, message) -> None:
    (tmp_path / "binary.yaml").write_bytes(bytes(range(256)))
    (tmp_path / "list.yaml").write_text("- a\n- b\n")
    (tmp_path / "nested.yaml").write_text("a: " + "[" * 100_000)
    before = sorted(tmp_path.iterdir())
    code = main([str(a).replace("OUT", str(tmp_path)) for a in arguments])
    out, err = capsys.readouterr()
    assert (code, out) == (2, "")
    assert err.startswith("error: ")
    assert err.count("\n") == 1
    assert message in err
    assert sorted(tmp_path.iterdir()) == before


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            "generate violations -o D --sizes clear",
            "--sizes: expected [clear|small|limit, …], such as '[clear, small, limit]'",
        ),
        ("generate violations -o D --sizes [big]", "--sizes: Expected one of clear, small, limit - at `$.sizes[0]`"),
        (
            "generate dataset -o D --splits all",
            "--splits: expected {train|validation|test: NUMBER, …}, such as '{train: 0.5, ",
        ),
        ("generate dataset -o D --questions foo", "--questions: expected null, or settings by name, "),
        (
            "generate dataset -o D --questions.plain-per-video x",
            "--questions.plain-per-video: expected a whole number, got x",
        ),
        ("generate dataset -o D --renderer foo", "--renderer: Expected one of preview, blender, none, got 'foo'"),
        ("generate dataset --config D/c.yaml -o D", "c.yaml: questions.plain_per_video: expected a whole number"),
        ("evaluate --root D --split all", "--split: expected train|validation|test"),
        ("evaluate --root D --limit -1", "limit: Expected `int` >= 0, got -1"),
        ("compare-videos --root D --generated D -o D --given-frames 0", "--given-frames: expected a whole number >0"),
        ("program q --kind x", "argument --kind: expected auto|descriptive|multiple_choice|choice"),
        ("export D -o D/new", "nsdr export: --format must be given"),
        ("answer D/scene.json", "nsdr answer: QUESTION must be given"),
    ],
)
def test_errors_say_how_a_value_is_written(arguments, message, tmp_path, capsys) -> None:
    (tmp_path / "c.yaml").write_text("questions: {plain_per_video: x}")
    assert main([word.replace("D", str(tmp_path), 1) if word[0] == "D" else word for word in arguments.split()]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert "class" not in error


def test_settings_from_python_name_the_field_and_what_it_may_be() -> None:
    with pytest.raises(DataError, match=r"^split: Expected one of train, validation, test, got 'all'$"):
        EvaluationConfig(root="r", split="all")  # type: ignore[arg-type]
    with pytest.raises(DataError, match=r"^limit: Expected `int` >= 0, got -1$"):
        EvaluationConfig(root="r", limit=-1)


def test_the_default_of_a_list_is_shown_as_it_is_typed(capsys) -> None:
    assert main(["generate", "violations", "--help"]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert "(default: [clear, small, limit])" in out
    assert "--questions null" in out


def test_a_parsed_configuration_names_what_is_wrong(tmp_path) -> None:
    (tmp_path / "a.yaml").write_text("tracker: 5\n")
    with pytest.raises(DataError, match="tracker"):
        parse_config(PipelineConfig, ["--config", str(tmp_path / "a.yaml")], "nsdr")
    (tmp_path / "a.yaml").write_text("tracker: {7: 5}\n")
    with pytest.raises(DataError, match=r"a\.yaml: tracker: 7 is no name of a setting"):
        parse_config(PipelineConfig, ["--config", str(tmp_path / "a.yaml")], "nsdr")
    (tmp_path / "a.yaml").write_text("tracker: {depthx: {7: 5}}\n")
    with pytest.raises(DataError, match=r"a\.yaml: tracker: depthx: no such setting; known are "):
        parse_config(PipelineConfig, ["--config", str(tmp_path / "a.yaml")], "nsdr")
    with pytest.raises(DataError, match="no such file"):
        parse_config(PipelineConfig, [f"--config={tmp_path / 'b.yaml'}"], "nsdr")


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ("{name: a, programs: zebra}", "row 'a': .*programs"),
        ("{name: a, every: -1}", "row 'a': .*every"),
        ("{name: a, types: descriptive}", "row 'a': .*types"),
        ("{name: a, limit: 1.5}", "row 'a': .*limit"),
        ("{name: a, published: [1, 2]}", "row 'a': .*published"),
        ("{name: a, published: [.nan, 2, 3, 4, 5, 6, 7]}", "row 'a': .*published"),
        ("{name: a}\n  - {name: a}", "two rows are named 'a'"),
        ("{name: 5}", r"rows\[0\]: .*name`"),
        ("a", r"rows\[0\]`"),
    ],
)
def test_experiments_are_checked_before_any_row_is_measured(tmp_path, row, message) -> None:
    path = tmp_path / "e.yaml"
    path.write_text(f"title: T\ncommon: {{questions: q.json, data: d, source: scenes}}\nrows:\n  - {row}\n")
    with pytest.raises(DataError, match=rf"e\.yaml: .*{message}"):
        read_experiment(path)


def test_limits_hold_for_commands(capsys, monkeypatch) -> None:
    arguments = ["program", "objects red filter_color count", "--run", str(TRUTH)]
    assert main(arguments) == 0
    monkeypatch.setenv(VARIABLE, "program_tokens=3")
    assert main(arguments) == 2
    assert "more than 3 tokens" in capsys.readouterr().err
    monkeypatch.setenv(VARIABLE, "program_tokens=4")
    assert main(arguments) == 0
    for value in ("zebra=1", "frames=-1"):
        monkeypatch.setenv(VARIABLE, value)
        assert main(arguments) == 2
        assert value in capsys.readouterr().err


@pytest.mark.parametrize(
    ("error", "status", "line"),
    [
        (DataError("a\nb"), 2, "error: a b"),
        (FileNotFoundError(2, "No such file or directory", "x.json"), 2, "error: x.json: No such file or directory"),
        (MemoryError(), 2, "error: not enough memory"),
        (RecursionError("deep"), 2, "nested too deeply"),
        (KeyboardInterrupt(), 130, "interrupted"),
        (KeyError("x"), 70, "a bug in nsdr, please report it: KeyError"),
        (SystemExit(0), 0, ""),
    ],
)
def test_every_exception_is_one_line(error, status, line) -> None:
    found, message = outcome_of(error)
    assert found == status
    assert line in message
    assert "\n" not in message


def test_the_last_line_counts_failures(capsys) -> None:
    assert failures_line(0, 5, "questions", "", keep_going=False) == 0
    assert capsys.readouterr() == ("", "")
    assert failures_line(3, 120, "questions", "scene 1:\na", keep_going=False) == 1
    line = "3 of 120 questions failed, such as scene 1: a"
    assert capsys.readouterr() == ("", f"error: {line}; --keep-going accepts that\n")
    assert failures_line(1, 1, "videos", "scene0.json: a", keep_going=True) == 0
    assert capsys.readouterr().out == "1 of 1 videos failed: scene0.json: a\n"
    assert failures_line(3, 120, "questions", "scene 1: a", keep_going=True) == 0
    assert capsys.readouterr() == (f"{line}\n", "")


def test_a_file_that_cannot_be_opened_is_named(capsys, tmp_path) -> None:
    assert main(["program", "objects count", "--run", str(tmp_path)]) == 2
    assert str(tmp_path) in capsys.readouterr().err
    assert Path(tmp_path).is_dir()


def test_files_are_called_files_in_the_help(capsys) -> None:
    for command in ("parse", "judge", "score"):
        assert main([command, "--help"]) == 0
        assert " TEXT" not in capsys.readouterr().out


@pytest.mark.parametrize(
    "arguments",
    [
        ["visualize", "VIDEO", "-q", "How many cubes are there?", "--question=How many spheres are there?"],
        ["generate", "scene", "-o", "a.json", "--output", "b.json"],
        ["train", "question-parser", "--loop.steps", "1", "--loop.steps=2"],
        ["data", "verify", "x", "--help", "--help"],
        ["visualize", "VIDEO", "-q", "How many cubes are there?", "-qHow many spheres are there?"],
        ["visualize", "VIDEO", "-qHow many cubes are there?", "-qHow many spheres are there?"],
        ["answer", str(VIDEO), "How many cubes are there?", "--set", "stride=2", "--set", "stride=3"],
    ],
)
def test_an_option_that_counts_once_is_not_taken_twice(arguments: list[str], capsys) -> None:
    assert main(arguments) == 2
    error = capsys.readouterr().err
    assert "is given 2 times" in error
    assert ("--set stride" in error) == ("--set" in arguments)


@pytest.mark.parametrize(
    ("option", "value"),
    [("scene.objects", "{3:1.0}"), ("splits", "{train: 1, test:2}"), ("scene", "{objects: {3:1.0}}")],
)
def test_a_map_whose_colons_lack_spaces_is_refused_with_the_remedy(option, value, tmp_path, capsys) -> None:
    (tmp_path / "c.yaml").write_text(f"{option}: {value}")
    for given in ([f"--{option}", value], [f"--{option}={value}"], ["--config", str(tmp_path / "c.yaml")]):
        assert main(["generate", "dataset", "-o", str(tmp_path / "d"), *given]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert str(tmp_path / "c.yaml") in line if "--config" in given else f"--{option} {value}: " in line
        assert "a space after each colon" in line


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["--help"], ["ask:", "process:", "measure:", "data:", "train:", "dataset|violations|scene|questions"]),
        (["generate", "--help"], ["dataset", "violations", "scene", "questions"]),
        (["simulate", "--help"], ["--remove OBJECT", "--fps NUMBER", "auto|cpu|cuda|cuda:N", "the video:"]),
        (["evaluate", "--help"], ["--programs parsed|gold", "--root FOLDER", "--data-set-rules"]),
        (["train", "dynamics", "--help"], ["--run-dir", "--loop.NAME"]),
        (["generate", "dataset", "--help"], ["-o", "--keep-going", "--videos"]),
        (
            ["train", "-h"],
            ["frame-parser", "dynamics", "collisions", "question-parser", "baseline", "--device"],
        ),
        (["data", "features", "--help"], ["--from", "-o", "--keep-going"]),
    ],
)
def test_help_names_parts_and_options(arguments: list[str], told: list[str], capsys) -> None:
    assert main(arguments) == 0
    out = capsys.readouterr().out
    assert not [text for text in told if text not in out]
    assert "class '" not in out


def test_no_help_describes_more_than_twenty_options(capsys) -> None:
    assert len({name.split()[0] for name in COMMANDS}) <= 20
    for name in [*COMMANDS, *(f"train {part}" for part in PARTS)]:
        assert main([*name.split(), "--help"]) == 0
        out = capsys.readouterr().out
        assert len(re.findall(r"^  -", out.partition("\nmore (")[0], flags=re.MULTILINE)) <= 20, name
        assert not re.search(r"(?<!\w)--[\w.-]*_", out), name


def test_options_are_spelled_with_dashes_alone(tmp_path, capsys) -> None:
    given = ["generate", "dataset", "-o", str(tmp_path / "d"), "--videos", "0"]
    for fitting in ("--first-scene=3", "--scene.held-out=[red cube]", "--first-scene"):
        main([*given, *([fitting] if "=" in fitting else [fitting, "3"])])
        assert "videos" in capsys.readouterr().err  # it is what is wrong
    for wrong in ("--first_scene", "--scene.held_out"):
        assert main([*given, wrong, "3"]) == 2
        assert f"{wrong}: options are spelled with dashes: {wrong.replace('_', '-')}" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("option", "begins"),
    [
        (["--stepz", "3"], "error: unrecognized arguments: --stepz"),
        (["--loop.stepz=3"], "error: unrecognized arguments: --loop.stepz"),
        (["--loop.batch_size", "3"], "error: --loop.batch_size: options are spelled with dashes"),
        (["--steps", "0"], "error: --steps: "),
        (["--lr=-1"], "error: --lr: "),
        (["--batch-size", "many"], "error: --batch-size: expected a whole number, got many"),
        (["--loop", "5"], "error: --loop: expected settings by name, "),
        ([], "error: FILE: "),
    ],
)
def test_the_wrong_option_is_named_and_not_the_file(option, begins, tmp_path, capsys) -> None:
    """Where no option is wrong, the file is named."""
    file = tmp_path / "c.yaml"
    file.write_text("run_dir: r\n" if option else "run_dir: r\nlearning: 3\n")
    assert main(["train", "question-parser", "--config", str(file), *option]) == 2
    error = capsys.readouterr().err
    assert error.startswith(begins.replace("FILE", str(file)))
    assert (str(file) in error) == (not option)
