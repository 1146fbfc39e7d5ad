"""`nsdr answer --system`: a trained baseline answers a question about one video."""

import json
from pathlib import Path

import pytest
import torch

from nsdr.baselines.base import BASELINES
from nsdr.baselines.data import Vocabulary, encoded
from nsdr.baselines.features.extraction import FeatureExtraction, WordExtraction, extract_features
from nsdr.baselines.features.files import FeatureCache, FeatureConfig, WordConfig, as_inputs
from nsdr.baselines.features.words import detected_features
from nsdr.baselines.trained import TrainedBaseline
from nsdr.clevrer.example import VIDEO
from nsdr.clevrer.files.questions import Choice, Question, SceneQuestions
from nsdr.cli.main import main
from nsdr.frame_parser.model import FrameParserConfig, build_frame_parser
from nsdr.frame_parser.parser import FrameParser
from nsdr.generate.dataset import DatasetConfig, generate_dataset
from nsdr.generate.physics.scene_config import SceneConfig
from nsdr.generate.render.view import RenderConfig
from nsdr.io.configuration import config_of
from nsdr.io.video import read_frames, spaced
from nsdr.world.vocabulary import CLEVRER

from .test_baselines import SMALL

FRAMES = 4
COUNT = Question(
    0, "How many cubes are there?", "descriptive", "count", ("objects", "cube", "filter_shape", "count"), "0"
)
SPHERE, CUBE = ("objects", "sphere", "filter_shape", "unique"), ("objects", "cube", "filter_shape", "unique")
COLLISION = ("all_events", *SPHERE, "filter_collision", *CUBE, "filter_collision", "unique")
CHOICE = Choice(0, "The sphere collides with the cube.", COLLISION, "correct")
NEXT = Question(1, "What will happen next?", "predictive", None, ("unseen_events", "belong_to"), None, (CHOICE,))


@pytest.fixture(scope="module")
def data(tmp_path_factory) -> Path:
    """A data set of one video with its annotation, and features of both kinds."""
    root = tmp_path_factory.mktemp("one")
    scene = SceneConfig(objects={2: 1.0})
    generate_dataset(
        DatasetConfig(
            str(root), 1, splits={"validation": 1}, masks=False, questions=None, scene=scene,
            render=RenderConfig(96, 64), workers=1,
        )
    )  # fmt: skip
    small = FrameParserConfig(widths=(16, 16, 16, 16), blocks=1, fpn_channels=16, box_features=16, mask_channels=16)
    FrameParser(build_frame_parser(small)).save_pretrained(root / "parser")
    pixels = FeatureConfig(
        "frame_parser", FRAMES, (320, 480), (2, 3), kinds=("pooled", "maps"), detector=str(root / "parser")
    )
    extract_features(FeatureExtraction(str(root), str(root / "pixels"), features=pixels, workers=1, device="cpu"))
    extract_features(WordExtraction(str(root), str(root / "truth"), features=WordConfig(FRAMES), workers=1))
    return root


def untrained(name: str, features: FeatureCache | None, folder: Path) -> TrainedBaseline:
    """A baseline of random weights, read from its checkpoint."""
    torch.manual_seed(0)
    kind, asked = BASELINES[name], SceneQuestions(0, "video_00000.mp4", (COUNT, NEXT))
    vocabulary = Vocabulary.from_questions([asked], CLEVRER)
    sizes = vocabulary.sizes(features.channels, features.grid) if features else vocabulary.sizes()
    made = features.manifest["features"] if features else {}
    TrainedBaseline(name, kind(config_of(kind.Config, SMALL[name]), sizes), vocabulary, made).save_pretrained(folder)
    return TrainedBaseline.from_pretrained(folder, "cpu")


class Known(dict):
    """`Features` of one video."""

    def get(self, scene_index, needs):
        return self


@pytest.mark.parametrize(
    ("name", "learnt_from"), [("cnn_mlp", "pixels"), ("tbd", "truth"), ("mac_objects", "truth"), ("lstm", "")]
)
def test_the_answer_is_that_of_the_evaluation(name: str, learnt_from: str, data, tmp_path, capsys) -> None:
    features = FeatureCache(data / learnt_from, BASELINES[name].needs) if learnt_from else None
    baseline = untrained(name, features, tmp_path / "it")
    ((_, expected),) = baseline.answer_questions([SceneQuestions(10_000, "video_10000.mp4", (COUNT, NEXT))], features)
    (source,) = data.rglob("annotation_10000.json" if learnt_from == "truth" else "video_10000.mp4")
    given = ["answer", str(source), "--system", str(tmp_path / "it"), "--device", "cpu", "--json"]
    given += [] if learnt_from == "truth" else ["--force"]
    assert main([*given, COUNT.text]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["answer"], found["probability"]) == (expected[0].answer, pytest.approx(expected[0].probability))
    assert main([*given, NEXT.text, "-c", NEXT.choices[0].text]) == 0
    (choice,) = json.loads(capsys.readouterr().out)["choices"]
    assert choice["probability"] == pytest.approx(expected[1].choices[0].probability)


def test_what_learnt_from_the_truth_answers_a_video_by_found_objects(data, tmp_path, capsys) -> None:
    baseline = untrained("mac_objects", FeatureCache(data / "truth", ["objects"]), tmp_path / "it")
    frames = list(read_frames(VIDEO))
    found = FrameParser.from_pretrained("default", "cpu").parse([frames[i] for i in spaced(len(frames), FRAMES)])
    features = detected_features(found, WordConfig(FRAMES, source="proposals"))
    assert features["objects"].any(2).sum() >= FRAMES
    assert main(["answer", str(VIDEO), "--system", str(tmp_path / "it"), "--device", "cpu", "--json", COUNT.text]) == 0
    answer = json.loads(capsys.readouterr().out)
    (example,) = encoded(0, COUNT, baseline.vocabulary, baseline.network.needs)
    expected = baseline.probabilities([example], Known(as_inputs(features)))
    assert answer["probability"] == pytest.approx(float(expected.max()), rel=1e-3)


def test_what_a_baseline_cannot_answer_from_is_refused(data, tmp_path, monkeypatch, capsys) -> None:
    monkeypatch.setenv("NSDR_CHECKPOINTS", str(tmp_path))
    untrained("cnn_mlp", FeatureCache(data / "pixels", ["pooled"]), tmp_path / "baselines" / "small")
    untrained("mac_objects", FeatureCache(data / "truth", ["objects"]), tmp_path / "baselines" / "exact")
    (video,), (annotation,) = data.rglob("video_10000.mp4"), data.rglob("annotation_10000.json")

    def refusal(source: Path, system: str, *more: str, question: str = COUNT.text) -> str:
        assert main(["answer", str(source), "--system", system, question, "--device", "cpu", *more]) == 2
        return capsys.readouterr().err

    assert "learnt from pixels: give a video" in refusal(annotation, "small")
    assert "baselines/none" in refusal(video, "none", "--force")
    assert "--trace would do nothing with --system" in refusal(video, "small", "--trace")
    assert "--question-parser would do nothing: small reads no programs" in refusal(
        video, "small", "--question-parser", "http://x"
    )
    assert "pyramids" in refusal(video, "small", "--force", question="Are there any pyramids?")
    FrameParser(build_frame_parser(FrameParserConfig(fpn_channels=16))).save_pretrained(data / "parser")
    assert "the weights that are found here: features have detector_fingerprint" in refusal(video, "small", "--force")
