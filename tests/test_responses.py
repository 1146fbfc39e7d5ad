"""Reading the answers in free text."""

import json
from itertools import product

import pytest
from hypothesis import given, settings, strategies as st

from nsdr.clevrer import Response, prompt, read_response, read_response_to, solution
from nsdr.clevrer.answers.responses import MAX_LENGTH
from nsdr.clevrer.files.questions import Choice, Question, answer_words
from nsdr.world.vocabulary import CLEVRER

ANSWERS = frozenset().union(*answer_words(CLEVRER).values())
OPTIONS = (
    "The red cube collides with the sphere",
    "The sphere exits the scene",
    "the presence of the cube",
    "the presence of the rubber cube",
)


@pytest.mark.parametrize(
    ("text", "letters", "how"),
    [
        ("<answer>A,C</answer>", "AC", "tags"),
        ("<ANSWER> a , c </Answer>", "AC", "tags"),
        ("<think>It is <answer>B</answer>?</think> <answer>C</answer>", "C", "tags"),
        ("A or B? I take C.</think>\n<answer>C</answer>", "C", "tags"),
        ("<think>B? <answer>C</answer>", "C", "tags"),
        ("<answer>A</answer><think>or B</think>", "A", "tags"),
        ("<think>A <think>B</think> C</think> D", "D", "bare"),
        ("<answer>A</answer> Wait: <answer>B</answer>", "B", "tags"),
        ("<answer>B", "B", "tags"),
        ("B</answer>", "B", "tags"),
        ("<answer>none</answer>", "", "tags"),
        ("<answer>\\boxed{A, B}</answer>", "AB", "tags"),
        ("<answer>A. The red cube collides with the sphere\nC. The presence of the cube</answer>", "AC", "tags"),
        ("So \\boxed{\\text{B}}", "B", "boxed"),
        ('["A", "D"]', "AD", "json"),
        ('```json\n{"answer": ["b"]}\n```', "B", "json"),
        ('Here it is:\n```json\n{"reason": "…", "answer": "B and C"}\n```', "BC", "json"),
        ("[]", "", "json"),
        ("Answer: B", "B", "label"),
        ("**Answer:** (A) and (C)", "AC", "label"),
        ("The red cube is fast.\nFinal answer: D", "D", "label"),
        ("The answer is B because the sphere leaves.", "B", "label"),
        ("The correct options are A and C.", "AC", "label"),
        ("Answer:\nA\nC", "AC", "label"),
        ("Answer: B\nExplanation: The sphere leaves the scene.", "B", "label"),
        ("Answer: B\nExplanation: A red cube hits it.", "B", "label"),
        ("(A) and (C)", "AC", "bare"),
        ("A, C", "AC", "bare"),
        ("a", "A", "bare"),
        ("option b", "B", "text"),
        ("AC", "AC", "bare"),
        ("I think A and C are correct.", "AC", "text"),
        ("None of the above", "", "text"),
        ("All of the above.", "ABCD", "text"),
        ("the sphere exits the scene", "B", "text"),
        ("B. The sphere exits the scene.", "B", "text"),
        ("the presence of the rubber cube", "D", "text"),
        ("The presence of the cube and the presence of the rubber cube", "CD", "text"),
        ("There is no correct option.", "", "text"),
        ("A. Yes, B. No, C. No, D. Yes", "AD", "text"),
        ("A: yes\nB: no\nC: yes\nD: no", "AC", "text"),
        ("A is wrong, B is correct, C is wrong, D is wrong", "B", "text"),
        ("B\n\nThe sphere leaves the scene at the end.", "B", "line"),
        ("The sphere leaves the scene at the end.\n\nB", "B", "line"),
        ("B\n\nA collision follows.", "B", "line"),
    ],
)
def test_letters(text: str, letters: str, how: str) -> None:
    assert read_response(text, OPTIONS) == Response(frozenset(letters), how, "")


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("", "empty"),
        ("<answer></answer>", "empty"),
        ('[""]', "no letters"),
        ("<think>It may be A", "inside its thinking"),
        ("E", "E: the options end at D"),
        ("<answer>A,F</answer>", "F: the options end at D"),
        ("A or B", "more than letters"),
        ("A red cube", "more than letters"),
        ("a red cube", "more than letters"),
        ("a option", "more than letters"),
        ("not A", "more than letters"),
        ("A?", "more than letters"),
        ("A/C", "more than letters"),
        ("Answer: A\nAlso C.", "C, after an answer without it"),
        ("The answers are A because it hits, and C because it exits", "C, after an answer without it"),
        ("B\n\nC is right too", "C, after an answer without it"),
        ("B\n\nA is right too", "A, after an answer without it"),
        ("1, 3", "more than letters"),
        ("A is correct, B is wrong", "more than letters"),
        ("A is correct, A is wrong", "more than letters"),
        ("B. The red cube collides with the sphere", "B with the text of option A"),
        ("The answer is A.\nYes, so the answer is B.", "several different"),
        ("The answer is A. No, the answer is B.", "more than letters"),
        ("A-C", "more than letters"),
        ("Answer: A\nB is right too, I would say.", "B, after an answer without it"),
        ("The right ones are:\nB\nA", "more than letters"),
        ('{"result": 3}', "a JSON object without"),
        ("[1, 2]", "a JSON value that is neither"),
        ('{"answer": null}', "a JSON value that is neither"),
        ('{"A": true, "B": false}', "a JSON object without"),
        ("<answer>yes</answer>", "more than letters"),
        ("\\boxed{A", "not closed"),
    ],
)
def test_letters_that_are_not_read(text: str, problem: str) -> None:
    response = read_response(text, OPTIONS)
    assert (response.answer, response.how) == (None, "")
    assert problem in response.problem


def test_equal_options_need_letters() -> None:
    assert read_response("B. it exits", ["it exits", "it exits"]).answer == {"B"}
    assert "without a letter" in read_response("it exits", ["it exits", "it exits"]).problem


@pytest.mark.parametrize(
    ("text", "word", "how"),
    [
        ("<answer>red</answer>", "red", "tags"),
        ("<answer>\nThree.\n</answer>", "3", "tags"),
        ("**Grey**", "gray", "bare"),
        ("03", "3", "bare"),
        ("no", "no", "bare"),
        ("The color is red.", "red", "text"),
        ("Yes, the red cube collides with the sphere.", "yes", "text"),
        ("No. It does not.", "no", "text"),
        ("There are two of them.", "2", "text"),
        ("They are cubes", "cube", "text"),
        ("Answer: 0", "0", "label"),
        ("The answer is $2$", "2", "label"),
        ("I see a cube and a sphere.\nFinal answer: yes", "yes", "label"),
        ('{"answer": 3}', "3", "json"),
        ('["metal"]', "metal", "json"),
        ("$\\boxed{2}$", "2", "boxed"),
        ("Metal\n\nThe cube shines.", "metal", "line"),
    ],
)
def test_words(text: str, word: str, how: str) -> None:
    assert read_response(text) == Response(word, how, "")


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("red or blue", "several answer words: blue, red"),
        ("The red cube is metal", "several"),
        ("red/blue", "several"),
        ("It is not red.", "denial"),
        ("non-metallic", "denial"),
        ("None of them is red.", "denial"),
        ("<answer>more than 2</answer>", "denial"),
        ("at least 2", "denial"),
        ("I can't see any cube", "denial"),
        ("There are no spheres", "several"),
        ("Is it red?", "question"),
        ("None", "no answer word"),
        ("-3", "no answer word"),
        ("2.5", "no answer word"),
        ("3-4", "no answer word"),
        ("99", "no answer word"),
        ("true", "no answer word"),
        ("Yes, there are three.", "several"),
        ("I look at the video. A cube moves.", "more than one sentence"),
        ('{"answer": true}', "neither a text"),
        ('["red", "blue"]', "several"),
    ],
)
def test_words_that_are_not_read(text: str, problem: str) -> None:
    response = read_response(text)
    assert response.answer is None
    assert problem in response.problem


def test_a_repeated_prompt_is_no_answer() -> None:
    open_question = Question(0, "What color is it?", "descriptive", "query_color", None, "red", ())
    choices = tuple(Choice(i, text, None, "wrong") for i, text in enumerate(OPTIONS))
    choice_question = Question(1, "What happens?", "predictive", None, None, None, choices)
    for question in (open_question, choice_question):
        assert read_response_to(question, prompt(question)).answer is None


@settings(deadline=None)
@given(st.sampled_from(sorted(ANSWERS)))
def test_solutions_of_open_questions_are_read(word: str) -> None:
    question = Question(0, "?", "descriptive", None, None, word, ())
    assert read_response_to(question, solution(question)) == Response(word, "tags", "")
    assert read_response(word).answer == word
    assert read_response(json.dumps({"answer": word})).answer == word


@settings(deadline=None)
@given(st.lists(st.tuples(st.sampled_from(OPTIONS), st.booleans()), min_size=1, max_size=8))
def test_solutions_of_options_are_read(options: list[tuple[str, bool]]) -> None:
    choices = tuple(Choice(i, text, None, "correct" if right else "wrong") for i, (text, right) in enumerate(options))
    question = Question(0, "?", "predictive", None, None, None, choices)
    right = frozenset("ABCDEFGH"[i] for i, (_, correct) in enumerate(options) if correct)
    assert read_response_to(question, solution(question)) == Response(right, "tags", "")
    assert read_response_to(question, json.dumps(sorted(right))).answer == right
    quoted = "\n".join(f"{'ABCDEFGH'[i]}. {text}" for i, (text, correct) in enumerate(options) if correct)
    assert read_response_to(question, quoted).answer == (right or None)


MARKS = (
    "<think>",
    "</think>",
    "<answer>",
    "</answer>",
    "\\boxed{",
    "}",
    "{",
    "[",
    "]",
    '"',
    "answer:",
    "```",
    "\n",
    " ",
    ",",
    "?",
)
WORDS = (
    "A",
    "b",
    "E",
    "I",
    "3",
    "red",
    "two",
    "no",
    "yes",
    "not",
    "none",
    "and",
    "or",
    "\ue0000\ue001",
    "the presence of the cube",
)
PIECES = st.sampled_from(MARKS + WORDS)


@settings(deadline=None)
@given(
    st.one_of(st.text(), st.lists(PIECES).map("".join)),
    st.lists(st.one_of(st.sampled_from(OPTIONS), st.text()), max_size=5),
)
def test_no_text_raises(text: str, options: list[str]) -> None:
    response = read_response(text, options)
    assert (response.answer is None) == bool(response.problem) == (not response.how)
    if isinstance(response.answer, frozenset):
        assert response.answer <= set("ABCDE"[: len(options)])
    else:
        assert response.answer is None or (response.answer in ANSWERS and not options)


@pytest.mark.parametrize(
    "text", ["[" * 50_000, "A " * 50_000, " " * 99_999 + "?", "A, " * 33_000 + "?", "<think>" * 10_000, "9" * 99_999]
)
def test_long_texts_are_read_in_time(text: str) -> None:
    assert read_response(text, OPTIONS).how in ("", "bare")
    assert read_response(text).answer is None
    assert "at most" in read_response("A" * 100_001, OPTIONS).problem


@pytest.mark.parametrize(
    "text", ["red\nWait, blue.", "Answer: red\nActually it is blue", "Answer: 2\n\nNo wait, it is wrong"]
)
def test_a_word_that_is_taken_back_is_not_read(text: str) -> None:
    assert read_response(text).answer is None


@pytest.mark.parametrize(
    "unit",
    [
        *(
            "<",
            "< ",
            "```",
            "\n",
            "<answer",
            "<answer>",
            "</answer>",
            "<think>",
            "</think>",
            "\\boxed{",
            "{",
            "{}",
            "[",
            "]",
        ),
        *(
            ".",
            "-",
            ".-",
            "a. ",
            "A ",
            "A)",
            "option ",
            "final ",
            "answer: ",
            "(",
            "9",
            "1.",
            "and ",
            "<|a",
            "'",
            "\ue000",
        ),
        *(" ", "?", "! ", "_", ",", ";"),
    ],
)
def test_long_texts_of_repeated_pieces_are_read(unit: str) -> None:
    """A reader whose work grows with the square of the length would take minutes for them."""
    for before, options in product(("", "<answer>The"), ((), OPTIONS)):
        text = before + unit * (MAX_LENGTH // 2 // len(unit)) + "red</answer>"
        response = read_response(text, options)
        assert (response.answer is None) == bool(response.problem)


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("...red...", "red"),
        ("--red.-", "red"),
        ("-3-", None),
        (".5.", None),
        ("3.", "3"),
        ("-.3", None),
        (".-red", "red"),
    ],
)
def test_marks_around_a_word(text: str, word: str | None) -> None:
    assert read_response(f"<answer>{text}</answer>").answer == word
