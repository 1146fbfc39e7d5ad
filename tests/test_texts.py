"""Texts of many kinds, read or refused by the default parser: none is read as something else than it says."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from nsdr import GrammarParser, Program
from nsdr.language.texts import TEXT_KINDS

KINDS = sorted(path.stem for path in (Path(__file__).parent / "texts").glob("*.txt"))


@pytest.fixture(scope="module")
def parser() -> GrammarParser:
    return GrammarParser()


def texts(name: str) -> Iterator[tuple[str, str]]:
    """Texts of a file, each with a sentence that says the same, or "" if it must be refused."""
    for line in (Path(__file__).parent / "texts" / f"{name}.txt").read_text().splitlines():
        if line and not line.startswith("#"):
            text, _, plain = line.partition(" => ")
            yield text, plain


def programs(parser: GrammarParser, texts: list[str]) -> list[dict[str, str]]:
    """The programs of each text by kind of text."""
    found = {kind: parser.parse_batch(texts, kind) for kind in TEXT_KINDS}
    return [{k: str(p) for k in found if isinstance(p := found[k][i], Program)} for i in range(len(texts))]


@pytest.mark.parametrize("name", KINDS)
def test_texts_are_read_as_what_they_say_or_refused(parser: GrammarParser, name: str) -> None:
    rows = list(texts(name))
    said = dict(zip((plain for _, plain in rows), programs(parser, [plain or "?" for _, plain in rows]), strict=True))
    assert all(said[plain] for _, plain in rows if plain)
    found = dict(zip((text for text, _ in rows), programs(parser, [text for text, _ in rows]), strict=True))
    assert found == {text: said[plain] if plain else {} for text, plain in rows}


def test_a_hedge_is_left_out_and_said(parser: GrammarParser) -> None:
    hedged = [
        ("What will probably happen next?", "multiple_choice"),
        ("What might not happen without the red cube?", "multiple_choice"),
        ("What can happen next?", "descriptive"),
        ("How many cubes do you think are moving?", "descriptive"),
    ]
    for text, kind in hedged:
        found = parser.parse(text, kind)
        assert any("read as" in note for note in found.notes)
