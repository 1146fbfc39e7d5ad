"""Every baseline that sees the video learns to look at it, on features of the truth."""

import json
from dataclasses import replace

import numpy as np
import pytest
from safetensors.numpy import save_file

from nsdr.baselines.base import BASELINES
from nsdr.baselines.features.files import KINDS, MANIFEST, FeatureCache, WordConfig, feature_file
from nsdr.baselines.features.words import truth_features
from nsdr.baselines.recoloring import Recoloring
from nsdr.baselines.trained import TrainedBaseline
from nsdr.clevrer.files.questions import Question, SceneQuestions, write_questions
from nsdr.errors import DataError
from nsdr.question_parser.tokenizer import decoder_tokens
from nsdr.training.baselines import BaselineTask, BaselineTraining, train_baseline
from nsdr.training.loop import LoopConfig
from nsdr.world.vocabulary import CLEVRER

from .test_baselines import SMALL

CONFIG = WordConfig(frames=4, grid=(4, 6), pooled_grid=(2, 3), max_objects=2)
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
    given = [answers[0].text for _, answers in trained.answer_questions(others, features)]
    right = sum(answer == scene.questions[0].answer for answer, scene in zip(given, others, strict=True))
    if sees:
        assert right >= 2 * PAIRS - 2
    else:
        assert right == PAIRS  # it gives all videos the same answer


def test_colors_are_exchanged_in_features_words_programs_and_answers(folder, tmp_path) -> None:
    path, _ = folder
    text, program = "Is there a red object?", ("objects", "red", "filter_color", "exist")
    scenes = [
        SceneQuestions(
            index, f"video_{index:05d}.mp4",
            (Question(0, TEXT, "descriptive", "query_color", PROGRAM, COLORS[index % 2], ()),
             Question(1, text, "descriptive", "exist", program, "yes" if index % 2 == 0 else "no", ())),
        )
        for index in range(1, 9)
    ]  # fmt: skip
    write_questions(tmp_path / "questions.json", scenes)
    questions = str(tmp_path / "questions.json")
    settings = {"features": str(path), "recolor": True, "texts_per_video": 2, "model": SMALL["tbd"]}
    task = BaselineTask(BaselineTraining("run", "tbd", questions, questions, **settings))
    vocabulary = task.trained.vocabulary
    assert "blue" not in vocabulary.words  # it occurs in answers alone, so nothing is exchanged
    assert all(e.colors == tuple(range(8)) for e in task.draw(8, np.random.default_rng(0), 0))
    vocabulary = replace(vocabulary, words=(*vocabulary.words, "blue"))
    red, blue = CLEVRER.words["color"].index("red"), CLEVRER.words["color"].index("blue")
    colors = list(range(8))
    colors[red], colors[blue] = blue, red
    recoloring = Recoloring(vocabulary)
    assert recoloring.known == [red, blue]
    assert {recoloring.draw(np.random.default_rng(seed)) for seed in range(9)} == {tuple(range(8)), tuple(colors)}
    asked, exists = (recoloring.text(e, tuple(colors)) for e in task.videos[0])
    assert [vocabulary.answers[e.answer] for e in (asked, exists)] == ["red", "no"]  # video 1 has a blue object
    assert vocabulary.words[exists.words[3] - 1] == "blue"
    assert [decoder_tokens(CLEVRER)[t] for t in exists.program] == ["objects", "blue", "filter_color", "exist"]
    found, before = (task.collate([e]).inputs.maps[0, :, :8].sum((0, 2, 3)) for e in (asked, task.videos[0][0]))
    assert before[blue] > 0
    assert found[red] == before[blue]
    assert found[blue] == before[red] == 0
    manifest = CONFIG.manifest()
    del manifest["features"]["from"]
    (tmp_path / MANIFEST).write_text(json.dumps(manifest))
    with pytest.raises(DataError, match="has features of pixels; give those of the truth"):
        BaselineTask(BaselineTraining("run", "tbd", questions, questions, **{**settings, "features": str(tmp_path)}))
