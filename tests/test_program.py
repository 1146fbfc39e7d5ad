import copy
import pickle
from pathlib import Path

import pytest
from hypothesis import HealthCheck, example, given, settings, strategies as st

from nsdr import ExecutionError, Executor, Program, ProgramError, narrate
from nsdr.symbolic import MODULES, Kind
from nsdr.symbolic.modules import ALL_WORDS, DISPATCH
from nsdr.symbolic.reference import extension_page, reference_page
from nsdr.world.vocabulary import CLEVRER

COUNT_MOVING = ["objects", "sphere", "filter_shape", "end", "get_frame", "filter_moving", "count"]


def test_a_list_of_tokens_and_a_text_are_one_program() -> None:
    program = Program.parse(COUNT_MOVING)
    assert program.result == Kind.NUMBER
    assert Program.parse(" ".join(COUNT_MOVING)) == program
    assert Program.parse(", ".join(COUNT_MOVING).upper()) == program


@pytest.mark.parametrize(
    ("calls", "tokens"),
    [
        ("count(filter_collision(events, objects))", "events objects filter_collision count"),
        ("Count( Objects )", "objects count"),
        ("count(filter_shape(objects(), 'cube'))", "objects cube filter_shape count"),
        ("belong_to(unseen_events)", "unseen_events belong_to"),
        ("query_frame(filter_start(events))", "start get_frame"),
    ],
)
def test_calls_are_a_program(calls: str, tokens: str) -> None:
    assert Program.parse(calls) == Program.parse(tokens)


def test_names_of_the_released_executor_are_parsed() -> None:
    source = "objects events filter_end query_frame filter_resting count"
    assert Program.parse(source).tokens == ("objects", "end", "get_frame", "filter_stationary", "count")


@pytest.mark.parametrize("end", ["<END>", "<NULL>", "<end> count"])
def test_the_released_start_and_end_tokens_are_skipped(end: str) -> None:
    program = Program.parse("objects count")
    assert Program.parse(f"<START> objects count {end}") == program
    assert Program.parse(["<START>", "objects", "count", *end.split()]) == program
    with pytest.raises(ProgramError, match="the program is empty"):
        Program.parse(["<START>", *end.split()])


def test_a_program_that_judges_a_choice_prints_and_parses_back() -> None:
    program = Program.parse("unseen_events belong_to")
    assert program.needs_choice
    assert Program.parse(str(program)) == program


def test_choice_and_question_are_joined() -> None:
    choice = Program.parse("objects red filter_color unique")
    whole = choice.then(Program.parse("unseen_events belong_to"))
    assert whole.result == Kind.BOOLEAN
    assert not whole.needs_choice


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("objects frobnicate count", "token 2: unknown module or word 'frobnicate'"),
        ("count", "token 1 'count': takes 1 arguments, found 0"),
        ("events objects filter_color count", "'filter_color': argument 1 is events; expected objects"),
        ("objects red filter_shape count", "argument 2 is color; expected shape"),
        ("objects objects count", "2 values are left"),
        ("", "the program is empty"),
        ("red", "ends in the word 'red'"),
        ("count(objects", r"'count\(objects': expected calls such as count\(objects\), with each bracket closed"),
        ("count(objects) exist", "expected calls such as"),
        ("count(objects, events)", "'count' takes 1 arguments, found 2"),
        ("filter_shape(objects, filter_color(red))", "'filter_color' takes 2 arguments, found 1"),
        ("frobnicate(objects)", "token 2: unknown module or word 'frobnicate'"),
        ("count((objects, events))", r"'\(objects, events\)': expected a call, a module or a word"),
        ("count(objects + events)", "expected calls such as"),
        ("count(" * 300 + "objects" + ")" * 300, "with each bracket closed"),
    ],
)
def test_errors_name_the_token(source: str, message: str) -> None:
    with pytest.raises(ProgramError, match=message):
        Program.parse(source)


def test_empty_token_list() -> None:
    with pytest.raises(ProgramError, match="empty"):
        Program.parse([])


def test_every_module_has_a_meaning_and_a_lower_case_name() -> None:
    for name, module in MODULES.items():
        assert name == name.lower()
        assert module.meaning


def test_the_reference_page_is_up_to_date() -> None:
    page = Path(__file__).parent.parent / "docs" / "api" / "modules.md"
    made = reference_page(CLEVRER) + extension_page()
    assert page.read_text() == made, "run: python -m nsdr.symbolic.reference > docs/api/modules.md"


@st.composite
def programs(draw: st.DrawFn, kind: Kind = Kind.NUMBER, depth: int = 4) -> list[str]:
    """Tokens of a random well-typed program with a result of a kind."""
    words = [w for w, k in ALL_WORDS.items() if k == kind]
    fitting = [
        (m, kinds)
        for (name, *kinds), (m, result) in DISPATCH.items()
        if result == kind and (depth > 0 or not kinds) and name != "belong_to"
    ]
    if words and not draw(st.booleans()):
        return [draw(st.sampled_from(words))]
    if depth <= 0 and not fitting:
        shortest = {
            Kind.OBJECT: ["objects", "unique"],
            Kind.NUMBER: ["objects", "count"],
            Kind.BOOLEAN: ["objects", "exist"],
            Kind.DIRECTION: ["objects", "unique", "null", "query_direction"],
        }
        return shortest.get(kind) or [words[0]]
    module, kinds = draw(st.sampled_from(fitting))
    parts = [draw(programs(Kind(k), depth - 1)) if k in KINDS_OF_RESULTS else [draw(_word(Kind(k)))] for k in kinds]
    return [*(token for part in parts for token in part), module.name]


KINDS_OF_RESULTS = (Kind.OBJECTS, Kind.EVENTS, Kind.OBJECT, Kind.EVENT, Kind.FRAME, Kind.NUMBER, Kind.BOOLEAN)


def _word(kind: Kind) -> st.SearchStrategy[str]:
    return st.sampled_from([w for w, k in ALL_WORDS.items() if k == kind])


@given(st.sampled_from([Kind.NUMBER, Kind.BOOLEAN, Kind.OBJECT, Kind.EVENT]).flatmap(lambda k: programs(k)))
@settings(deadline=None, max_examples=200, suppress_health_check=[HealthCheck.too_slow])
def test_parsing_and_printing_are_inverse(tokens: list[str]) -> None:
    program = Program.parse(tokens)
    assert program.tokens == tuple(tokens)
    assert Program.parse(str(program)) == program


@given(st.sampled_from([Kind.NUMBER, Kind.BOOLEAN, Kind.OBJECT, Kind.EVENT]).flatmap(lambda k: programs(k)))
@settings(deadline=None, max_examples=100, suppress_health_check=[HealthCheck.too_slow])
def test_pickling_and_copying_keep_a_program(tokens: list[str]) -> None:
    program = Program.parse(tokens)
    for twin in (pickle.loads(pickle.dumps(program)), copy.copy(program), copy.deepcopy(program)):
        assert twin == program
        assert hash(twin) == hash(program)
        assert twin.result == program.result


RED_CUBE = ["objects", "red", "filter_color", "cube", "filter_shape", "unique"]


@given(st.sampled_from([Kind.NUMBER, Kind.BOOLEAN]).flatmap(lambda k: programs(k)))
@example(["objects", *RED_CUBE, "query_shape", "filter_shape", "count"])
@example(["objects", *RED_CUBE, "query_shape", "filter_shape", "green", "filter_color", "unique", "query_color"])
@example([*RED_CUBE, "counterfact_events", "exist"])
@settings(deadline=None, max_examples=200, suppress_health_check=list(HealthCheck))
def test_every_program_is_told_in_words_or_refused_in_words(executor: Executor, tokens: list[str]) -> None:
    try:
        answer = executor.answer(tokens)
    except ExecutionError:
        return
    assert narrate(answer, executor.scene).endswith(f"<answer>{answer.answer}</answer>")


def test_notes_travel_with_a_program() -> None:
    choice = Program.parse("objects cube filter_shape unique").with_notes("read 'cueb' as 'cube'")
    question = Program.parse("events events objects filter_out unique filter_ancestor belong_to").with_notes(
        "a", "b", "a"
    )
    assert question == Program.parse(question.tokens)
    assert Program.parse(question.tokens).notes == ()
    joined = choice.then(question)
    assert joined.notes == ("read 'cueb' as 'cube'", "a", "b")
    assert pickle.loads(pickle.dumps(joined)).notes == copy.deepcopy(joined).notes == joined.notes
    assert Program.parse(joined).notes == joined.notes


def test_questions_that_judge_a_choice_can_be_pickled() -> None:
    question = Program.parse("unseen_events belong_to")
    assert pickle.loads(pickle.dumps(question)).needs_choice
