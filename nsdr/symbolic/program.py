"""Programs: postfix token lists, checked against the signature table before they run."""

import ast
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any, NamedTuple

from nsdr.errors import ProgramError
from nsdr.io.limits import limits
from nsdr.io.notes import distinct
from nsdr.symbolic.modules import ARITY, DISPATCH, EXTENSION_WORDS, MODULES, Kind, Module, program_words
from nsdr.world.vocabulary import CLEVRER, Vocabulary, indefinite

START_TOKENS = ("<START>", "<start>")
"""Tokens before a program in the released files of parsed programs; skipped."""
STOP_TOKENS = ("<END>", "<NULL>", "<end>", "<null>")
"""Tokens after a program in these files; they and what follows are skipped."""

RESEARCH_NAMES = {
    "query_frame": "get_frame",
    "query_object": "get_object",
    "query_collision_partner": "get_col_partner",
    "filter_counterfact": "get_counterfact",
    "filter_resting": "filter_stationary",
}
"""The released executor's names -> the data set's tokens; it also writes `events filter_start` and `events filter_end` for
`start` and `end`."""

ANSWER_KINDS = (
    *(Kind.NUMBER, Kind.BOOLEAN, Kind.COLOR, Kind.MATERIAL, Kind.SHAPE),
    *(Kind.DIRECTION, Kind.SPEED, Kind.NAME),
)
"""Result types that are words, numbers or truth values."""
SAID_KINDS = (*ANSWER_KINDS, Kind.FRAME, Kind.EVENTS, Kind.DESCRIPTION)
"""Result types of programs of descriptive questions."""
TOLD_KINDS = (Kind.EVENTS, Kind.DESCRIPTION)
"""Those of them whose answers have several lines."""
CHOICE_KINDS = (Kind.EVENT, Kind.OBJECT)
"""Result types of programs of choices."""


class Step(NamedTuple):
    """A type-checked token.

    Attributes:
        token: the token in the data set's spelling.
        module: the module that runs; None for a word, which is its own value.
        inputs: indices of the steps that give the arguments; -1 is the choice of a multiple-choice question.
        kind: type of the result.
    """

    token: str
    module: Module | None
    inputs: tuple[int, ...]
    kind: Kind


@dataclass(frozen=True)
class Program:
    """A well-typed program, built with `Program.parse`.

    There are three sorts: programs that answer a question (`result` is a number, truth value or attribute), programs of
    choices (`result` is an event or object), and programs that judge a choice (`needs_choice`).

    Programs with equal tokens are equal. Pickling and copying keep the tokens, which are parsed again, their vocabulary and the
    notes.

    Attributes:
        tokens: postfix tokens in the data set's spelling.
        steps: one per token.
        needs_choice: whether its `belong_to` takes the event or object of a choice.
        notes: what a user should know about how a parser read the program's text, one sentence each.
        vocabulary: of its attribute words.
    """

    tokens: tuple[str, ...]
    steps: tuple[Step, ...] = field(repr=False, compare=False)
    needs_choice: bool = field(default=False, compare=False)
    notes: tuple[str, ...] = field(default=(), repr=False, compare=False)
    vocabulary: Vocabulary = field(default=CLEVRER, repr=False, compare=False)

    @property
    def result(self) -> Kind:
        """Type of the program's result."""
        return self.steps[-1].kind

    @classmethod
    def parse(cls, source: "ProgramSource", vocabulary: Vocabulary = CLEVRER) -> "Program":
        """Parse and check a program.

        Args:
            source: see `program_tokens`.
            vocabulary: of its attribute words.

        Raises:
            ProgramError: an unknown token, a wrong type, or values left over; names the token and its number.
        """
        return source if isinstance(source, Program) else _checked(program_tokens(source), vocabulary)

    def then(self, question: "Program") -> "Program":
        """Join this choice and a multiple-choice question into one program, which judges the choice.

        Raises:
            ProgramError: this is not the program of a choice, or `question` does not judge one.
        """
        if self.result not in CHOICE_KINDS:
            raise ProgramError(f"the choice's program gives {indefinite(self.result)}; expected an event or object")
        if not question.needs_choice:
            raise ProgramError("the question's program takes no choice; expected one that ends in belong_to")
        return _checked(self.tokens + question.tokens, self.vocabulary).with_notes(*self.notes, *question.notes)

    def with_notes(self, *notes: str) -> "Program":
        """The same program with further notes."""
        return replace(self, notes=distinct(self.notes, notes)) if notes else self

    def __str__(self) -> str:
        return " ".join(self.tokens)

    def __reduce__(self) -> tuple[Any, ...]:
        return _restored, (self.tokens, self.notes, self.vocabulary)


def _restored(tokens: tuple[str, ...], notes: tuple[str, ...], vocabulary: Vocabulary) -> Program:
    return _checked(tokens, vocabulary).with_notes(*notes)


CALLS = re.compile(r"[a-z_\s(),'\"]*")
"""A program that is written as calls has these characters only."""
CACHED_PROGRAMS = 1 << 16
"""Number of parsed programs that are kept in memory."""


@lru_cache(maxsize=CACHED_PROGRAMS)
def _checked(tokens: tuple[str, ...], vocabulary: Vocabulary) -> Program:
    if not tokens:
        raise ProgramError("the program is empty")
    words = program_words(vocabulary) | EXTENSION_WORDS
    steps: list[Step] = []
    stack: list[int] = []
    needs_choice = False
    for index, token in enumerate(tokens):
        if token in words:
            steps.append(Step(token, None, (), words[token]))
        else:
            arity = ARITY.get(token)
            if arity is None:
                hint = "" if index else "; a question in English is asked with pipeline.answer(scene, question)"
                raise ProgramError(f"token {index + 1}: unknown module or word {token!r:.60}{hint}")
            if token == "belong_to" and len(stack) == 1 and not needs_choice:
                needs_choice = True
                stack.insert(0, -1)
            if len(stack) < arity:
                raise ProgramError(f"token {index + 1} {token!r}: takes {arity} arguments, found {len(stack)}")
            inputs = tuple(stack[len(stack) - arity :])
            del stack[len(stack) - arity :]
            kinds = tuple([Kind.EVENT if i < 0 else steps[i].kind for i in inputs])
            found = DISPATCH.get((token, *kinds))
            if found is None:
                raise ProgramError(f"token {index + 1} {token!r}: {_mismatch(MODULES[token], kinds)}")
            module, result = found
            steps.append(Step(token, module, inputs, result))
        stack.append(index)
    if len(stack) != 1:
        raise ProgramError(f"{len(stack)} values are left on the stack; expected one (is the program complete?)")
    if steps[-1].module is None:
        raise ProgramError(f"the program ends in the word {tokens[-1]!r}; expected a module")
    return Program(tokens, tuple(steps), needs_choice, (), vocabulary)


def _mismatch(module: Module, kinds: tuple[Kind, ...]) -> str:
    for number, (kind, allowed) in enumerate(zip(kinds, module.arguments, strict=True), 1):
        if kind not in allowed:
            return f"argument {number} is {kind}; expected {' or '.join(allowed)}"
    return f"does not take {' and '.join(kinds)}"


ProgramSource = str | Sequence[str] | Program
"""A program, or its tokens: see `program_tokens`."""


def program_tokens(source: ProgramSource) -> tuple[str, ...]:
    """Postfix tokens of a program in the data set's names.

    Args:
        source: postfix tokens (a list, or a text separated by spaces or commas), or a text of calls such as
            `count(filter_collision(events, objects))`, in which `belong_to(unseen_events)` leaves out the choice. The names
            are those of the data set or of the released executor. `<START>` before postfix tokens, and `<END>` or `<NULL>`
            and what follows, are skipped.

    Raises:
        ProgramError: a token that is no text, calls that are malformed or have too few or too many arguments, or more tokens
            than `Limits.program_tokens`.
    """
    if isinstance(source, Program):
        return source.tokens
    if isinstance(source, str):
        text = source.lower()
        source = _postfix(text) if "(" in text else text.replace(",", " ").split()
    most = limits().program_tokens
    if len(source) > most:
        raise ProgramError(f"the program has more than {most} tokens; the limit program_tokens allows more")
    tokens: list[str] = []
    for token in source:
        if not isinstance(token, str):
            raise ProgramError(f"a token is {token!r:.60}; expected texts")
        if token in STOP_TOKENS:
            break
        if token in START_TOKENS:
            continue
        if token in ("filter_start", "filter_end") and tokens and tokens[-1] == "events":
            tokens[-1] = token.removeprefix("filter_")
        else:
            tokens.append(RESEARCH_NAMES.get(token, token))
    return tuple(tokens)


def _postfix(text: str) -> list[str]:
    """Postfix tokens of nested calls, which are written as in Python."""
    try:
        if not CALLS.fullmatch(text):
            raise SyntaxError
        return list(_tokens(ast.parse(text.strip(), mode="eval").body))
    except (SyntaxError, MemoryError, RecursionError) as e:
        raise ProgramError(f"{text!r:.60}: expected calls such as count(objects), with each bracket closed") from e


def _tokens(node: ast.expr) -> Iterator[str]:
    if isinstance(node, ast.Name):
        yield node.id
    elif isinstance(node, ast.Constant) and isinstance(node.value, str):
        yield node.value
    elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and not node.keywords:
        name, given = node.func.id, len(node.args)
        arity = ARITY.get(RESEARCH_NAMES.get(name, name))
        if arity is not None and given != arity and (name, given) != ("belong_to", 1):
            raise ProgramError(f"{name!r} takes {arity} arguments, found {given}")
        for argument in node.args:
            yield from _tokens(argument)
        yield name
    else:
        raise ProgramError(f"{ast.unparse(node)!r:.60}: expected a call, a module or a word")
