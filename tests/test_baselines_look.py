"""Every baseline that sees the video learns to look at it, on features of the truth."""

import json
from dataclasses import replace

import numpy as np
import pytest
from safetensors.numpy import save_file

from nsdr.baselines.base import BASELINES
from nsdr.baselines.features.files import KINDS, MANIFEST, FeatureCache, TruthConfig, feature_file
from nsdr.baselines.features.truth import truth_features
from nsdr.baselines.trained import TrainedBaseline
from nsdr.clevrer.files.questions import Question, SceneQuestions, write_questions
from nsdr.training.baselines import BaselineTask, BaselineTraining, train_baseline
from nsdr.training.loop import LoopConfig

from .test_baselines import SMALL

CONFIG = TruthConfig(frames=4, grid=(4, 6), pooled_grid=(2, 3), max_objects=2)
COLORS = ("red", "blue")
TEXT, PROGRAM = "What color is the object?", ("objects", "unique", "query_color")
VIDEOS, PAIRS = 200, 10
"""Videos of the training; and pairs of others, the first of which has the first colour and the second the second."""


def annotation(color: str, rng: np.random.Generator) -> dict:
    """A video of one object of that colour that moves somewhere."""
    start, step = rng.uniform(-1.5, 1.5, 2), rng.uniform(-0.2, 0.2, 2)
    words = {
        "color": color,
        "material": str(rng.choice(["metal", "rubber"])),
        "shape": str(rng.choice(["cube", "sphere"])),
    }
    motion = [
        {"objects": [{
            "object_id": 0, "location": [*(start + step * frame), 0.2], "orientation": [0.0] * 3, "inside_camera_view": True
        }]}
        for frame in range(4)
    ]  # fmt: skip
    return {"object_property": [{"object_id": 0, **words}], "motion_trajectory": motion}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Features of all videos, and the questions of the training."""
    path, rng = tmp_path_factory.mktemp("truth"), np.random.default_rng(0)
    (path / MANIFEST).write_text(json.dumps(CONFIG.manifest()))
    scenes = []
    for index in range(1, 1 + VIDEOS + 2 * PAIRS):
        color = COLORS[index % 2]
        features = truth_features(annotation(color, rng), CONFIG)
        save_file(
            {kind: np.ascontiguousarray(f.astype(np.float16)) for kind, f in features.items()},
            feature_file(path, index),
        )
        question = Question(0, TEXT, "descriptive", "query_color", PROGRAM, color, ())
        scenes.append(SceneQuestions(index, f"video_{index:05d}.mp4", (question,)))
    write_questions(path / "questions.json", scenes[:VIDEOS])
    return path, scenes[VIDEOS:]


@pytest.mark.parametrize("name", sorted(set(BASELINES.names()) & set(SMALL)))
def test_the_other_video_of_a_pair_gets_the_other_answer(name: str, folder, tmp_path) -> None:
    path, others = folder
    sees = bool(BASELINES[name].needs & set(KINDS))
    loop = LoopConfig(150, 20, learning_rate=3e-3, save_every=1000, device="cpu")
    questions = str(path / "questions.json")
    config = BaselineTraining(
        str(tmp_path / "run"), name, questions, questions, features=str(path) if sees else "", texts_per_video=1,
        model=SMALL[name], loop=loop,
    )  # fmt: skip
    trained = TrainedBaseline.from_pretrained(train_baseline(config))
    features = FeatureCache(path, trained.network.needs) if sees else None
    given = [answers[0].answer for _, answers in trained.answer_questions(others, features)]
    right = sum(answer == scene.questions[0].answer for answer, scene in zip(given, others, strict=True))
    if sees:
        assert right >= 2 * PAIRS - 2
    else:
        assert right == PAIRS  # it gives all videos the same answer


def test_half_of_the_videos_are_mirrored(folder) -> None:
    path, _ = folder
    questions = str(path / "questions.json")
    config = BaselineTraining(
        "run", "tvqa", questions, questions, features=str(path), mirror=True, texts_per_video=1, model=SMALL["tvqa"]
    )
    task = BaselineTask(config)
    drawn = task.draw(200, np.random.default_rng(0), 0)
    assert 70 < sum(example.mirrored for example in drawn) < 130
    example = drawn[0]._replace(mirrored=False)
    inputs = task.collate([example, example._replace(mirrored=True), example]).inputs
    assert inputs.video.tolist() == [0, 1, 0]
    left, _, right, _ = inputs.objects[..., -4:].unbind(-1)
    np.testing.assert_allclose(left[1], (1 - right[0]) * inputs.has_object[0], atol=1e-6)
    assert not any(
        e.mirrored for e in BaselineTask(replace(config, mirror=False)).draw(50, np.random.default_rng(0), 0)
    )
