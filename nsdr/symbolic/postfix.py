"""Runs token lists as they are: no program is built, and the values wait on a stack.

A program is cut before every `objects` into phrases, and a phrase that describes one object, such as `objects red filter_color
unique filter_collision`, into the description, whose value a scene keeps, and what follows. CLEVRER's programs are made of
a few hundred different ones. Each is type-checked and translated when it is first met after values of given types; a table
keeps the result. What the table cannot translate is left to `Program.parse`, which says what is wrong.
"""

from collections.abc import Callable, Sequence
from typing import Any

from nsdr.io.limits import limits
from nsdr.symbolic.modules import ARITY, DISPATCH, WORDS, Kind, Module
from nsdr.symbolic.program import ANSWER_KINDS, STOP_TOKENS, Program, ProgramSource, data_set_names

__all__ = ["NotQuick", "PhraseTable", "PostfixRunner"]

MOST_PHRASES = 1 << 14
"""Phrases that a table keeps. CLEVRER's programs have a few hundred."""
MOST_RESULTS = 1 << 12
"""Values of programs that are kept for a scene, which has about 25 questions and choices in CLEVRER."""
OBJECTS, UNIQUE, END = " objects ", " unique ", " <END>"
NULLARY, UNARY, BINARY, WITH_WORD = range(4)
"""What a step does: push a value, or replace one value, two values, or one beside a word."""

Step = tuple[int, Callable[..., Any], str | None]
"""What it does, the module's function, and the word."""


class NotQuick(Exception):
    """A program that is wrong, or that the table does not translate."""


class _Types:
    """Types of the values on the stack, and what phrases make of them.

    Attributes:
        kinds: the types; a program that has ended has one.
        ended: whether the program has ended.
        answers: whether it ended in a word, number or truth value.
        following: the steps of each phrase met here, and the types after it.
        with_object: the types with an object on top.
    """

    def __init__(self, kinds: tuple[Kind, ...], ended: bool = False) -> None:
        self.kinds, self.ended = kinds, ended
        self.answers = ended and kinds[0] in ANSWER_KINDS
        self.following: dict[str, tuple[Sequence[Step], _Types]] = {}
        self.with_object: _Types | None = None


class PhraseTable:
    """The phrases met so far, of one semantics.

    Args:
        function: gives the function of a module, called as `function(world, *arguments)`.
    """

    def __init__(self, function: Callable[[Module], Callable[..., Any]]) -> None:
        self._function = function
        self._types: dict[tuple[tuple[Kind, ...], bool], _Types] = {}
        self._descriptions: dict[str, list[Step]] = {}
        self._n_phrases = 0
        self.start = self._typed((), False)

    def add(self, types: _Types, phrase: str) -> tuple[Sequence[Step], _Types]:
        """The steps of a phrase that starts from `types`, and the types after it.

        Raises:
            NotQuick: it does not fit the types, or the table is full.
        """
        tokens = phrase.split(" ")
        ends = tokens[-1] == END.strip()
        tokens = tokens[: len(tokens) - ends]
        if types.ended or self._n_phrases >= MOST_PHRASES or not tokens or tokens[-1] in WORDS:
            raise NotQuick
        steps, kinds = self._translated(types.kinds, tokens)
        if ends and len(kinds) != 1:
            raise NotQuick
        self._n_phrases += 1
        types.following[phrase] = found = (steps, self._typed(kinds, ends))
        return found

    def description(self, description: str) -> Sequence[Step] | None:
        """The steps of one object's description without its `objects` and `unique`; None where that is no description."""
        known = self._descriptions.get(description)
        if known is None:
            try:
                steps, kinds = self._translated((), ["objects", *description.split(" "), "unique"])
            except NotQuick:
                return None
            known = self._descriptions[description] = steps if kinds == (Kind.OBJECT,) else []
            if len(self._descriptions) > MOST_PHRASES:
                self._descriptions.clear()
        return known or None

    def add_object(self, types: _Types) -> _Types:
        """The types with an object on top."""
        types.with_object = self._typed((*types.kinds, Kind.OBJECT), False)
        return types.with_object

    def _typed(self, kinds: tuple[Kind, ...], ended: bool) -> _Types:
        return self._types.setdefault((kinds, ended), _Types(kinds, ended))

    def _translated(self, before: Sequence[Kind], tokens: Sequence[str]) -> tuple[list[Step], tuple[Kind, ...]]:
        """Steps, and the types after them; raises `NotQuick` where the tokens do not fit."""
        if not set(STOP_TOKENS).isdisjoint(tokens):
            raise NotQuick
        kinds, steps, word = list(before), list[Step](), None
        for token in data_set_names(tokens):
            kind = WORDS.get(token)
            if kind is None:
                first = len(kinds) - ARITY.get(token, len(kinds) + 1)
                found = DISPATCH.get((token, *kinds[first:])) if first >= 0 else None
                if found is None or found[0].extension:
                    raise NotQuick
                what = WITH_WORD if word else len(kinds) - first
                kinds[first:] = [found[1]]
                steps.append((what, self._function(found[0]), word))
            else:
                kinds.append(kind)
            if kind is not None and word is not None:
                raise NotQuick  # a word that no module takes
            word = None if kind is None else token
        return steps, tuple(kinds)


class PostfixRunner:
    """Runs token lists on one scene.

    Args:
        table: phrases of the semantics.
        world: what the modules' functions take first.
    """

    def __init__(self, table: PhraseTable, world: Any) -> None:
        self._table, self._world = table, world
        self._described: dict[str, Any] = {}
        self._results: dict[str, tuple[Any, Kind, bool]] = {}
        self._most_tokens = limits().program_tokens

    def run(self, source: ProgramSource) -> tuple[Any, Kind, bool]:
        """Run a program.

        Returns:
            Its value, the type, and whether it is a word, number or truth value.

        Raises:
            NotQuick: `Program.parse` must read the program.
            ExecutionError: a step failed.
        """
        text = self._text(source)
        result = self._results.get(text)
        if result is not None:
            return result
        world, table, described = self._world, self._table, self._described
        types, stack = table.start, list[Any]()
        before, *phrases = text.split(OBJECTS)
        if before:
            before = before[1:]
            steps, types = types.following.get(before) or table.add(types, before)
            _execute(steps, stack, world)
        for phrase in phrases:
            description, _, rest = phrase.partition(UNIQUE)
            value = described.get(description)
            if value is None:
                value = self._describe(description)
            if value is False:
                rest = f"objects {phrase}"
            else:
                stack.append(value)
                types = types.with_object or table.add_object(types)
            steps, types = types.following.get(rest) or table.add(types, rest)
            _execute(steps, stack, world)
        if not types.ended:
            raise NotQuick
        if len(self._results) >= MOST_RESULTS:
            self._results.clear()
            described.clear()
        self._results[text] = result = (stack[0], types.kinds[0], types.answers)
        return result

    def _describe(self, description: str) -> Any:
        """The one object of a description without its `objects` and `unique`; False where that is no description."""
        value: Any = False
        steps = self._table.description(description)
        if steps is not None:
            stack: list[Any] = []
            _execute(steps, stack, self._world)
            value = stack[0]
        self._described[description] = value
        return value

    def _text(self, source: ProgramSource) -> str:
        """The tokens with spaces around them, and an end."""
        if type(source) is str:
            text, n_spaces = source, source.count(" ")
        else:
            if type(source) is Program:
                source = source.tokens
            elif type(source) is not list and type(source) is not tuple:
                raise NotQuick
            try:
                text = " ".join(source)
            except TypeError:
                raise NotQuick from None
            n_spaces = len(source) - 1
            if text.count(" ") != n_spaces:
                raise NotQuick
        if n_spaces >= self._most_tokens:
            raise NotQuick
        return f" {text}{END}"


def _execute(steps: Sequence[Step], stack: list[Any], world: Any) -> None:
    for what, function, word in steps:
        if what == BINARY:
            top = stack.pop()
            stack[-1] = function(world, stack[-1], top)
        elif what == UNARY:
            stack[-1] = function(world, stack[-1])
        elif what == NULLARY:
            stack.append(function(world))
        else:
            stack[-1] = function(world, stack[-1], word)
