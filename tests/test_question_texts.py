"""Texts in people's words, answered on a scene: from words to the answer."""

import pytest

from nsdr import Executor, QuestionError, QuestionParser, Scene
from nsdr.clevrer.files.questions import read_questions
from nsdr.question_parser.grammar import GrammarParser, readings
from nsdr.world.vocabulary import CLEVRER


def reading(text: str) -> list[str]:
    found = readings(text, "descriptive", CLEVRER)
    assert len(found) == 1
    return found[0]


@pytest.mark.parametrize(
    ("text", "answer"),
    [
        ("How many things are there?", "4"),
        ("Are there any yellow cylinders?", "no"),
        ("Are there no collisions?", "no"),
        ("Is the green object moving?", "no"),
        ("Is the green object at rest when the video ends?", "yes"),
        ("Does the red sphere come into view?", "yes"),
        ("Does the red cube hit the green object?", "no"),
        ("How many crashes involve the blue object?", "2"),
        ("When does the red sphere enter?", "frame 10"),
        ("What will happen next?", "the green rubber cylinder and the red rubber sphere collide (about frame 150)"),
    ],
)
def test_answers(small_scene: Scene, text: str, answer: str) -> None:
    assert Executor(small_scene).answer(reading(text)).text == answer


@pytest.mark.real_data
def test_no_real_text_is_refused(shared) -> None:
    """Every question and choice of CLEVRER's files at hand has its own program as its only reading, and the parser finds it."""
    parser = QuestionParser.from_pretrained()
    texts: dict[tuple[str, str], list[str]] = {}
    files = [*sorted((shared / "real/questions").glob("*.json")), shared / "clips/questions.json"]
    for scene in (scene for path in files for scene in read_questions(path)):
        for q in scene.questions:
            kind = "multiple_choice" if q.choices else "descriptive"
            for text_kind, text, program in [
                (kind, q.text, q.program),
                *(("choice", c.text, c.program) for c in q.choices),
            ]:
                if program:
                    texts[text_kind, text] = list(program)
    assert len(texts) > 3000
    for (kind, text), program in texts.items():
        assert readings(text, kind, CLEVRER) == [program]
    for kind in ("descriptive", "multiple_choice", "choice"):
        of_kind = {text: program for (k, text), program in texts.items() if k == kind}
        assert [list(p.tokens) for p in parser.parse_batch(list(of_kind), kind)] == list(of_kind.values())


@pytest.mark.parametrize("text", ["z" * 1990, "How many zebras and " + "blue " * 380 + "cubes are there?"])
def test_an_error_about_a_long_text_is_short(text: str) -> None:
    with pytest.raises(QuestionError) as caught:
        GrammarParser().parse(text)
    assert text[:30] in str(caught.value)
    assert len(str(caught.value)) < 800
