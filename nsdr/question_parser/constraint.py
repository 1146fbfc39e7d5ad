"""Constrained decoding: the program tokens that the signature table permits next, so that only well-typed programs result."""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from nsdr.question_parser.tokenizer import END, OTHER, PROGRAM_TOKENS
from nsdr.symbolic.modules import ARITY, DISPATCH, WORDS, Kind

__all__ = ["Stack", "allowed", "first_stack", "following"]

Stack = tuple[Kind, ...] | None
"""Kinds of the values that the first tokens of a program leave on the stack; None after `OTHER`."""
_ANSWERS = {Kind.NUMBER, Kind.BOOLEAN, Kind.COLOR, Kind.MATERIAL, Kind.SHAPE}
_RESULTS = {
    "descriptive": _ANSWERS | {Kind.FRAME, Kind.EVENTS},
    "multiple_choice": {Kind.BOOLEAN},
    "choice": {Kind.OBJECT, Kind.EVENT},
}
MAX_VALUES = 5
"""Largest number of values on the stack; no program of the grammar needs more."""


def first_stack(kind: str) -> Stack:
    """The stack before the first token: a multiple-choice question starts with the value of its choice."""
    return (Kind.EVENT,) if kind == "multiple_choice" else ()


@lru_cache(maxsize=4096)
def following(stack: Stack, token: int) -> Stack:
    """The stack after a token, which has to be one that `allowed` permits."""
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
    """Which tokens may follow: (n_tokens,) bool.

    Args:
        stack: kinds of the values on the stack.
        kind: "descriptive", "multiple_choice" or "choice".
        at_start: whether no token has been decoded yet.
    """
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
    if name in WORDS:  # the argument of the next filter
        return bool(stack) and stack[-1] == (Kind.EVENTS if WORDS[name] == Kind.ORDER else Kind.OBJECTS)
    return name in ARITY and len(stack) >= ARITY[name] and (name, *stack[len(stack) - ARITY[name] :]) in DISPATCH


_RULES = [(key[1:], result) for key, (_, result) in DISPATCH.items() if key[0] in PROGRAM_TOKENS]
"""(kinds of the arguments, kind of the result) of the modules that CLEVRER's programs use."""


@lru_cache(maxsize=1)
def _from_nothing() -> frozenset[Kind]:
    """Kinds of the single values that a sequence of tokens can leave on an empty stack."""
    found: set[Kind] = set(WORDS.values())
    while True:
        more = {result for arguments, result in _RULES if set(arguments) <= found}
        if more <= found:
            return frozenset(found)
        found |= more


@lru_cache(maxsize=64)
def _from_one(kind: Kind) -> frozenset[Kind]:
    """Kinds of the single values that further tokens can make of a value of this kind, itself included."""
    found, new = {kind}, _from_nothing()
    while True:
        more = {r for a, r in _RULES if a and a[0] in found and all(other in new for other in a[1:])}
        if more <= found:
            return frozenset(found)
        found |= more


@lru_cache(maxsize=4096)
def _can_end(stack: tuple[Kind, ...], kind: str) -> bool:
    """Whether further tokens can reduce the values on a stack to a single result of the kind of text."""
    on_top = _from_one(stack[-1])
    for below in stack[-2::-1]:
        joined = {r for a, r in _RULES if len(a) == 2 and a[0] == below and a[1] in on_top}
        on_top = frozenset().union(*map(_from_one, joined))
    return bool(on_top & _RESULTS[kind])
