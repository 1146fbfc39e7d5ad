"""The nearest well-formed questions to texts that were refused."""

from dataclasses import replace
from functools import partial

import pytest

from nsdr import Executor, QuestionError, Scene
from nsdr.errors import EndpointError
from nsdr.pipeline import Pipeline
from nsdr.question_parser.grammar import GrammarParser
from nsdr.question_parser.suggestions import QUESTION_KINDS, intervention_hint, nearest_questions
from nsdr.world.vocabulary import CLEVRER

suggestions = partial(nearest_questions, vocabulary=CLEVRER)


@pytest.fixture(scope="module")
def parser() -> GrammarParser:
    return GrammarParser()


@pytest.mark.parametrize(
    ("text", "kind", "nearest"),
    [
        ("How many zebras leave?", "descriptive", "How many cubes exit the scene?"),
        ("What colour is the thing that hits the green thing?", "descriptive",
         "What color is the object to collide with the green object?"),
        ("What if the blue ball had been red?", "multiple_choice", "the blue sphere"),
        ("The metal box bumped the green barrel", "choice", "The metal cube and the green object collide"),
    ],
)  # fmt: skip
def test_nearest_without_a_scene(text: str, kind: str, nearest: str) -> None:
    found = suggestions(text, None, kind)
    assert len(found) == len(set(found)) == 3
    assert any(nearest in candidate for candidate in found), found
    assert found == suggestions(text, None, kind)


@pytest.mark.parametrize(
    ("text", "kind", "nearest"),
    [
        ("What will happen if the red cube and the blue sphere are removed?", "multiple_choice", "the red cube"),
        ("Which events would occur if the ball were pushed?", "multiple_choice", "the sphere"),
        ("What is the reason that the red cube and the green ball did not crash?", "multiple_choice", "responsible"),
        ("How many of the cubes are stacked?", "descriptive", "How many cubes"),
    ],
)
def test_the_nearest_questions_are_of_the_kind_that_fits_best(parser: GrammarParser, text, kind, nearest) -> None:
    found = suggestions(text, None, *QUESTION_KINDS)[0]
    assert parser.parse(found, kind)
    assert nearest in found
    assert ("without" in found.lower() or "removed" in found) == (" if " in text)


def test_a_side_that_is_asked_for_may_be_the_other_one() -> None:
    found = suggestions("After how many collisions does the blue sphere leave?", None, "descriptive")
    for side in ("before", "after"):
        assert f"How many collisions happen {side} the blue sphere exits the scene?" in found


@pytest.mark.parametrize("kind", ["descriptive", "multiple_choice", "choice"])
@pytest.mark.parametrize("text", ["Which yellow sphere is faster?", "the red cube hits the green one", "", "zork"])
def test_suggestions_can_be_parsed_and_fit_the_scene(small_scene: Scene, parser: GrammarParser, text, kind) -> None:
    executor = Executor(small_scene)
    found = suggestions(text, small_scene, kind)
    assert len(found) == 3
    for candidate in found:
        program = parser.parse(candidate, kind)
        if kind == "descriptive":
            executor.answer(program)
        elif kind == "choice":
            executor.run(program)
        else:
            assert program.needs_choice


def test_an_empty_scene_has_no_suggestions_about_objects(small_scene: Scene) -> None:
    empty = Scene((), 128, small_scene.visible[:0], small_scene.visible[:0], ())
    assert suggestions("How many zebras?", empty, "descriptive") == []


def test_a_pipeline_names_the_nearest_questions(small_scene: Scene, parser: GrammarParser) -> None:
    pipeline = Pipeline(None, None, parser)  # type: ignore[arg-type]
    with pytest.raises(QuestionError, match="the nearest questions: How many cubes exit the scene"):
        pipeline.answer(small_scene, "How many zebras exit the scene?")
    choices = ["the presence of the zebra", "the presence of the cube"]
    found = pipeline.answer(small_scene, "Which is responsible for the blue sphere's exit?", choices).choices
    assert found[0].answer is None
    assert "the nearest options: the presence of " in found[0].error
    assert found[1].answer == "correct"


def test_an_error_of_the_parser_itself_is_not_taken_for_one_of_the_choice(small_scene, parser, monkeypatch) -> None:
    def parse(text: str, kind: str) -> object:
        if kind == "choice":
            raise EndpointError("no server")
        return parser.parse(text, kind)

    pipeline = Pipeline(None, None, parser)  # type: ignore[arg-type]
    monkeypatch.setattr(pipeline, "question_parser", type("Stub", (), {"parse": staticmethod(parse)})())
    with pytest.raises(EndpointError, match=r"^no server$"):
        pipeline.answer(small_scene, "What will happen next?", ["the cube", "the sphere"])


@pytest.mark.parametrize(
    ("text", "options"),
    [
        ("What happens if the red cube is heavier?", '--mass "OBJECT=2"'),
        ("What if the ball were faster?", '--velocity "OBJECT=x2"'),
        ("What happens if the red cube and the blue sphere are removed?", '--remove "red cube" --remove "blue sphere"'),
        ("What would happen to the blue sphere if the red cube were removed?", ""),
        ("Without the red cube, will the blue sphere and the green cube stack?", ""),
        ("How fast were the cubes?", ""),
        ("Tell me if the cube is heavy", ""),
    ],
)
def test_questions_for_a_simulation_name_its_options(text: str, options: str) -> None:
    assert intervention_hint(text, CLEVRER) == (options and f"; nsdr simulate VIDEO {options} says what would happen")


def test_the_hint_stands_before_the_nearest_questions(small_scene: Scene, parser: GrammarParser) -> None:
    pipeline = Pipeline(None, None, parser)  # type: ignore[arg-type]
    with pytest.raises(QuestionError, match=r"; nsdr simulate VIDEO --mass .* says what would happen; the nearest"):
        pipeline.answer(small_scene, "What happens if the red cube is heavier?")


def test_open_questions_are_suggested_and_the_refused_text_is_not(small_scene: Scene) -> None:
    assert suggestions("Briefly, what happens in this video?", small_scene, *QUESTION_KINDS)[0] == (
        "What happens in this video?"
    )
    text = "how many cubes exit the scene"
    assert suggestions("How many zebras exit the scene?", small_scene, "descriptive")[0].lower() == f"{text}?"
    assert f"{text}?" not in [near.lower() for near in suggestions(text, small_scene, "descriptive")]


@pytest.mark.parametrize("text", ["What happends in this video?", "What hapens in this vidio?", "What hapens?"])
def test_misspelt_open_questions_are_read(parser: GrammarParser, text: str) -> None:
    program = parser.parse(text)
    assert program.tokens == ("events",)
    assert any("as 'happens'" in note for note in program.notes)


def test_a_question_with_candidates_may_be_a_descriptive_one(small_scene: Scene, parser: GrammarParser) -> None:
    pipeline = Pipeline(None, None, parser)  # type: ignore[arg-type]
    with pytest.raises(QuestionError, match=r"nearest questions: .*How many"):
        pipeline.answer(small_scene, "How many cubes are stacked?", ["1", "2"])


@pytest.mark.parametrize("text", ["Can you say if the red cube is stacked?", "Which cube is gone?", "What is missing?"])
def test_bare_conditions_are_no_removals(text: str) -> None:
    found = suggestions(text, None, *QUESTION_KINDS)
    assert not all("without" in near.lower() or "removed" in near for near in found), found


def test_removals_are_suggested_where_the_scene_knows_them(small_scene: Scene) -> None:
    text = "What happens if the red cube and the blue sphere are removed?"
    known = suggestions(text, small_scene, *QUESTION_KINDS)
    assert all("without" in near.lower() or "removed" in near for near in known), known
    assert suggestions(text, replace(small_scene, counterfactual=None), *QUESTION_KINDS)
