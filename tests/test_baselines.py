"""What all trained baselines have in common, on tiny questions and random features."""

import json
import re
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
import torch
from accelerate.utils import send_to_device
from msgspec.structs import replace
from safetensors.numpy import save_file

from nsdr import DataError
from nsdr.baselines.base import BASELINES, Batch, Sizes
from nsdr.baselines.data import PAD, Vocabulary, make_batch, training_examples
from nsdr.baselines.features.files import KINDS, MANIFEST, FeatureCache, feature_file
from nsdr.baselines.trained import TrainedBaseline, masked_scores
from nsdr.clevrer.files.questions import PLAIN, Choice, Question, SceneQuestions, write_questions
from nsdr.cli.main import main
from nsdr.errors import CheckpointError
from nsdr.evaluation.score import score_answers
from nsdr.io.configuration import config_of, parse_config
from nsdr.question_parser.tokenizer import decoder_tokens
from nsdr.training.baselines import BaselineTask, BaselineTraining, train_baseline
from nsdr.training.loop import LoopConfig
from nsdr.training.run_folder import parse_training
from nsdr.world.vocabulary import CLEVRER
from tests.second_device import second_device

FRAMES, CHANNELS, GRID, OBJECTS = 5, 6, (2, 3), 3
SMALL = {
    "lstm": {"embedding": 16, "hidden": 32, "head": 32, "dropout": 0.0},
    "cnn_mlp": {"embedding": 16, "head": 32, "dropout": 0.0},
    "cnn_lstm": {"embedding": 16, "hidden": 32, "video": 16, "head": 32, "dropout": 0.0},
    "tvqa": {"embedding": 16, "hidden": 16, "head": 32, "dropout": 0.0},
    "memory": {"embedding": 16, "hidden": 32, "slots": 4, "steps": 2, "dropout": 0.0},
    "iep": {"width": 16, "frames": 3, "projection": 16, "hidden": 32},
    "tbd": {"width": 16, "frames": 3, "projection": 16, "hidden": 32, "dilations": [1, 2]},
    "mac": {"embedding": 16, "width": 32, "steps": 2, "dropout": 0.0},
    "mac_objects": {"embedding": 16, "width": 32, "steps": 2, "dropout": 0.0},
}
"""Small settings of each baseline."""
TEXTS = (
    (
        "descriptive",
        "Are there any cubes moving at the end?",
        "objects cube filter_shape end get_frame filter_moving exist",
    ),
    ("descriptive", "How many spheres are there?", "objects sphere filter_shape count"),
    (
        "explanatory",
        "Which of the following is responsible for the exit of the cube?",
        "events events objects cube filter_shape unique filter_out unique filter_ancestor belong_to",
    ),
    ("predictive", "What will happen next?", "unseen_events belong_to"),
)
"""Type, text and program of each question."""
CHOICES = (
    ("the presence of the cube", "objects cube filter_shape unique"),
    ("the collision of the sphere", "all_events objects sphere filter_shape unique filter_collision unique"),
)
"""Text and program of each option."""


def scene_questions(index: int) -> SceneQuestions:
    """Two descriptive and two multiple-choice questions of two options; the answers depend on the video."""
    questions = []
    for k, (kind, text, program) in enumerate(TEXTS):
        answer, choices = ("yes", "no", "1", "2")[(index + k) % 2 + 2 * k] if kind == "descriptive" else None, ()
        if kind != "descriptive":
            choices = tuple(
                Choice(c, option, tuple(of_option.split()), ("wrong", "correct")[c == 0 and index % 2 == 0])
                for c, (option, of_option) in enumerate(CHOICES)
            )
        subtype = ("exist", "count", None, None)[k]
        questions.append(Question(k, text, kind, subtype, tuple(program.split()), answer, choices))
    return SceneQuestions(index, f"video_{index:05d}.mp4", tuple(questions))


@pytest.fixture
def scenes() -> list[SceneQuestions]:
    return [scene_questions(index) for index in range(10, 16)]


@pytest.fixture
def folder(tmp_path):
    """Features of videos 10 to 15, whose sign tells even from odd ones, in the form of `nsdr data features`."""
    path, rng = tmp_path / "features", np.random.default_rng(0)
    shapes = {
        "pooled": (FRAMES, CHANNELS),
        "maps": (FRAMES, CHANNELS, *GRID),
        "objects": (FRAMES, OBJECTS, CHANNELS + 4),
    }
    path.mkdir()
    for index in range(10, 16):
        values = {kind: rng.standard_normal(shape) + (-2.0, 2.0)[index % 2] for kind, shape in shapes.items()}
        values["objects"][..., -4:] = (0.1, 0.1, 0.5, 0.5)
        values["objects"][:, 2:] = 0.0  # no third object
        save_file({kind: value.astype(np.float16) for kind, value in values.items()}, feature_file(path, index))
    (path / MANIFEST).write_text(json.dumps({"features": {"frames": FRAMES}, "shapes": shapes}))
    return path


def features_of(name: str, folder):
    needs = BASELINES[name].needs
    return FeatureCache(folder, needs) if needs & set(KINDS) else None


def built(name: str, scenes, folder) -> tuple[TrainedBaseline, FeatureCache | None]:
    torch.manual_seed(0)
    kind, features = BASELINES[name], features_of(name, folder)
    vocabulary = Vocabulary.from_questions(scenes, CLEVRER)
    sizes = vocabulary.sizes(features.channels, features.grid) if features else vocabulary.sizes()
    made = features.manifest["features"] if features else {}
    return TrainedBaseline(name, kind(config_of(kind.Config, SMALL[name]), sizes), vocabulary, made), features


def examples_of(baseline: TrainedBaseline, scenes):
    videos = training_examples(scenes, baseline.vocabulary, baseline.network.needs)
    return [example for video in videos for example in video]


@pytest.mark.parametrize("name", BASELINES.names())
def test_a_baseline_overfits_eight_questions(name: str, scenes, folder) -> None:
    two = scenes[:1] if name == "lstm" else scenes[:2]  # which sees no video, and cannot tell two apart
    baseline, features = built(name, two, folder)
    examples = examples_of(baseline, two)
    batch = make_batch(examples, features, baseline.network.needs, CLEVRER)
    answers = torch.tensor([e.answer for e in examples])
    is_choice = torch.tensor([e.is_choice for e in examples])
    optimizer = torch.optim.Adam(baseline.network.parameters(), 5e-3)
    baseline.network.train()
    for _ in range(150):
        scores = masked_scores(baseline.network(batch), is_choice, baseline.vocabulary.possible_answers())
        loss = torch.nn.functional.cross_entropy(scores, answers)
        optimizer.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(baseline.network.parameters(), 1.0)
        optimizer.step()
        if loss < 0.02:
            break
    assert loss < 0.1
    report = score_answers(baseline.answer_questions(two, features))
    assert report.errors == 0
    assert all(result["correct"] for result in report.results)
    assert report["descriptive"]["n"] == 2 * len(two)


@pytest.mark.parametrize(("name", "least"), [("mac", 0.0015), ("mac_objects", 0.01), ("memory", 0.001), ("tbd", 0.03)])
def test_before_training_the_scores_depend_on_text_and_video_together(name: str, least: float) -> None:
    """By PyTorch's own initialisation a third to a fiftieth of `least` of the scores' variance does."""
    config = parse_training(BaselineTraining, ["--config", f"configs/baselines/small/{name}.yaml"], "baseline")
    kind, rng = BASELINES[name], torch.Generator().manual_seed(0)
    texts, videos, frames, objects, channels = 20, 6, 25, 5, 256
    torch.manual_seed(0)
    network = kind(config.model_config(), Sizes(80, 21, channels, (4, 6), CLEVRER)).eval()
    programs = [
        [decoder_tokens(CLEVRER).index(w) for w in p.split()] for _, _, p in TEXTS for _ in range(texts // len(TEXTS))
    ]
    batch = Batch(
        torch.randint(2, 80, (texts, 12), generator=rng),
        torch.zeros(texts, dtype=torch.long),
        program=torch.nn.utils.rnn.pad_sequence([torch.tensor(p) for p in programs], True, PAD),
    )

    def features(*shape: int) -> torch.Tensor:
        """Positive and mostly alike, as the features of videos from a fixed camera."""
        return torch.rand(1, frames, *shape, generator=rng) + torch.rand(videos, 1, *shape, generator=rng)

    of_videos = {
        "pooled": features(channels),
        "maps": features(channels, 4, 6),
        "objects": features(objects, channels + 4),
    }
    with torch.no_grad():
        scores = torch.stack(
            [
                network(
                    batch._replace(
                        **{name: values[v : v + 1] for name, values in of_videos.items()},
                        has_object=torch.ones(1, frames, objects, dtype=torch.bool),
                    )
                )
                for v in range(videos)
            ]
        )
    by_text, by_video = scores.mean(0, keepdim=True), scores.mean(1, keepdim=True)
    together = scores - by_text - by_video + scores.mean((0, 1))
    assert together.var() > least * (by_text - by_text.mean(1, keepdim=True)).var()


@pytest.mark.parametrize("name", BASELINES.names())
def test_padding_and_order_do_not_matter(name: str, scenes, folder) -> None:
    baseline, features = built(name, scenes, folder)
    examples = examples_of(baseline, scenes)
    order = np.random.default_rng(1).permutation(len(examples))
    together = baseline.probabilities([examples[i] for i in order], features)
    for row, i in zip(together, order, strict=True):
        alone = baseline.probabilities([examples[i]], features)[0]
        torch.testing.assert_close(row, alone, atol=1e-5, rtol=1e-4)


@pytest.mark.parametrize("name", BASELINES.names())
def test_saved_weights_give_the_same_answers(name: str, scenes, folder, tmp_path) -> None:
    baseline, features = built(name, scenes, folder)
    baseline.save_pretrained(tmp_path / "saved")
    loaded = TrainedBaseline.from_pretrained(tmp_path / "saved", device="cpu")
    examples = examples_of(baseline, scenes)
    expected = baseline.probabilities(examples, features)
    assert torch.equal(loaded.probabilities(examples, features), expected)
    assert loaded.vocabulary == baseline.vocabulary
    assert (loaded.network.sizes, loaded.network.config) == (baseline.network.sizes, baseline.network.config)


@pytest.mark.parametrize("name", BASELINES.names())
def test_a_baseline_runs_where_its_weights_are(name: str, scenes, folder) -> None:
    baseline, features = built(name, scenes, folder)
    examples = examples_of(baseline, scenes)
    expected = baseline.probabilities(examples, features)
    with second_device() as device:
        moved = baseline.to(str(device))
        assert torch.allclose(moved.probabilities(examples, features), expected, atol=1e-4)
        batch = send_to_device(make_batch(examples, features, baseline.network.needs, CLEVRER), device)
        moved.network.train()
        moved.network(batch).logsumexp(1).sum().backward()


@pytest.mark.parametrize("name", BASELINES.names())
def test_a_baseline_trains_by_the_command_line(name: str, scenes, folder, tmp_path, capsys) -> None:
    write_questions(tmp_path / "questions.json", scenes)
    lines = ["system: " + name, f"model: {json.dumps(SMALL[name])}"]
    lines += [f"{of}: {tmp_path / 'questions.json'}" for of in ("questions", "validation")]
    if BASELINES[name].needs & set(KINDS):
        lines.append(f"features: {folder}")
    config = tmp_path / "training.yaml"
    config.write_text("\n".join(lines))
    run = ["--run-dir", str(tmp_path / "run"), "--loop.steps", "2", "--loop.batch-size", "8"]
    assert main(["train", "baseline", "--config", str(config), "--device", "cpu", *run]) == 0
    output = capsys.readouterr().out.splitlines()[0]
    trained = TrainedBaseline.from_pretrained(output, device="cpu")
    details = json.loads((tmp_path / "run" / "checkpoint" / "baseline.json").read_text())
    assert details["parameters"] == sum(p.numel() for p in trained.network.parameters())
    assert (details["videos"], details["validation_videos"]) == (6, 6)
    assert {"descriptive", "descriptive_count", "explanatory_per_option", "predictive_per_question"} <= set(
        details["metrics"]
    )


def test_an_experiment_scores_a_trained_baseline(scenes, folder, tmp_path, capsys) -> None:
    write_questions(tmp_path / "questions.json", scenes)
    training = {
        "system": "cnn_mlp",
        "questions": str(tmp_path / "questions.json"),
        "validation": str(tmp_path / "questions.json"),
        "features": str(folder),
    }
    training |= {"run_dir": str(tmp_path / "run"), "model": SMALL["cnn_mlp"], "loop": {"steps": 2, "device": "cpu"}}
    (tmp_path / "training.yaml").write_text(json.dumps(training))
    assert main(["train", "baseline", "--config", str(tmp_path / "training.yaml")]) == 0
    experiment = tmp_path / "table.yaml"
    row = {"name": "CNN+MLP", "trained": str(tmp_path / "run" / "checkpoint"), "features": str(folder)}
    common = {"questions": training["questions"], "data": "elsewhere", "source": "scenes", "programs": "gold"}

    def measured(row) -> dict:
        experiment.write_text(json.dumps({"title": "Table", "common": common, "rows": [row]}))
        assert main(["experiment", str(experiment), "-o", str(tmp_path / "results"), "--device", "cpu"]) == 0
        return json.loads((tmp_path / "results" / "table.json").read_text())["rows"][0]

    first = measured({**row, "limit": len(scenes) - 1})
    assert first["table"]["descriptive"]["n"] == 2 * (len(scenes) - 1)
    assert first["failed_questions"] == 0
    assert first["training"] | {"seed": 0, "videos": 6, "system": "cnn_mlp"} == first["training"]
    table = (tmp_path / "results" / "table.md").read_text()
    assert re.search(r"- CNN\+MLP: `.*/run/checkpoint`, [\d,]+ parameters, seed 0", table)
    assert ", 36 texts about 6 videos seen 0.4 times" in table
    assert measured({**row, "limit": len(scenes) - 1}) == first  # kept
    capsys.readouterr()
    for extra, message in (
        ({"set": ["stride=2"]}, "set would do nothing"),
        ({"programs": "parsed"}, "programs would do nothing"),
        ({"features": ""}, "needs features"),
        ({"trained": ""}, "give trained"),
    ):
        experiment.write_text(json.dumps({"title": "Table", "common": common, "rows": [{**row, **extra}]}))
        assert main(["experiment", str(experiment), "-o", str(tmp_path / "results"), "--device", "cpu"]) == 2
        assert message in capsys.readouterr().err


def test_a_run_is_not_resumed_on_other_questions(scenes, tmp_path) -> None:
    def train(listed) -> None:
        write_questions(tmp_path / "questions.json", listed)
        config = BaselineTraining(
            run_dir=str(tmp_path / "run"),
            system="lstm",
            questions=str(tmp_path / "questions.json"),
            validation=str(tmp_path / "questions.json"),
            model=SMALL["lstm"],
            loop=LoopConfig(steps=1, device="cpu"),
        )
        train_baseline(config)

    train(scenes)
    train(scenes)  # is done
    with pytest.raises(DataError, match=r"another configuration \(data: .* before, .* now\)"):
        train(scenes[:-2])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"system": "cnn"}, "system: expected one of lstm,.*, got 'cnn'"),
        ({"model": {"hiden": 3}}, "model: .*hiden"),
        ({"model": {"hidden": 0}}, "model: .*hidden"),
        ({"features": "somewhere"}, "would do nothing"),
        ({"recolor": True}, "recolor: lstm sees no video, it would do nothing"),
        ({"system": "cnn_mlp"}, "needs pooled"),
        ({"validation": ""}, "validation"),
    ],
)
def test_trainings_without_effect_or_sense_are_refused(changes, message: str) -> None:
    values = {"run_dir": "runs/none", "system": "lstm", "questions": "none.json", "validation": "none.json"}
    with pytest.raises(DataError, match=message):
        BaselineTraining(**{**values, **changes})


def test_features_must_fit_those_of_the_training(scenes, folder) -> None:
    baseline, _ = built("cnn_mlp", scenes, folder)
    with pytest.raises(DataError, match="needs features"):
        next(baseline.answer_questions(scenes, None))
    manifest = json.loads((folder / MANIFEST).read_text())
    manifest["features"]["weights_fingerprint"] = "others"
    (folder / MANIFEST).write_text(json.dumps(manifest))
    with pytest.raises(DataError, match="weights_fingerprint others in place of none"):
        next(baseline.answer_questions(scenes, FeatureCache(folder, ["pooled"])))
    blind, _ = built("lstm", scenes, folder)
    with pytest.raises(DataError, match="does not see the video"):
        next(blind.answer_questions(scenes, FeatureCache(folder, ["pooled"])))


def test_what_cannot_be_answered_counts_as_wrong_and_says_why(scenes, folder) -> None:
    baseline, features = built("cnn_mlp", scenes, folder)
    strange = replace(scenes[0].questions[0], text="Are there any pyramids?")
    missing = replace(scenes[1], scene_index=99)
    asked = [replace(scenes[0], questions=(strange, *scenes[0].questions[1:])), missing]
    report = score_answers(baseline.answer_questions(asked, features))
    errors = [r.get("error", "") for r in report.results]
    assert "pyramids" in errors[0]
    assert errors[1:4] == [""] * 3
    assert all("00099.safetensors" in error for error in errors[4:])
    assert report.errors == 5


def test_a_damaged_description_is_named(scenes, folder, tmp_path) -> None:
    baseline, _ = built("lstm", scenes, folder)
    baseline.save_pretrained(tmp_path)
    file = tmp_path / "baseline.json"
    description = json.loads(file.read_text())
    for change in ({"system": "gru"}, {"words": None}, {"answers": ["yes"]}, {"words": ["one"]}, {"features": 1}):
        file.write_text(json.dumps(description | change))
        with pytest.raises(CheckpointError, match=r"baseline\.json"):
            TrainedBaseline.from_checkpoint(tmp_path)


def test_places_that_no_video_of_a_batch_uses_are_left_out(scenes, folder) -> None:
    vocabulary = Vocabulary.from_questions(scenes, CLEVRER)
    examples = training_examples(scenes, vocabulary, {"objects"})
    features = FeatureCache(folder, {"objects"})
    batch = make_batch([of_video[0] for of_video in examples], features, {"objects"}, CLEVRER)
    assert batch.has_object is not None
    assert batch.objects is not None
    assert batch.has_object[:, :, -1].any()
    assert batch.objects.shape[:3] == batch.has_object.shape
    kept = [features.get(of_video[0].scene_index, {"objects"})["has_object"] for of_video in examples]
    assert batch.has_object.sum() == np.sum(kept)


def test_every_text_of_a_batch_is_one_of_few_videos(scenes, tmp_path) -> None:
    write_questions(tmp_path / "questions.json", scenes)
    path = str(tmp_path / "questions.json")
    config = BaselineTraining("run", "lstm", path, path, texts_per_video=3)
    task = BaselineTask(config)
    drawn = task.draw(12, np.random.default_rng(0), 0)
    assert len(drawn) == 12
    for i in range(0, 12, 3):
        assert len({example.scene_index for example in drawn[i : i + 3]}) == 1
        assert len({tuple(example.words) for example in drawn[i : i + 3]}) == 3
    batch = task.collate(drawn)
    assert set(task.trained.vocabulary.possible_answers()[batch.is_choice.long()].sum(1).tolist()) == {2, 4}


def test_plain_questions_are_learnt_first(scenes, tmp_path) -> None:
    path = str(tmp_path / "questions.json")
    config = BaselineTraining("run", "lstm", path, path, plain_steps=2)
    write_questions(path, scenes)
    with pytest.raises(DataError, match="plain_steps: expected fewer than the 1000 steps of the training, got 1000"):
        BaselineTraining("run", "lstm", path, path, plain_steps=1000)
    with pytest.raises(
        DataError, match=r"plain_steps needs questions of subtype 'plain' and others; .*plain-per-video"
    ):
        BaselineTask(config)
    first = scenes[0].questions[0]
    assert first.subtype is not None
    plain = replace(first, id=99, text="How many cubes are there?", subtype=PLAIN)
    write_questions(path, [replace(scenes[0], questions=(*scenes[0].questions, plain)), *scenes[1:]])
    task = BaselineTask(config)
    expected = task.trained.vocabulary.encode_text(plain, None)
    for step in range(4):
        for example in task.draw(40, np.random.default_rng(step), step):
            assert example.is_plain == (step < 2)
            assert (example.words == expected) == (step < 2)


@pytest.mark.parametrize("name", BASELINES.names())
def test_every_baseline_has_the_papers_settings_and_small_ones(name: str) -> None:
    folder = Path(__file__).parent.parent / "configs" / "baselines"
    paper = parse_config(BaselineTraining, ["--config", str(folder / f"{name}.yaml")], "baseline")
    small = parse_config(BaselineTraining, ["--config", str(folder / "small" / f"{name}.yaml")], "baseline")
    kind = BASELINES[name]
    assert (paper.system, small.system) == (name, name)
    assert paper.model_config() == kind.Config()
    assert set(paper.model) == {f.name for f in fields(kind.Config)}
    assert small.model_config() != kind.Config()
    assert paper.run_dir != small.run_dir
