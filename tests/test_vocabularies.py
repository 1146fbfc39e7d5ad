"""Questions in the words of another vocabulary than CLEVRER's, and vocabularies that questions cannot have."""

import json
import random
import re
from pathlib import Path

import pytest

from nsdr import DataError, QuestionError
from nsdr.io.worlds import read_world
from nsdr.language.normal import corrected, known_words, normal_form
from nsdr.language.reserved import check_vocabulary, reserved_words
from nsdr.language.texts import TEXT_KINDS, draw_wording, in_words, read_paraphrases, sample
from nsdr.language.words import replacements, rewritten
from nsdr.question_parser.base import read_programs
from nsdr.question_parser.contents import SYMBOLS, content_readings
from nsdr.question_parser.grammar import GrammarParser, readings
from nsdr.world.vocabulary import CLEVRER, Color, Material, Shape, Vocabulary

ALIEN = Vocabulary(
    (
        Color("teal", (0, 128, 128), ("aqua",)),
        Color("amber", (255, 191, 0)),
        Color("indigo", (75, 0, 130)),
        Color("ivory", (255, 255, 240)),
        Color("crimson", (220, 20, 60)),
    ),
    (Material("ceramic", ("porcelain", "glazed")),),
    (
        Shape("loaf", "box", (0.4, 0.2, 0.2), 0.1, "loaves", ("bun", "brick"), ("oblong",)),
        Shape("bead", "sphere", synonyms=("pearl",), adjectives=("beady",)),
    ),
)
"""No word of CLEVRER's, an irregular plural, and synonyms."""
BY_HAND = Path(__file__).parent.parent / "benchmarks" / "questions_by_hand.json"


def _recast() -> dict[str, str]:
    """CLEVRER's words, and the words of `ALIEN` that take their places."""
    words: dict[str, str] = {}
    for entries, others in ((CLEVRER.colors, ALIEN.colors), (CLEVRER.materials, ALIEN.materials)):
        for i, entry in enumerate(entries):
            other = others[i % len(others)]
            synonyms = other.synonyms or (other.word,)
            words[entry.word] = other.word
            words |= {synonym: synonyms[k % len(synonyms)] for k, synonym in enumerate(entry.synonyms)}
    for i, shape in enumerate(CLEVRER.shapes):
        form = ALIEN.shapes[i % len(ALIEN.shapes)]
        nouns = [form.word, *(form.synonyms[k % len(form.synonyms)] for k in range(len(shape.synonyms)))]
        for (one, many), noun in zip(shape.plurals.items(), nouns, strict=True):
            words |= {one: noun, many: form.plurals[noun]}
        words |= dict.fromkeys(shape.adjectives, form.adjectives[0])
    return words


RECAST = _recast()


def recast(text: str) -> str:
    """A text or program in the words of `ALIEN`, in lower case; misspelt words of CLEVRER's are spelt right."""

    def of_alien(word: str) -> str:
        return RECAST.get(word if word in known_words(CLEVRER) else corrected(word, CLEVRER), word)

    return re.sub(r"[a-z]+", lambda word: of_alien(word[0]), text.lower())


def test_questions_by_hand_are_read_in_the_words_of_any_vocabulary() -> None:
    rows = [*json.loads(BY_HAND.read_text()), *read_paraphrases()]
    assert len(rows) > 206
    for row in rows:
        text = recast(row["text"])
        found = [] if normal_form(text, vocabulary=ALIEN).left_out else readings(text, row["kind"], ALIEN)
        assert (text, found) == (text, [recast(row["program"]).split()] if row["program"] else [])


def said_by_contents(text: str) -> str:
    (program,) = [program for kind in SYMBOLS for program in content_readings(text, kind, ALIEN)]
    return in_words(program, ALIEN).lower()


def normal_text(text: str) -> str:
    return normal_form(text, vocabulary=ALIEN).text


RESULTS = {
    "spellings": normal_text,
    "hedges": normal_text,
    "phrases": normal_text,
    "spellings_beyond": lambda text: (
        normal_form(rewritten(text, "spellings_beyond"), keep_unknown=True, vocabulary=ALIEN).text
    ),
    "contents": said_by_contents,
}


@pytest.mark.parametrize("name", RESULTS)
def test_each_line_of_a_word_file_does_what_its_sentence_says_in_the_words_of_any_vocabulary(name: str) -> None:
    lines = replacements(name, ALIEN)
    found = {recast(line.text): RESULTS[name](recast(line.text)) for line in lines}
    assert found == {recast(line.text): recast(line.result) for line in lines}


@pytest.mark.parametrize("kind", TEXT_KINDS)
def test_texts_of_any_vocabulary_are_drawn_written_and_read(kind: str) -> None:
    rng = random.Random(kind)
    for _ in range(100):
        text, tokens = sample(kind, rng, ALIEN)
        assert readings(text, kind, ALIEN) == [tokens]
        for program in (tokens, draw_wording(kind, rng, ALIEN)[1]):
            assert readings(in_words(program, ALIEN), kind, ALIEN) == [program]
            assert not CLEVRER.attributes.keys() & set(program)


@pytest.mark.parametrize(
    ("text", "normal"),
    [
        ("The glazed loaf count?", "how many ceramic loaves be there"),
        ("Is there oblong stuff?", "be there loaves"),
        ("How many aqua buns are there?", "how many teal loaves be there"),
        ("Does the amber pearl hit the indigo one?", "do the amber bead hit the indigo bead"),
        ("How many crimson laoves enter?", "how many crimson loaves enter"),
        ("How many teel beads enter?", "how many teal beads enter"),
    ],
)
def test_irregular_plurals_synonyms_and_misspelt_words(text: str, normal: str) -> None:
    assert normal_form(text, vocabulary=ALIEN).text == normal


def test_words_of_another_vocabulary_are_refused_with_the_nearest_questions() -> None:
    with pytest.raises(QuestionError, match="unknown word 'cubes'") as e:
        read_programs(GrammarParser(vocabulary=ALIEN), "How many amber cubes enter the scene?")
    assert "How many amber objects enter the scene?" in e.value.nearest
    with pytest.raises(QuestionError, match="unknown word 'loaves'"):
        GrammarParser().parse("How many red loaves enter the scene?")
    with pytest.raises(QuestionError) as e:
        read_programs(GrammarParser(vocabulary=ALIEN), "Do things collide with zebras?")
    assert not RECAST.keys() & set(re.findall(r"\w+", " ".join(e.value.nearest).lower()))


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"colors": (Color("clear", (0, 0, 0)),)}, "clear: means something else"),
        ({"materials": (Material("lead"),)}, "lead: means something else"),
        ({"materials": (Material("iron", ("stuff",)),)}, "stuff: means something else"),
        ({"shapes": (Shape("thing", "box"),)}, "thing: means something else"),
        ({"shapes": (Shape("video", "box"),)}, "video: means something else"),
        ({"shapes": (Shape("disk", "cylinder", plural="last"),)}, "last: means something else"),
        ({"colors": (Color("unique", (0, 0, 0)),)}, "unique: means something else"),
        ({"colors": (Color("black", (0, 0, 0)),)}, "black, block: one letter apart"),
    ],
)
def test_words_with_another_meaning_and_words_that_are_too_alike_are_refused(changes, named: str) -> None:
    with pytest.raises(DataError, match=f"vocabulary: {named}"):
        GrammarParser(vocabulary=Vocabulary(**changes))


def test_usual_words_are_free() -> None:
    for vocabulary in (CLEVRER, ALIEN):
        check_vocabulary(vocabulary)
    words = "orange white black pink gold silver tan wood steel stone glass plastic paper ice puck disc cone ring tube light"
    assert not reserved_words().intersection(words.split())


def test_of_several_corrections_the_one_in_normal_form_is_taken_in_every_process() -> None:
    assert [corrected(word, CLEVRER) for word in ("begine", "objectf", "whih", "sphers")] == [
        "begin",
        "object",
        "which",
        "spheres",
    ]


@pytest.mark.parametrize(
    ("name", "question"), [("pucks", "Are there any wooden chips?"), ("blocks", "How many pink bricks are moving?")]
)
def test_questions_can_be_asked_about_the_worlds_that_ship(name: str, question: str) -> None:
    vocabulary = read_world(name).vocabulary
    check_vocabulary(vocabulary)
    assert set(vocabulary.words["color"]) - set(CLEVRER.words["color"])
    assert len(GrammarParser(vocabulary=vocabulary).parse(question).tokens) > 3
