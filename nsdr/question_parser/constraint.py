"""Constrained decoding: the program tokens that the signature table permits next, so that only well-typed programs result."""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from nsdr.question_parser.tokenizer import END, OTHER, decoder_tokens
from nsdr.symbolic.modules import ARITY, DISPATCH, Kind, program_words
from nsdr.world.vocabulary import Vocabulary

Stack = tuple[Kind, ...] | None
"""Kinds of the values that the first tokens of a program leave on the stack; None after `OTHER`."""
_ANSWERS = {Kind.NUMBER, Kind.BOOLEAN, Kind.COLOR, Kind.MATERIAL, Kind.SHAPE}
_RESULTS = {
    "descriptive": _ANSWERS | {Kind.FRAME, Kind.EVENTS},
    "multiple_choice": {Kind.BOOLEAN},
    "choice": {Kind.OBJECT, Kind.EVENT},
}


def first_stack(kind: str) -> Stack:
    """The stack before the first token: a multiple-choice question starts with the value of its choice."""
    return (Kind.EVENT,) if kind == "multiple_choice" else ()


def following(stack: Stack, token: int, vocabulary: Vocabulary) -> Stack:
    """The stack after a token, which has to be one that `allowed` permits."""
    name, words = decoder_tokens(vocabulary)[token], program_words(vocabulary)
    if stack is None or name == OTHER:
        return None
    if name in words:
        return (*stack, words[name])
    below = len(stack) - ARITY[name]
    return (*stack[:below], DISPATCH[(name, *stack[below:])][1])


@lru_cache(maxsize=4096)
def allowed(stack: Stack, kind: str, at_start: bool, vocabulary: Vocabulary) -> NDArray[np.bool_]:
    """Which tokens may follow: (n_tokens,) bool.

    Args:
        stack: kinds of the values on the stack.
        kind: "descriptive", "multiple_choice" or "choice".
        at_start: whether no token has been decoded yet.
        vocabulary: of the tokens.
    """
    tokens, words = decoder_tokens(vocabulary), program_words(vocabulary)
    mask = np.array([stack is not None and _fits(stack, name, words.get(name)) for name in tokens])
    mask[tokens.index(OTHER)] = at_start
    mask[END] = stack is None or (not at_start and len(stack) == 1 and stack[0] in _RESULTS[kind])
    return mask


def _fits(stack: tuple[Kind, ...], name: str, word: Kind | None) -> bool:
    if word is not None:  # the argument of the next filter
        return stack[-1:] == ((Kind.EVENTS if word == Kind.ORDER else Kind.OBJECTS),)
    return name in ARITY and len(stack) >= ARITY[name] and (name, *stack[len(stack) - ARITY[name] :]) in DISPATCH
