"""A new user's way through the library, by public names and commands alone, on the clip of the package."""

import json
from pathlib import Path

import numpy as np
import pytest

import nsdr
from nsdr.clevrer.example import QUESTIONS, VIDEO
from nsdr.cli.main import main

DATA = str(VIDEO.parent)


@pytest.fixture(scope="module")
def pipeline() -> nsdr.Pipeline:
    return nsdr.Pipeline.from_pretrained(device="cpu")


class EveryThirdFrame:
    """A detector of one's own: here the shipped one, which sees every third frame."""

    def __init__(self) -> None:
        self.parser = nsdr.FrameParser.from_pretrained(device="cpu", stride=3)

    def parse(self, frames, progress=False):
        return self.parser.parse(frames, progress)


class NothingMoves(nsdr.Explanation):
    """An explanation of one's own."""

    def run(self, changes, from_frame, frames):
        n = len(self.objects)
        return nsdr.Rollout(np.zeros((n, frames, 2)), np.ones((n, frames), bool), ())


class Still:
    """A dynamics backend of one's own."""

    def explain(self, states, collisions=None):
        return NothingMoves(states.objects, states.n_frames, states.world)


class AlwaysSpheres:
    """A question parser of one's own."""

    def parse(self, text, kind="descriptive"):
        return nsdr.Program.parse("count(filter_shape(objects, sphere))")


def test_ask_print_and_plot(pipeline: nsdr.Pipeline, tmp_path: Path) -> None:
    perception = pipeline.perceive(VIDEO)
    assert "object 4: purple metal cube" in str(perception.scene)
    assert pipeline.answer(VIDEO, "How many collisions happen?").answer == 4
    answer = pipeline.answer(VIDEO, "What will happen without the purple cube?", ["The cyan sphere exits the scene"])
    assert answer.answer == "The cyan sphere exits the scene"
    assert "correct" in str(answer)
    assert perception.explanation is not None
    rollout = perception.explanation.rollout([nsdr.Remove("purple cube")])
    column, row = rollout.pixels(perception.camera)[1, 50]
    assert 0 < column < 480
    assert 0 < row < 320
    nsdr.save(tmp_path / "scene.json", perception.scene)
    assert pipeline.answer(tmp_path / "scene.json", "How many collisions happen?").answer == 4


def test_replace_each_part(pipeline: nsdr.Pipeline) -> None:
    own = nsdr.Pipeline(EveryThirdFrame(), pipeline.dynamics, pipeline.question_parser)  # type: ignore[arg-type]
    assert own.answer(VIDEO, "How many collisions happen?").answer == 4
    own.dynamics = Still()
    assert own.answer(VIDEO, "How many collisions happen?").answer == 0
    own.question_parser = AlwaysSpheres()  # type: ignore[assignment]
    assert own.answer(VIDEO, "What do you think?").answer == 2


def test_evaluate_and_score(pipeline: nsdr.Pipeline, tmp_path: Path, capsys) -> None:
    report = nsdr.evaluate(pipeline, QUESTIONS, data=DATA, cache=str(tmp_path / "scenes"), workers=1)
    assert report["descriptive"]["interval"][0] > 0.3
    assert "counterfactual" in str(report)
    report.save(tmp_path / "report.json")
    given = {f"{r['scene_index']}-{r['question_id']}": r["answer"] for r in report.results if "answer" in r}
    rows = [{"id": key, "response": answer} for key, answer in given.items()]
    (tmp_path / "answers.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))
    score = ["score", str(tmp_path / "answers.jsonl"), "--questions", str(QUESTIONS), "--allow-missing"]
    assert main(score) == 0
    assert "descriptive" in capsys.readouterr().out


def test_train_lengthen_and_use(tmp_path: Path) -> None:
    small = ["--model.hidden", "16", "--evaluation-texts", "2", "--batch-size", "2", "--loop.warmup-steps", "0"]
    train = ["train", "question-parser", "--run-dir", str(tmp_path / "run"), *small, "--loop.schedule", "constant"]
    assert main([*train, "--steps", "2"]) == 0
    assert main([*train, "--steps", "3"]) == 0
    with pytest.warns(UserWarning, match="has no frame_parser, dynamics; the shipped ones are used"):
        trained = nsdr.Pipeline.from_pretrained(tmp_path / "run" / "checkpoint", device="cpu")
    assert isinstance(trained.question_parser, nsdr.QuestionParser)
    trained.save_pretrained(tmp_path / "mine")
    again = nsdr.Pipeline.from_pretrained(tmp_path / "mine", device="cpu")
    assert repr(again) == repr(trained)
