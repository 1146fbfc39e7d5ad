"""`nsdr.evaluate` on a pipeline with any parts."""

import shutil
from pathlib import Path

import pytest

import nsdr
from nsdr.clevrer.example import QUESTIONS, VIDEO
from nsdr.clevrer.files.questions import read_questions, write_questions

N_QUESTIONS = 10


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A data set in the official layout with the video of the package."""
    root = tmp_path_factory.mktemp("data")
    (scene,) = read_questions(QUESTIONS)
    (root / "videos").mkdir()
    shutil.copy(VIDEO, root / "videos" / "video_10000.mp4")
    scene = type(scene)(10000, "video_10000.mp4", scene.questions)
    write_questions(root / "questions" / "validation.json", [scene])
    return root


@pytest.fixture(scope="module")
def pipeline() -> nsdr.Pipeline:
    return nsdr.Pipeline.from_pretrained(device="cpu")


def test_a_pipeline_is_evaluated_and_goes_on(pipeline: nsdr.Pipeline, root: Path, tmp_path: Path, monkeypatch) -> None:
    report = nsdr.evaluate(pipeline, root, limit=1, cache=str(tmp_path), workers=1)
    assert len(report.results) == N_QUESTIONS
    assert report.errors == 0
    assert report["descriptive"]["accuracy"] >= 0.8
    header, first, *_ = str(report).splitlines()
    assert (header.split()[0], first.split()[0]) == ("per", "descriptive")
    assert "[" in first
    report.save(tmp_path / "report.json")
    assert nsdr.Report.load(tmp_path / "report.json").tables == report.tables
    kept = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("scene_*.json")}
    again = nsdr.evaluate(nsdr.Pipeline.from_pretrained(device="cpu"), root, cache=str(tmp_path), workers=1)
    assert again.results == report.results
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("scene_*.json")} == kept


class FourCubes:
    """A question parser of a user's own, which is no `nsdr.question_parser.Parser`."""

    def parse(self, text: str, kind: str = "descriptive") -> nsdr.Program:
        if kind != "descriptive":
            raise nsdr.QuestionError("only descriptive ones")
        return nsdr.Program.parse("objects cube filter_shape count")


class Shaky:
    """A dynamics backend of a user's own."""

    def __init__(self) -> None:
        self.seen = 0

    def explain(self, states, collisions=None):
        self.seen += 1
        return nsdr.PhysicsPredictor.from_pretrained(device="cpu").explain(states, collisions)


class Broken:
    def explain(self, states, collisions=None):
        return {}["missing"]


def with_dynamics(pipeline: nsdr.Pipeline, dynamics: nsdr.Dynamics) -> nsdr.Pipeline:
    return nsdr.Pipeline(pipeline.frame_parser, dynamics, pipeline.question_parser)


def test_parts_of_ones_own_are_evaluated(pipeline: nsdr.Pipeline, root: Path, tmp_path: Path) -> None:
    own = with_dynamics(pipeline, dynamics := Shaky())
    report = nsdr.evaluate(own, root, cache=str(tmp_path / "scenes"))
    assert dynamics.seen == 1
    assert report.results == nsdr.evaluate(pipeline, root, cache=str(tmp_path), workers=1).results
    assert not (tmp_path / "scenes").exists()
    own = nsdr.Pipeline(pipeline.frame_parser, pipeline.dynamics, FourCubes())  # type: ignore[arg-type]
    report = nsdr.evaluate(own, root, cache=str(tmp_path), workers=1)
    assert {r.get("answer") for r in report.results if r["question_type"] == "descriptive"} == {"2"}
    assert sum("only descriptive ones" in r.get("error", "") for r in report.results) == report.errors > 0


def test_a_bug_in_a_part_of_ones_own_is_raised(pipeline: nsdr.Pipeline, root: Path) -> None:
    with pytest.raises(KeyError, match="missing"):
        nsdr.evaluate(with_dynamics(pipeline, Broken()), root)


def test_a_path_that_is_not_there_is_named(pipeline: nsdr.Pipeline) -> None:
    with pytest.raises(nsdr.DataError, match=r"^nothere: no such file or folder"):
        nsdr.evaluate(pipeline, "nothere")
    with pytest.raises(nsdr.DataError, match=r"questions_500002\.json is a question file; data=… names"):
        nsdr.evaluate(pipeline, QUESTIONS)


def test_settings_that_the_pipeline_has_are_refused(pipeline: nsdr.Pipeline, root: Path) -> None:
    with pytest.raises(nsdr.DataError, match="dynamics: the pipeline that is given has its own"):
        nsdr.evaluate(pipeline, root, dynamics="propnet")
