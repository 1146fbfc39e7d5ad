"""Which program token may come next, by the signature table: decoding under it gives well-typed programs only."""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from nsdr.question_parser.tokenizer import END, OTHER, PROGRAM_TOKENS
from nsdr.symbolic.modules import ARITY, DISPATCH, WORDS, Kind

__all__ = ["Stack", "allowed", "first_stack", "following"]

Stack = tuple[Kind, ...] | None
"""Kinds of the values a half program leaves on the stack; None after the token that stands for "another kind of text"."""
_ANSWERS = {Kind.NUMBER, Kind.BOOLEAN, Kind.COLOR, Kind.MATERIAL, Kind.SHAPE}
_RESULTS = {
    "descriptive": _ANSWERS,
    "multiple_choice": {Kind.BOOLEAN},
    "choice": {Kind.OBJECT, Kind.EVENT},
}
MOST_VALUES = 5
"""No program of the grammar holds more values at a time."""


def first_stack(kind: str) -> Stack:
    """Before the first token. A multiple-choice question goes on from a choice's event or object."""
    return (Kind.EVENT,) if kind == "multiple_choice" else ()


@lru_cache(maxsize=4096)
def following(stack: Stack, token: int) -> Stack:
    """The stack after a token that `allowed` permits."""
    name = PROGRAM_TOKENS[token]
    if stack is None or name == OTHER:
        return None
    if name in WORDS:
        return (*stack, WORDS[name])
    arity = ARITY[name]
    arguments = stack[len(stack) - arity :]
    return (*stack[: len(stack) - arity], DISPATCH[(name, *arguments)][1])


@lru_cache(maxsize=4096)
def allowed(stack: Stack, kind: str, at_start: bool) -> NDArray[np.bool_]:
    """(n_tokens,) bool: which tokens may follow. `kind` is the kind of text, `at_start` whether no token was decoded yet."""
    mask = np.zeros(len(PROGRAM_TOKENS), bool)
    if stack is None:
        mask[END] = True
        return mask
    mask[END] = not at_start and len(stack) == 1 and stack[0] in _RESULTS[kind]
    for i, name in enumerate(PROGRAM_TOKENS):
        if name == OTHER:
            mask[i] = at_start
        elif name in WORDS:
            # A word is an argument of the filter that follows.
            mask[i] = bool(stack) and stack[-1] == (Kind.EVENTS if WORDS[name] == Kind.ORDER else Kind.OBJECTS)
        elif name in ARITY and len(stack) >= ARITY[name]:
            grows = ARITY[name] == 0
            fits = (name, *stack[len(stack) - ARITY[name] :]) in DISPATCH
            mask[i] = fits and not (grows and len(stack) >= MOST_VALUES)
    if not mask.any():  # values that nothing takes: the program ends ill-typed, and is refused
        mask[END] = True
    return mask
