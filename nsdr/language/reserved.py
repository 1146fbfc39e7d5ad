"""Words that no vocabulary of objects may have, because texts have them in another meaning."""

from functools import cache

from nsdr.errors import DataError
from nsdr.language.normal import AMBIGUOUS, MEANINGS, known_words, one_letter_off
from nsdr.language.rules import load_rules
from nsdr.language.words import pattern_words
from nsdr.symbolic.modules import CHANGES, MODULES, ORDERS
from nsdr.world.vocabulary import CLEVRER, Vocabulary

WORD_FILES = ("spellings", "spellings_beyond", "hedges", "phrases", "contents")
RULES = ("read_english", "read_beyond", "read_contents")


@cache
def reserved_words() -> frozenset[str]:
    """Words of texts that are not for attributes of objects."""
    of_files = {word for name in WORD_FILES for word in pattern_words(name)}
    of_programs = {*MODULES, *ORDERS, *CHANGES}
    known = known_words(CLEVRER).union(load_rules(CLEVRER, *RULES).words, of_files, of_programs, AMBIGUOUS, MEANINGS)
    return known.difference(_meanings(CLEVRER))


@cache
def check_vocabulary(vocabulary: Vocabulary) -> None:
    """Refuse a vocabulary whose words questions cannot tell from others.

    Raises:
        DataError: a word has another meaning in questions, or is one letter off a word that means something else, so that it
            would be read as that word where it is misspelt; names it.
    """
    meanings = _meanings(vocabulary)
    for word, meaning in meanings.items():
        if word in reserved_words():
            raise DataError(f"vocabulary: {word}: means something else in questions; take another word")
        near = [other for other in meanings if other in one_letter_off(word) and meanings[other] != meaning]
        if near:
            raise DataError(f"vocabulary: {word}, {near[0]}: one letter apart; take another word for one of them")


def _meanings(vocabulary: Vocabulary) -> dict[str, str]:
    """The words of objects, and what they mean."""
    nouns = ((shape.word, number) for shape in vocabulary.shapes for number in shape.plurals.items())
    return vocabulary.adjectives | {noun: word for word, number in nouns for noun in number}
