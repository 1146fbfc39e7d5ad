"""Questions, answers and programs in the words of another world, from the generator to the executor."""

import json
import random
import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from msgspec import structs

import nsdr
from nsdr import CLEVRER, CheckpointError, Executor, QuestionParser, Scene, narrate, verify
from nsdr.baselines.features.extraction import WordExtraction, annotation_features, extract_features
from nsdr.baselines.features.files import WordConfig
from nsdr.baselines.q_type import SUBTYPES, q_type_answers, subtype_answers
from nsdr.baselines.systems.program_graph import instructions
from nsdr.baselines.trained import TrainedBaseline
from nsdr.claims.reading import read_sentence, written
from nsdr.claims.statements import ObjectPhrase, Statement
from nsdr.clevrer import (
    prompt,
    read_questions,
    read_response,
    scene_from_annotation,
    scene_from_truth,
    solution,
    write_responses,
)
from nsdr.clevrer.answers.answer_forms import read_candidate
from nsdr.clevrer.files.annotations import read_truth_file
from nsdr.clevrer.files.questions import PLAIN, Question, SceneQuestions, write_questions
from nsdr.cli.main import main
from nsdr.errors import DataError
from nsdr.evaluation import EvaluationConfig, run_evaluation
from nsdr.evaluation.baselines import evaluate_baseline
from nsdr.evaluation.responses import score_responses
from nsdr.generate.dataset import DatasetConfig, generate_dataset
from nsdr.generate.export.formats import FORMATS, Sample
from nsdr.generate.questions.candidates import (
    EXTENSION_KINDS,
    descriptive_questions,
    multiple_choice_questions,
    plain_questions,
)
from nsdr.generate.questions.selection import QuestionConfig, world_of
from nsdr.io.files import write_json
from nsdr.io.reading import read_json
from nsdr.io.worlds import read_world, store_world, stored_world
from nsdr.question_parser.base import read_programs
from nsdr.question_parser.grammar import GrammarParser, readings
from nsdr.question_parser.language_model import NO_PROGRAM, examples
from nsdr.question_parser.loading import load_parser
from nsdr.question_parser.tokenizer import decoder_tokens
from nsdr.symbolic.reference import reference_page
from nsdr.training.baselines import BaselineTask, BaselineTraining
from nsdr.training.question_parser import main as train_question_parser
from nsdr.world.world import CLEVRER_WORLD, World

from .test_other_worlds import DISCS
from .test_vocabularies import ALIEN

ALIEN_WORLD = World("alien", vocabulary=ALIEN)


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    questions = QuestionConfig(extensions=True, changed_per_video=1, plain_per_video=4)
    folder, splits = tmp_path_factory.mktemp("words") / "discs", {"train": 0.75, "test": 0.25}
    return generate_dataset(
        DatasetConfig(
            str(folder), 8, 3, splits=splits, renderer="none", masks=False, questions=questions, world=DISCS, workers=1
        )
    )


def asked(root: Path) -> Iterator[tuple[Scene, Question]]:
    """The questions of the training split, with the true scenes."""
    for listed in CLEVRER(root).split("train").questions():
        scene = scene_from_truth(read_truth_file(root / f"truth/train/truth_{listed.scene_index:05d}.json"))
        yield from ((scene, question) for question in listed.questions)


def test_a_data_set_and_its_question_files_know_their_world(root: Path) -> None:
    data = CLEVRER(root)
    assert data.world == data.split("train").world == DISCS
    assert data.split("train").n_frames == 60
    assert read_questions(root / "questions/train.json") == data.split("train").questions()
    assert CLEVRER_WORLD.vocabulary.attributes.keys().isdisjoint(
        word for _, q in asked(root) for word in (*(q.program or ()), *q.text.split(), str(q.answer))
    )
    with pytest.raises(
        DataError,
        match=r"expected 0 to 32, .* or an attribute word of the world CLEVRER, got '(orange|white|teal)'",
    ):
        read_questions(root / "questions/train.json", CLEVRER_WORLD)


def test_all_questions_are_read_as_their_programs(root: Path) -> None:
    parser = GrammarParser(extensions=True, vocabulary=DISCS.vocabulary)
    for _, q in asked(root):
        kind = "multiple_choice" if q.choices else "descriptive"
        assert parser.parse(q.text, kind).tokens == q.program
        for choice in q.choices:
            assert parser.parse(choice.text, "choice").tokens == choice.program


def test_true_scenes_give_all_answers(root: Path) -> None:
    kinds = set()
    for scene, q in asked(root):
        if "get_changed" in (q.program or ()):  # simulated for the question file
            continue
        kinds.add(q.subtype or q.type)
        if q.choices:
            answer = Executor(scene).answer_choices(q.program or (), [(c.text, c.program or ()) for c in q.choices])
            assert [c.answer for c in answer.choices] == [c.answer for c in q.choices]
        else:
            assert Executor(scene).answer(q.program or ()).text == q.answer
    assert kinds >= {"count", "exist", "query_color", "query_shape", "explanatory", "counterfactual", "speed", PLAIN}


def test_annotations_answer_what_is_asked_about_the_video(root: Path) -> None:
    split, parser = CLEVRER(root).split("train"), GrammarParser(vocabulary=DISCS.vocabulary)
    n = 0
    for listed in split.questions():
        scene = scene_from_annotation(split.annotation(listed.scene_index))
        for q in listed.questions:
            if q.subtype in ("count", "exist", "query_color", "query_material", "query_shape"):
                assert Executor(scene).answer(parser.parse(q.text)).text == q.answer
                n += 1
    assert n > 30


def test_counts_and_words_of_answers_are_the_worlds() -> None:
    assert subtype_answers(CLEVRER_WORLD)["count"] == tuple("012345")
    assert subtype_answers(DISCS) == {
        "count": tuple("0123"),
        "exist": ("yes", "no"),
        "query_color": ("orange", "white", "teal"),
        "query_material": ("wood", "steel"),
        "query_shape": ("disc", "coin", "brick"),
    }


def test_statistics_and_baselines_by_type_are_of_the_world(root: Path) -> None:
    text = (root / "questions/train.statistics.md").read_text()
    assert "disc" in text
    assert not [part for part in ("release", "published") if part in text + (root / "statistics.md").read_text()]
    listed = CLEVRER(root).split("train").questions()
    drawn = {
        a.text for _, given in q_type_answers(_clevrer_kinds(listed), "random", world=DISCS) for a in given.values()
    }
    assert drawn & {"disc", "coin", "brick", "orange", "white", "teal"}
    assert not drawn & CLEVRER_WORLD.vocabulary.attributes.keys()


def _clevrer_kinds(listed: Sequence[SceneQuestions]) -> list[SceneQuestions]:
    return [
        structs.replace(s, questions=tuple(q for q in s.questions if q.choices or q.subtype in subtype_answers(DISCS)))
        for s in listed
    ]


def test_questions_of_two_worlds_are_not_mixed(root: Path, tmp_path: Path, capsys, example_scene) -> None:
    (scene, _), *_ = asked(root)
    with pytest.raises(DataError, match="worlds discs, CLEVRER, which have different words"):
        world_of([scene, example_scene])


def test_question_files_outside_their_data_set_are_of_a_world_that_is_beside_them_or_given(
    root: Path, tmp_path: Path, capsys
) -> None:
    written, file = tmp_path / "written/q.json", tmp_path / "q.json"
    assert main(["generate", "questions", "--scenes", str(root / "truth"), "--output", str(written)]) == 0
    listed = read_questions(written)
    assert read_world(written.parent / "world.json") == DISCS
    file.write_bytes(written.read_bytes())
    with pytest.raises(DataError, match=r"an attribute word of the world CLEVRER, got .*; if .* put its world\.json"):
        read_questions(file)
    assert read_questions(file, written.parent / "world.json") == read_questions(file, DISCS) == listed

    answers = tmp_path / "answers.jsonl"
    write_responses(answers, (((s.scene_index, q.id), solution(q)) for s in listed for q in s.questions))
    capsys.readouterr()
    score = ["score", str(answers), "--questions"]
    assert main([*score, str(written)]) == 0
    first = capsys.readouterr().out
    assert main([*score, str(file), "--world", str(written.parent / "world.json")]) == 0
    assert capsys.readouterr().out == first
    assert "cannot be read" not in first
    assert main([*score, str(file)]) != 0
    assert "--world" in capsys.readouterr().err

    about = {"source": "truth", "data": str(root / "truth/train"), "types": ["descriptive"], "limit": 2, "workers": 1}
    config = EvaluationConfig(str(file), cache=str(tmp_path / "cache"), **about)
    assert config.world == DISCS
    assert run_evaluation(config)["descriptive"]["accuracy"] == 1
    other = tmp_path / "scenes"
    other.mkdir()
    assert EvaluationConfig(str(file), data=str(other)).world == CLEVRER_WORLD
    about_weights = {"part": "collisions", "config": {}, **stored_world(DISCS)}
    write_json(tmp_path / "weights/collisions.json", about_weights)
    assert EvaluationConfig(str(file), data=str(other), checkpoint=str(tmp_path / "weights")).world == DISCS


def test_question_files_are_not_written_beside_another_world(root: Path, tmp_path: Path, capsys) -> None:
    store_world(tmp_path, ALIEN_WORLD)
    scenes = ["--scenes", str(root / "truth"), "--output"]
    assert main(["generate", "questions", *scenes, str(tmp_path / "q.json")]) != 0
    assert "is of the world alien, which has other words than discs" in capsys.readouterr().err
    assert main(["generate", "questions", *scenes, str(root / "questions/again.json")]) == 0
    assert not (root / "questions/world.json").exists()
    assert read_questions(root / "questions/again.json")


def test_responses_are_read_and_scored_in_the_worlds_words(root: Path) -> None:
    listed = CLEVRER(root).split("train").questions()
    right = {(s.scene_index, q.id): solution(q) for s in listed for q in s.questions}
    report = score_responses(listed, right, world=DISCS)
    assert report["descriptive"]["accuracy"] == 1
    assert not report.responses["unread"]


def test_prompts_have_examples_in_the_words_and_are_passed_over_in_responses() -> None:
    world, said = ALIEN_WORLD, Question(0, "What color is it?", "descriptive", "query_color", None, "teal")
    text = prompt(said, world)
    assert text.endswith("such as <answer>amber</answer>.")
    assert "<answer>amber ceramic loaf</answer>" in prompt(Question(0, "?", "descriptive", "faster"), world)
    assert read_response(text, world=world).answer is None
    sample = Sample(said, "train", 0, "video.mp4", world=world)
    assert (
        FORMATS["verl"].row(sample)["data_source"]
        == FORMATS["video_r1"].row(sample)["data_source"]
        == world.name.lower()
    )
    (asked, _) = FORMATS["chat"].row(sample)["messages"]
    assert asked["content"][1]["text"] == text
    assert "red" not in text


def test_prompts_and_responses_take_a_world_by_its_file_or_name(tmp_path: Path) -> None:
    store_world(tmp_path, ALIEN_WORLD)
    file, said = tmp_path / "world.json", Question(0, "What color is it?", "descriptive", "query_color")
    assert prompt(said, world=file) == prompt(said, world=ALIEN_WORLD) != prompt(said)
    assert read_response("<answer>bun</answer>", world=str(file)).answer == "loaf"
    assert read_response("<answer>puck</answer>", world="pucks").answer == "puck"
    assert read_response("<answer>puck</answer>").answer is None


@pytest.mark.parametrize(
    ("text", "answer"),
    [
        ("Answer: aqua.", "teal"),
        ("They are loaves", "loaf"),
        ("a pearl", "bead"),
        ("It is porcelain", "ceramic"),
        ("It is the amber ceramic loaf.", "amber ceramic loaf"),
        ("red", None),
        ("amber or ivory", None),
        ("20", "20"),
    ],
)
def test_responses_in_another_vocabulary(text: str, answer: str | None) -> None:
    assert read_response(text, world=ALIEN_WORLD).answer == answer


def test_letters_beside_the_words_of_a_vocabulary() -> None:
    options = ("it enters", "it exits")
    assert read_response("A\nA loaf is there.", options, ALIEN_WORLD).answer == {"A"}
    assert read_response("B\nA cube is there.", options, ALIEN_WORLD).answer is None
    assert read_response("B\nA loaf is there.", options, ALIEN_WORLD).answer == {"B"}


def test_candidates_are_read_in_the_scenes_words(root: Path) -> None:
    assert read_candidate("The bun is stationary.", "direction", "left", ALIEN) == "stationary"
    scene, _ = next(asked(root))
    shown = scene.objects[0]
    program = ["objects", *(t for n in ("color", "shape") for t in (getattr(shown, n), f"filter_{n}"))]
    answer = Executor(scene).answer([*program, "unique", "query_material"], candidates=["wood", "steel", "metal"])
    assert [c.answer for c in answer.choices] == [
        "correct" if shown.material == "wood" else "wrong",
        "correct" if shown.material == "steel" else "wrong",
        None,
    ]
    assert "expected one material: wood, steel" in answer.choices[2].error


def test_a_pipeline_of_another_world_reads_the_words_of_the_scene(
    root: Path, tmp_path: Path, capsys, example_scene
) -> None:
    pipeline = nsdr.Pipeline.from_pretrained(config=nsdr.PipelineConfig(extensions=True), device="cpu")
    scene, question = next((scene, q) for scene, q in asked(root) if q.type == "descriptive")
    assert pipeline.answer(scene, question.text).text == question.answer
    assert pipeline.question_parser.vocabulary == CLEVRER_WORLD.vocabulary
    shown = scene.objects[0]
    named = f"events objects {shown.shape} filter_shape {shown.color} filter_color filter_collision count"
    assert pipeline.answer(scene, program=named).text == pipeline.answer(scene, named).text
    choices = f"The {shown.name} and the {scene.objects[1].name} collide", "The red cube and the blue sphere collide"
    told = pipeline.answer(scene, "Which event will happen next?", choices)
    assert [bool(c.error) for c in told.choices] == [False, True]
    with pytest.raises(nsdr.QuestionError, match="the nearest questions: How many") as refused:
        pipeline.answer(scene, "How many cubes are there?")
    assert "cube" not in "".join(refused.value.nearest)
    saved = tmp_path / "scene.json"
    nsdr.save(saved, scene)
    assert main(["answer", str(saved), question.text, "--json"]) == 0
    assert str(json.loads(capsys.readouterr().out)["answer"]) == question.answer
    of_discs = GrammarParser(vocabulary=DISCS.vocabulary)
    parsed, _ = read_programs(of_discs, "How many red cubes are there?", scene=example_scene)
    assert parsed.tokens == ("objects", "red", "filter_color", "cube", "filter_shape", "count")


def test_a_parser_that_only_knows_the_words_of_another_world_refuses_the_scene(root: Path) -> None:
    scene, _ = next(asked(root))
    both = r"of the world discs, and QuestionParser only reads the words of the world CLEVRER; .* \(--checkpoint\).* grammar"
    networks = load_parser("network", device="cpu")
    with pytest.raises(DataError, match=both):
        read_programs(networks, "How many orange coins are there?", scene=scene)
    parsed, _ = read_programs(networks, "objects orange filter_color count", scene=scene)
    assert parsed.tokens == ("objects", "orange", "filter_color", "count")


def test_networks_are_trained_on_the_words_of_a_data_set_and_refused_for_others(root: Path, tmp_path: Path) -> None:
    run = tmp_path / "run"
    small = ["--run-dir", str(run), "--questions", str(root / "questions/train.json"), "--steps", "2"]
    small += ["--batch-size", "4", "--evaluation-texts", "4", "--model.embedding", "8", "--model.hidden", "8"]
    folder = train_question_parser(small)
    parser = QuestionParser.from_checkpoint(folder)
    assert parser.world == DISCS
    assert {"orange", "wood", "coin"} <= set(decoder_tokens(DISCS.vocabulary)) - set(
        decoder_tokens(CLEVRER_WORLD.vocabulary)
    )
    found, _ = parser.candidates(["How many orange coins are there?"])[0]
    assert set(found) <= set(decoder_tokens(DISCS.vocabulary))
    with pytest.raises(
        CheckpointError, match=r"other program tokens \(orange, white, teal, wood, steel, disc, coin, brick\)"
    ):
        QuestionParser.from_checkpoint(folder, CLEVRER_WORLD.vocabulary)
    with pytest.raises(CheckpointError, match=r"other program tokens .*give the weights of this world"):
        load_parser("network", vocabulary=DISCS.vocabulary)
    parser.save_pretrained(tmp_path / "saved")
    again = QuestionParser.from_pretrained(tmp_path / "saved", device="cpu")
    assert again.world == DISCS
    assert again.candidates(["How many orange coins are there?"])[0][0] == found
    irregular = replace(
        DISCS.vocabulary, shapes=(replace(DISCS.vocabulary.shapes[0], plural="dixes"), *DISCS.vocabulary.shapes[1:])
    )
    with pytest.raises(CheckpointError, match="words: expected those of the world, such as dixes"):
        QuestionParser.from_checkpoint(folder, irregular)


@pytest.mark.parametrize("vocabulary", [ALIEN, DISCS.vocabulary], ids=["alien", "discs"])
def test_a_language_model_is_shown_examples_in_the_words_of_the_vocabulary(vocabulary) -> None:
    clevrer = CLEVRER_WORLD.vocabulary
    for kind, texts in examples(vocabulary).items():
        for text, program in texts.items():
            if program != NO_PROGRAM:
                assert readings(text, kind, vocabulary) == [program.split()]
            assert not {*clevrer.attributes, *clevrer.nouns}.intersection(text.split()) - {"object", "objects"}
    assert "- color: `" in reference_page(vocabulary)
    assert "`metal`" not in reference_page(vocabulary)
    assert examples(clevrer)["choice"]["The red sphere turns blue"] == NO_PROGRAM


def test_data_sets_are_evaluated_in_their_words(root: Path) -> None:
    files = {"questions": str(root / "questions/train.json"), "data": str(root / "truth/train")}
    report = run_evaluation(EvaluationConfig(**files, source="truth", types=("descriptive", "explanatory")))
    assert report["explanatory"]["per_question"] == 1
    assert all(row["accuracy"] == 1 for name, row in report["descriptive"]["subtypes"].items() if name in SUBTYPES)


def test_a_baseline_that_learnt_other_words_is_refused_once(root: Path) -> None:
    config = EvaluationConfig(root=str(root), split="train")
    with pytest.raises(
        DataError, match=r"in the words of the world discs, such as white wood disc, and .* such as red metal"
    ):
        evaluate_baseline("baselines/truth/mac", "", config, (), "cpu")


@pytest.mark.parametrize("source", ["videos", "proposals", "tracks"])
def test_weights_of_another_world_are_refused_once(root: Path, source, capsys, tmp_path) -> None:
    questions = str(root / "questions/train.json")
    assert main(["evaluate", "--questions", questions, "--data", str(tmp_path), "--source", source]) == 2
    said = f"error: {questions}: was made in the world {CLEVRER(root).world.name}, and default is for CLEVRER, which has other"
    out, err = capsys.readouterr()
    assert (out, err.count("which has other")) == ("", 1)
    assert err.startswith(said)
    assert "give weights for" in err


def test_data_of_which_nothing_says_the_world_are_taken_for_the_weights(root: Path, tmp_path) -> None:
    questions = tmp_path / "train.json"
    questions.write_bytes((root / "questions/train.json").read_bytes())
    config = EvaluationConfig(questions=str(questions), data=str(tmp_path), source="proposals", checkpoint="pucks")
    assert config.world == read_world("pucks")
    with pytest.raises(DataError, match="or an attribute word of the world pucks, got 'teal'"):
        run_evaluation(config)


def test_nothing_is_asked_whose_answer_the_vocabulary_knows() -> None:
    clay = read_world("clevrer").vocabulary.materials[:1]
    world = World("clay", replace(CLEVRER_WORLD.vocabulary, materials=(replace(clay[0], word="clay", synonyms=()),)))
    objects = ["red clay cube", "blue clay cube", "red clay sphere", "green clay cylinder"]
    scene = Scene.of(objects, [("collision", 30, "red cube", "blue cube"), ("in", 10, "red sphere")], world=world)
    rng = random.Random(0)
    asked = [
        *descriptive_questions(scene, rng),
        *multiple_choice_questions(scene, rng),
        *plain_questions(scene, rng, 50),
    ]
    assert {q.subtype for q in asked if q.subtype != PLAIN} > {"query_color", "query_shape", "count", "exist"}
    texts = [text for q in asked for text in (q.text, *(c.text for c in q.choices))]
    assert len(texts) > 100
    assert not [text for text in texts if "clay" in text or "material" in text]


@pytest.mark.parametrize("length", ["short", "long"])
def test_answers_are_told_in_claims_that_hold(root: Path, length) -> None:
    told = 0
    for scene, q in asked(root):
        if q.subtype in EXTENSION_KINDS or "get_changed" in (q.program or ()):
            continue
        executor, program = Executor(scene), q.program or ()
        choices = [(c.text, c.program or ()) for c in q.choices]
        answer = executor.answer_choices(program, choices) if choices else executor.answer(program)
        text = narrate(answer, scene, length)
        found = verify(text, scene)
        assert all(claim.holds for claim in found.claims), text
        assert len(found.claims) >= len(text.splitlines()) - 1
        assert CLEVRER_WORLD.vocabulary.attributes.keys().isdisjoint(re.findall(r"\w+", text))
        told += len(found.claims)
    assert told > 100


def test_claims_are_read_in_the_words_and_the_frame_rate_of_the_scene(root: Path) -> None:
    scene, _ = next(asked(root))
    shown = scene.objects[0]
    said = f"There is an {shown.color} thing. The {shown.name} is made of {shown.material}."
    assert [c.holds for c in verify(said, scene).claims] == [True, True]
    assert not verify("There is a red cube.", scene).claims
    (counted,) = read_sentence("there are two crimson buns", 59, ALIEN, 15)
    assert counted.objects[0].words == ("crimson", "loaf")
    (seen,) = read_sentence("at 2 s the amber pearl enters", 59, ALIEN, 15)
    assert (seen.events[0].frame, seen.events[0].objects[0].words) == (30, ("amber", "bead"))
    assert written(Statement("presence", objects=(ObjectPhrase("", ("amber", "loaf"), False),), number=2), ALIEN) == (
        "There are 2 amber loaves."
    )


def test_baselines_learn_from_the_words_of_a_world(root: Path, tmp_path: Path, capsys) -> None:
    out = tmp_path / "features"
    sizes = WordConfig(frames=4, grid=(4, 6), pooled_grid=(2, 3), max_objects=4)
    extract_features(WordExtraction(str(root), str(out), workers=1, features=sizes))
    made = read_json(out / "features.json")
    assert made["features"]["shapes"] == ["disc", "coin", "brick"]
    assert made["shapes"]["maps"] == [4, 8 + 4, 4, 6]
    listed = _clevrer_kinds(CLEVRER(root).split("train").questions())
    questions = str(root / "questions/of_clevrer.json")
    write_questions(questions, [structs.replace(s, questions=s.questions[:8]) for s in listed])
    settings = {"features": str(out), "recolor": True, "model": {"width": 8, "frames": 3, "projection": 8, "hidden": 8}}
    task = BaselineTask(BaselineTraining("run", "iep", questions, questions, **settings))
    batch = task.collate(task.draw(6, np.random.default_rng(0), 0))
    assert task.model(batch.inputs).isfinite().all()
    assert "filter_color_orange" in {name.replace(" ", "_") for name in instructions(DISCS.vocabulary)}
    assert len(task.recoloring.draw(np.random.default_rng(0))) == 3
    task.trained.save_pretrained(tmp_path / "saved")
    again = TrainedBaseline.from_checkpoint(tmp_path / "saved")
    assert again.vocabulary == task.trained.vocabulary
    assert again.vocabulary.objects == DISCS.vocabulary
    annotation = next((root / "annotations").rglob("annotation_*.json"))
    asked = ["answer", str(annotation), "--system", str(tmp_path / "saved"), "--device", "cpu", "--json"]
    capsys.readouterr()
    assert main([*asked, listed[0].questions[0].text]) == 0
    assert tuple(json.loads(capsys.readouterr().out)["program"]) == listed[0].questions[0].program
    with pytest.raises(DataError, match=r"words of the world discs .*; the features are of gray, red"):
        annotation_features(annotation, sizes)
