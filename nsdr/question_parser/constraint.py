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
MAX_VALUES = 5
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
        elif _fits(stack, name):
            after = following(stack, i)
            assert after is not None
            mask[i] = len(after) <= MAX_VALUES and _can_end(after, kind)
    return mask


def _fits(stack: tuple[Kind, ...], name: str) -> bool:
    if name in WORDS:  # an argument of the filter that follows
        return bool(stack) and stack[-1] == (Kind.EVENTS if WORDS[name] == Kind.ORDER else Kind.OBJECTS)
    return name in ARITY and len(stack) >= ARITY[name] and (name, *stack[len(stack) - ARITY[name] :]) in DISPATCH


_RULES = [(key[1:], result) for key, (_, result) in DISPATCH.items() if key[0] in PROGRAM_TOKENS]
"""(kinds of the arguments, kind of the result) of the data set's modules."""


@lru_cache(maxsize=1)
def _from_nothing() -> frozenset[Kind]:
    """Kinds that some tokens leave on an empty stack."""
    found: set[Kind] = set(WORDS.values())
    while True:
        more = {result for arguments, result in _RULES if set(arguments) <= found}
        if more <= found:
            return frozenset(found)
        found |= more


@lru_cache(maxsize=64)
def _from_one(kind: Kind) -> frozenset[Kind]:
    """Kinds that a single value can be turned into by further tokens, itself included."""
    found, new = {kind}, _from_nothing()
    while True:
        more = {r for a, r in _RULES if a and a[0] in found and all(other in new for other in a[1:])}
        if more <= found:
            return frozenset(found)
        found |= more


@lru_cache(maxsize=4096)
def _can_end(stack: tuple[Kind, ...], kind: str) -> bool:
    """Whether further tokens can bring the values of a stack down to one answer."""
    on_top = _from_one(stack[-1])
    for below in stack[-2::-1]:
        joined = {r for a, r in _RULES if len(a) == 2 and a[0] == below and a[1] in on_top}
        on_top = frozenset().union(*map(_from_one, joined))
    return bool(on_top & _RESULTS[kind])
