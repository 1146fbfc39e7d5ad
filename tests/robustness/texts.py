"""Programs and texts that mean nothing, and texts that say what no program says."""

from collections.abc import Iterator
from pathlib import Path

from nsdr.clevrer.example import TRUTH
from tests.robustness.case import Case
from tests.robustness.good import ANSWER

PROGRAMS = {
    "empty": "", "blanks": "   ", "unknown token": "zebra", "underflow": "count", "leftovers": "objects objects",
    "wrong type": "objects red filter_shape", "wrong type of a module": "objects query_color", "number": "5",
    "no answer": "objects", "tree": "Count(Objects", "emoji": "🙂", "control characters": "objects\x01count",
    "word of another kind": "objects cube filter_color count", "too long": "objects " * 20_000 + "count",
    "SQL": "'; DROP TABLE objects; --",
    "unique of none": "objects purple filter_color rubber filter_material cube filter_shape "
    "cube filter_shape sphere filter_shape unique query_color", "capital letters": "OBJECTS COUNT ZEBRA",
    "question for choices": "unseen_events belong_to", "right to left": "\u202eobjects count",
}  # fmt: skip
TEXTS = {
    "empty": "", "blanks": "   ", "unknown word": "How many zebras enter the scene?", "emoji": "🙂",
    "emoji at the end": "How many collisions happen? 🙂", "control characters": "How many\x01collisions happen?",
    "negated": "How many collisions do not happen?", "too long": "How many " + "red " * 20_000 + "cubes enter the scene?",
    "another language": "Wie viele Kollisionen gibt es?", "number": "5", "punctuation": "???", "a word": "cube",
    "lone surrogate": "How many \udcff collisions happen?", "zero width": "How many col\u200blisions happen?",
    "repeated": "How many collisions happen? How many collisions happen?", "code": "__import__('os').system('true')",
    "no question": "The weather is nice today", "other letters": "How m\u0430ny c\u043ellisions h\u0430ppen?",
    "unknown colour": "How many pink cubes enter the scene?", "unknown shape": "Are there any pyramids that enter the scene?",
    "cut off": "How many collisions happen before the",
}  # fmt: skip

TEXT_FILES = Path(__file__).parent.parent / "texts"
"""Texts by kind; those without " => " must be refused (tests/test_texts.py reads them all)."""
EVERY = 20
"""Each so many text that must be refused is a case."""


def refused_texts() -> Iterator[tuple[str, str]]:
    """A name and a text of each case."""
    for path in sorted(TEXT_FILES.glob("*.txt")):
        lines = path.read_text().splitlines()
        texts = [line for line in lines if line and not line.startswith("#") and " => " not in line]
        yield from ((f"{path.stem} {i}", text) for i, text in enumerate(texts) if i % EVERY == 0)


def text_cases() -> Iterator[Case]:
    """All wrong programs and texts."""
    for name, text in refused_texts():
        yield Case("text, program", name, ("program", text))
    for name, text in PROGRAMS.items():
        yield Case("program", name, ("program", "--run", str(TRUTH), "--", text))
    for name, text in TEXTS.items():
        yield Case("text, program", name, ("program", text))
        yield Case("text, answer", name, ("answer", str(TRUTH), "--", text))
    for name, choices in {"descriptive question with choices": ["the presence of the cube"]}.items():
        yield Case("text, choice", name, (*ANSWER, *(f"-c={c}" for c in choices)))
    for name, text in TEXTS.items():
        argv = (
            "answer",
            str(TRUTH),
            "What will happen next?",
            "-c",
            "The brown cylinder and the metal cube collide",
        )
        yield Case("text, choice", name, (*argv, f"-c={text}"))
