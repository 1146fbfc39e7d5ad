"""The question generator: its questions, their answers, and the balance of a question set."""

import json
import math
import random
import re
from collections import Counter

import numpy as np
import pytest

from nsdr import DataError, Event, Executor, Scene, SceneObject
from nsdr.baselines import tag_options
from nsdr.baselines.q_type import PUBLISHED_Q_TYPE, q_type_answers, q_type_baselines, subtype_answers
from nsdr.clevrer.files.questions import Choice, Question, SceneQuestions, read_questions, without_answers
from nsdr.clevrer.files.scenes import scene_from_truth
from nsdr.cli.main import main
from nsdr.generate.physics.scene import simulate_scene
from nsdr.generate.questions.candidates import (
    descriptive_questions,
    family,
    form,
    is_negated,
    multiple_choice_questions,
)
from nsdr.generate.questions.selection import QuestionConfig, find_candidates, generate_questions, select_questions
from nsdr.generate.scene_files import truth_document
from nsdr.generate.statistics import RELEASED_QUESTIONS, count_questions
from nsdr.language.slots import Slot, with_filters
from nsdr.language.texts import clevrer
from nsdr.world.camera import Camera
from nsdr.world.vocabulary import CLEVRER
from nsdr.world.world import CLEVRER_WORLD

COLORS, MATERIALS, SHAPES = CLEVRER.words.values()


@pytest.fixture(scope="module")
def truths() -> list[dict]:
    scenes = [simulate_scene(seed) for seed in range(500500, 500509)]
    return [truth_document(scene, number, Camera()) for number, scene in enumerate(scenes)]


@pytest.fixture(scope="module")
def scenes(truths) -> list[tuple[int, str, Scene]]:
    return [(t["scene_index"], f"video_{t['scene_index']:05d}.mp4", scene_from_truth(t)) for t in truths]


@pytest.fixture(scope="module")
def many_candidates() -> list[SceneQuestions]:
    return [find_candidates(scene) for scene in many_scenes(60)]


@pytest.fixture(scope="module")
def generated(scenes):
    return list(generate_questions(scenes))


def test_generated_answers_agree_with_their_programs(scenes, generated) -> None:
    for (_, _, scene), questions in zip(scenes, generated, strict=True):
        executor = Executor(scene)
        for q in questions.questions:
            if q.type == "descriptive":
                assert executor.answer(q.program).text == q.answer
            for c in q.choices:
                assert executor.run([*c.program, *q.program]) is (c.answer == "correct")


def test_questions_follow_the_rules_of_the_release(scenes, generated) -> None:
    for (_, _, scene), questions in zip(scenes, generated, strict=True):
        assert [q.id for q in questions.questions] == list(range(len(questions.questions)))
        kinds = [q.type == "descriptive" for q in questions.questions]
        assert kinds == sorted(kinds, reverse=True)
        assert len({q.program for q in questions.questions if not q.choices}) == sum(kinds)
        for q in questions.questions:
            if q.subtype and q.subtype.startswith("query"):
                asked = CLEVRER.words[q.subtype.removeprefix("query_")]
                text = q.text.split(" when ")[0].split(" collide ")[0]
                assert not set(re.findall(r"\w+", text)) & set(asked)
            if q.type == "predictive":
                assert sorted(c.answer for c in q.choices) == ["correct", "wrong"]
            assert len(q.choices) <= 4
            assert len({c.program for c in q.choices}) == len(q.choices)
            if q.type == "explanatory":
                executor = Executor(scene)
                target = executor.run(q.program[1 : q.program.index("filter_ancestor")])
                for c in (c for c in q.choices if c.text.startswith("the presence of")):
                    assert executor.run(c.program) not in target.objects


def test_generation_is_deterministic(scenes) -> None:
    once, again = (list(generate_questions(scenes[:2])) for _ in range(2))
    assert once == again
    assert list(generate_questions(scenes[:2], QuestionConfig(seed=1))) != once


def test_plain_questions_are_about_objects_alone_and_follow_clevrers(scenes, generated) -> None:
    with_plain = list(generate_questions(scenes, QuestionConfig(plain_per_video=12)))
    endings = Counter()
    for (_, _, scene), before, found in zip(scenes, generated, with_plain, strict=True):
        plain = found.questions[len(before.questions) :]
        assert found.questions[: len(before.questions)] == before.questions
        assert 8 <= len({q.text for q in plain}) == len(plain) <= 12
        for q in plain:
            assert q.program is not None
            assert not {"events", "filter_in", "filter_out", "filter_collision"} & set(q.program)
            assert Executor(scene).answer(q.program).text == q.answer
            endings[q.program[-1]] += 1
    assert set(endings) == {"count", "exist", "query_color", "query_material", "query_shape"}


def test_scenes_with_partial_truth_get_fewer_types(small_scene) -> None:
    partial = Scene(small_scene.objects, 128, small_scene.visible, None, small_scene.events)
    types = {q.type for s in generate_questions([(0, "v", partial)] * 3) for q in s.questions}
    assert types == {"descriptive", "explanatory"}
    candidates = find_candidates((0, "v", partial))
    assert not {"filter_moving", "filter_stationary"} & {token for q in candidates.questions for token in q.program}


def test_all_families_of_the_release_are_asked(scenes) -> None:
    families = {family(q) for _, _, s in scenes for q in descriptive_questions(s, random.Random(0))}
    partner = "events objects unique filter_collision {} objects unique get_col_partner query_color"
    for known in (
        "events objects filter_collision count",
        "events events objects unique filter_in unique filter_after objects filter_in exist",
        "events events objects unique filter_in unique filter_before objects filter_collision count",
        "objects null filter_moving count",
        "objects end get_frame filter_stationary exist",
        "objects events objects unique filter_in unique get_frame filter_moving count",
        "objects start get_frame filter_stationary unique query_shape",
        *(
            partner.format(order)
            for order in ("unique", "first filter_order", "second filter_order", "last filter_order")
        ),
        "events objects filter_in last filter_order get_object query_material",
    ):
        assert known in families, known
    texts = [m for _, _, s in scenes for m in multiple_choice_questions(s, random.Random(0))]
    assert {(m.type, is_negated(m)) for m in texts} == {
        ("explanatory", False),
        ("explanatory", True),
        ("predictive", False),
        ("counterfactual", False),
        ("counterfactual", True),
    }
    kinds = {family(o) for m in texts if m.type == "explanatory" for o in m.choices}
    assert kinds == {
        "objects unique",
        "events objects unique filter_collision objects unique filter_collision unique",
        "events objects unique filter_in unique",
    }


def test_descriptions_are_unique_and_vary(small_scene) -> None:
    found = Counter(
        len(d.program) for d in descriptive_questions(small_scene, random.Random(0)) if "get_col_partner" in d.program
    )
    assert len(found) > 2  # one, two or three words
    counted = [d for d in descriptive_questions(small_scene, random.Random(0)) if d.subtype == "count"]
    assert any(d.answer == "0" for d in counted)


@pytest.mark.parametrize("missing", [0, 1])
def test_scenes_with_objects_of_most_classes_get_questions_too(missing: int) -> None:
    """24 objects leave no class by one or two words without an object, 23 leave one."""
    kinds = [(c, MATERIALS[(i + j) % 2], s) for i, c in enumerate(COLORS) for j, s in enumerate(SHAPES)]
    objects = tuple(SceneObject(i, *kind) for i, kind in enumerate(kinds[missing:]))
    scene = Scene(objects, 2, np.ones((len(objects), 2), bool), None, ())
    assert {d.subtype for d in descriptive_questions(scene, random.Random(0))} >= {"count", "exist"}


def many_scenes(n: int) -> list[tuple[int, str, Scene]]:
    """Random scenes with complete ground truth, made without simulation."""
    rng = random.Random(5)
    result = []
    for number in range(n):
        k = rng.choice([4, 5])
        triples = rng.sample([(c, m, s) for c in COLORS for m in MATERIALS for s in SHAPES], k)
        objects = tuple(SceneObject(i, *t) for i, t in enumerate(triples))
        visible, moving = np.ones((k, 128), bool), np.zeros((k, 128), bool)
        events = []
        for i in range(k):
            if rng.random() < 0.5:
                frame = rng.randrange(5, 60)
                visible[i, :frame] = False
                events.append(Event("in", frame, (i,)))
            if rng.random() < 0.6:
                moving[i, : rng.randrange(60, 140)] = True
        pairs = [(i, j) for i in range(k) for j in range(i + 1, k)]
        rng.shuffle(pairs)
        for pair in pairs[: rng.randrange(1, 4)]:
            events.append(Event("collision", rng.randrange(60, 127), pair))
        predicted = tuple(Event("collision", rng.randrange(128, 179), p) for p in pairs[3:5])
        without = {
            i: tuple(Event("collision", 100, p) for p in pairs if i not in p and rng.random() < 0.4) for i in range(k)
        }
        result.append((number, "v", Scene(objects, 128, visible, moving, tuple(events), predicted, without)))
    return result


@pytest.mark.robustness
def test_answers_are_balanced_within_each_type(many_candidates) -> None:
    questions = list(select_questions(many_candidates, QuestionConfig(), CLEVRER_WORLD))
    counts = count_questions(questions)
    assert abs(counts["answers, exist"]["yes"] - counts["answers, exist"]["no"]) <= 2
    colors = counts["answers, query_color"].values()
    assert len(colors) == 8
    assert max(colors) - min(colors) <= 3
    kinds = counts["questions by kind"]
    assert kinds["count"] == 240
    assert kinds["exist"] == 120
    rows = q_type_baselines(questions)["frequent"]
    published = PUBLISHED_Q_TYPE["frequent"]
    assert 100 * rows["descriptive"] == pytest.approx(published["descriptive"], abs=4)
    for kind in ("explanatory", "predictive", "counterfactual"):
        assert 100 * rows[kind][0] == pytest.approx(published[kind][0], abs=4)
    assert rows["predictive"] == (0.5, 0.0)


@pytest.mark.robustness
def test_the_form_of_a_question_does_not_tell_its_answer(many_candidates) -> None:
    answers: dict[tuple[str, str], Counter[str]] = {}
    for scene in select_questions(many_candidates, QuestionConfig(), CLEVRER_WORLD):
        for q in (q for q in scene.questions if q.type == "descriptive"):
            answers.setdefault((q.subtype, form(q)), Counter())[q.answer] += 1
    for subtype, n_answers in {"count": 4, "exist": 2, "query_color": 8, "query_shape": 3, "query_material": 2}.items():
        forms = [counts for (of, _), counts in answers.items() if of == subtype and counts.total() > 2]
        n = sum(counts.total() for counts in forms)
        guessed = sum(counts.most_common(1)[0][1] for counts in forms) / n
        even = sum(math.ceil(counts.total() / n_answers) for counts in forms) / n
        assert guessed < even + 0.05, subtype


@pytest.mark.robustness
def test_not_says_nothing_about_how_many_options_are_correct(many_candidates) -> None:
    numbers: dict[bool, Counter[int]] = {False: Counter(), True: Counter()}
    for scene in select_questions(many_candidates, QuestionConfig({"explanatory": 1.68}), CLEVRER_WORLD):
        for q in scene.questions:
            numbers["negate" in q.program][sum(c.answer == "correct" for c in q.choices)] += 1
    affirmative, negated = (numbers[form] for form in (False, True))
    assert min(affirmative.total(), negated.total()) > 40
    for n in range(5):
        shares = affirmative[n] / affirmative.total(), negated[n] / negated.total()
        assert shares[0] == pytest.approx(shares[1], abs=0.05)


def test_generated_options_have_the_tags_of_their_true_scene(scenes, generated) -> None:
    tags = {c.tag for s in generated for q in s.questions if q.type == "counterfactual" for c in q.choices}
    assert tags == {"observational", "inferential"}
    for (_, _, scene), questions in zip(scenes, generated, strict=True):
        assert tag_options(questions, scene) == questions
        others = [c.tag for q in questions.questions if q.type != "counterfactual" for c in q.choices]
        assert set(others) <= {None}


def test_test_questions_carry_no_tags(generated) -> None:
    public = [c for s in generated for q in without_answers(s).questions for c in q.choices]
    assert {c.tag for c in public} == {None}


def test_the_statistics_count_tagged_options(generated) -> None:
    counts = count_questions(generated)
    tagged = counts["counterfactual options by tag"]
    assert sum(tagged.values()) == sum(
        len(q.choices) for s in generated for q in s.questions if q.type == "counterfactual"
    )
    assert sum(counts["inferential options by answer"].values()) == tagged["inferential"]


def question(kind: str, answer: str | None, options: tuple[str, ...] = ()) -> Question:
    """A question of a type or, with an answer, a descriptive one of a subtype."""
    choices = tuple(Choice(i, f"option {i}", None, option) for i, option in enumerate(options))
    return Question(0, f"A {kind} question?", kind if options else "descriptive", kind, None, answer, choices)


def asked(*questions: Question) -> list[SceneQuestions]:
    return [SceneQuestions(i, "v.mp4", (q,)) for i, q in enumerate(questions)]


def test_random_answers_are_uniform_over_the_answers_of_the_question_type() -> None:
    """However often each answer is right: all of these questions have the same one."""
    counts = asked(*[question("count", "1")] * 3000)
    assert q_type_baselines(counts)["random"]["descriptive"] == pytest.approx(1 / 6, abs=0.03)
    colors = asked(*[question("query_color", "red")] * 3000)
    assert q_type_baselines(colors)["random"]["descriptive"] == pytest.approx(1 / 8, abs=0.03)
    options = asked(*[question("predictive", None, ("correct", "correct"))] * 3000)
    per_option, per_question = q_type_baselines(options)["random"]["predictive"]
    assert per_option == pytest.approx(1 / 2, abs=0.03)
    assert per_question == pytest.approx(1 / 4, abs=0.03)


def test_uniform_answers_to_the_releases_questions_are_as_often_right_as_published() -> None:
    kinds = RELEASED_QUESTIONS["questions by kind"]
    possible = subtype_answers(CLEVRER_WORLD)
    total = sum(kinds[name] for name in possible)
    expected = sum(kinds[name] / len(answers) for name, answers in possible.items()) / total
    assert 100 * expected == pytest.approx(29.02, abs=0.01)
    assert 100 * expected == pytest.approx(PUBLISHED_Q_TYPE["random"]["descriptive"], abs=0.3)


def test_frequent_answers_are_those_of_the_training_set() -> None:
    scenes = asked(*[question("exist", "yes")] * 3, question("explanatory", None, ("correct", "correct", "wrong")))
    training = asked(
        *[question("exist", "no")] * 2,
        question("exist", "yes"),
        question("explanatory", None, ("correct", "correct")),
        question("explanatory", None, ("wrong", "wrong", "wrong")),
        question("predictive", None, ("correct", "wrong")),
        *[question("plain", "yes")] * 5,  # of the curriculum, not of the data set
    )
    assert q_type_baselines(scenes)["frequent"] == {"descriptive": 1.0, "explanatory": (2 / 3, 0.0)}
    assert q_type_baselines(scenes, training=training)["frequent"] == {"descriptive": 0.0, "explanatory": (1 / 3, 0.0)}


def test_q_type_baselines_refuse_what_they_cannot_answer() -> None:
    scenes = asked(question("exist", "yes"))
    with pytest.raises(DataError, match="name: expected one of random, frequent, got zebra"):
        next(q_type_answers(scenes, "zebra"))
    with pytest.raises(DataError, match="training questions have no 'exist', which is to be answered"):
        q_type_baselines(scenes, training=asked(question("count", "1")))
    with pytest.raises(DataError, match=r"'A exist question\?' has no answer"):
        q_type_baselines(scenes, training=asked(question("exist", None)))
    with pytest.raises(DataError, match="has the subtype size; expected one of count, exist"):
        q_type_baselines(asked(question("size", "1")))


def test_questions_without_answers_have_no_programs_either(generated) -> None:
    blank = [without_answers(s) for s in generated]
    assert all(q.program is None and q.answer is None for s in blank for q in s.questions)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"per_video": {"riddle": 1.0}}, "count.*per_video`"),
        ({"max_options": 1}, r"max_options"),
        ({"max_options": 27}, r"max_options"),
    ],
)
def test_invalid_question_options_are_rejected(values, message) -> None:
    with pytest.raises(DataError, match=message):
        QuestionConfig(**values)


def test_question_command_writes_file_and_statistics(truths, tmp_path, capsys) -> None:
    folder = tmp_path / "truth"
    folder.mkdir()
    for truth in truths[:3]:
        (folder / f"truth_{truth['scene_index']:05d}.json").write_text(json.dumps(truth))
    output = tmp_path / "questions.json"
    assert main(["generate", "questions", "--scenes", str(folder), "-o", str(output), "--workers", "1"]) == 0
    scenes = read_questions(output)
    assert [s.scene_index for s in scenes] == [0, 1, 2]
    text = (tmp_path / "questions.statistics.md").read_text()
    assert "Q-type (frequent), as published | 33.0 | 50.2/16.5 |" in text
    assert "## Counterfactual options by tag (%)" in text
    assert any(c.tag for s in scenes for q in s.questions for c in q.choices)
    assert main(["generate", "questions", "--scenes", str(tmp_path / "no"), "-o", str(output)]) == 2
    assert "no such file or folder" in capsys.readouterr().err
    (tmp_path / "empty").mkdir()
    assert main(["generate", "questions", "--scenes", str(tmp_path / "empty"), "-o", str(output)]) == 2
    assert "holds no truth_*.json" in capsys.readouterr().err


def test_the_grammar_enumerates_every_meaning_once() -> None:
    class TwoWords:
        def words(self, choose, use, without):
            return choose.pick([("red",), ("blue", "cube")])

    texts = [text for text, _ in clevrer(CLEVRER).every("PRESENCE", TwoWords(), random.Random(0))]
    assert texts == ["the presence of the red object", "the presence of the blue cube"]
    programs = [tuple(p) for _, p in clevrer(CLEVRER).every("COUNTERFACTUAL", TwoWords(), random.Random(0))]
    assert len(programs) == len(set(programs)) == 4
    spheres = Slot("NS", ("metal", "sphere"))
    assert spheres.text(CLEVRER) == "metal spheres"
    assert with_filters([spheres], CLEVRER) == ["metal", "filter_material", "sphere", "filter_shape"]
