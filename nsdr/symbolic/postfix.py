"""Runs token lists as they are: no program is built, and the values wait on a stack.

A program is cut before every `objects` into phrases, such as `objects red filter_color unique filter_collision`. CLEVRER's
programs are made of a few thousand different ones. A phrase is type-checked and translated when it is first met after values of
given types; a table keeps the result, so that a new program of known phrases costs a look-up for each phrase. What the table
cannot translate is left to `Program.parse`, which says what is wrong.
"""

from collections.abc import Callable, Sequence
from typing import Any

from nsdr.io.limits import limits
from nsdr.symbolic.modules import ARITY, DISPATCH, WORDS, Kind, Module
from nsdr.symbolic.program import ANSWER_KINDS, STOP_TOKENS, Program, ProgramSource, data_set_names

__all__ = ["NotQuick", "PhraseTable", "PostfixRunner"]

MOST_PHRASES = 1 << 15
"""Phrases that a table keeps. CLEVRER's programs have a few thousand."""
MOST_RESULTS = 1 << 12
"""Values of programs and of constants that are kept for a scene, which has about 25 questions and choices in CLEVRER."""
CUT, END = " objects ", " <END>"
MASK, CONSTANT, UNARY, BINARY, WITH_WORD = range(-1, 4)
"""What a step does: intersect a set with one that depends on the scene alone, push such a value, or replace one value, two values,
or one beside a word."""

Step = tuple[int, Any, Any]
"""What it does, the module's function (of a constant or mask: its steps), and the word (of a constant or mask: its name)."""


class NotQuick(Exception):
    """A program that is wrong, or that the table does not translate."""


class _Types:
    """Types of the values on the stack, and what phrases make of them.

    Attributes:
        kinds: the types; a program that has ended has one.
        ended: whether the program has ended.
        answers: whether it ended in a word, number or truth value.
        following: the steps of each phrase met here, and the types after it.
    """

    def __init__(self, kinds: tuple[Kind, ...], ended: bool = False) -> None:
        self.kinds, self.ended = kinds, ended
        self.answers = ended and kinds[0] in ANSWER_KINDS
        self.following: dict[str, tuple[Sequence[Step], _Types]] = {}


class PhraseTable:
    """The phrases met so far, of one semantics.

    Args:
        function: gives the function of a module, called as `function(world, *arguments)`.
        masks: whether values are those of the signature table, so that `Module.mask` applies.
    """

    def __init__(self, function: Callable[[Module], Callable[..., Any]], masks: bool) -> None:
        self._function, self._masks = function, masks
        self._types: dict[tuple[tuple[Kind, ...], bool], _Types] = {}
        self._n_phrases = 0
        self.start = self._typed((), False)

    def add(self, types: _Types, phrase: str) -> tuple[Sequence[Step], _Types]:
        """The steps of a phrase that starts from `types`, and the types after it.

        Raises:
            NotQuick: it does not fit the types, or the table is full.
        """
        tokens = phrase.split(" ")
        ends = tokens[-1] == END.strip()
        tokens = tokens[:-1] if ends else tokens
        if types is not self.start:
            tokens = [CUT.strip(), *tokens]
        if types.ended or self._n_phrases >= MOST_PHRASES or not set(tokens).isdisjoint(STOP_TOKENS):
            raise NotQuick
        steps, kinds = self._translated(types.kinds, data_set_names(tokens))
        if ends and len(kinds) != 1:
            raise NotQuick
        self._n_phrases += 1
        types.following[phrase] = found = (steps, self._typed(kinds, ends))
        return found

    def _typed(self, kinds: tuple[Kind, ...], ended: bool) -> _Types:
        return self._types.setdefault((kinds, ended), _Types(kinds, ended))

    def _translated(self, before: Sequence[Kind], tokens: Sequence[str]) -> tuple[list[Step], tuple[Kind, ...]]:
        kinds, steps = list(before), list[Step]()
        constants: list[tuple[str, list[Step]]] = []  # the last values, with their names; words have no steps
        for token in tokens:
            if token in WORDS:
                kinds.append(WORDS[token])
                constants.append((token, []))
                continue
            first = len(kinds) - ARITY.get(token, len(kinds) + 1)
            found = DISPATCH.get((token, *kinds[first:])) if first >= 0 else None
            if found is None:
                raise NotQuick
            n_values = len(kinds) - first
            kinds[first:] = [found[1]]
            word = constants.pop()[0] if n_values and constants and not constants[-1][1] else None
            n_values -= word is not None
            function = self._function(found[0])
            step: Step = (WITH_WORD if word else n_values, function, word)
            if n_values <= len(constants):
                inputs = [constants.pop() for _ in range(n_values)][::-1]
                name = " ".join([name for name, _ in inputs] + [word] * bool(word) + [token])
                constants.append((name, [s for _, inner in inputs for s in inner] + [step]))
            elif self._masks and found[0].mask and n_values == 2 and len(constants) == 1:
                name, inner = constants.pop()
                steps.append((MASK, [*inner, (UNARY, found[0].mask, None)], f"{name} {token}"))
            else:
                steps += [*map(_pushed, constants), step]
                constants = []
        return [*steps, *map(_pushed, constants)], tuple(kinds)


def _pushed(constant: tuple[str, list[Step]]) -> Step:
    name, steps = constant
    if not steps:
        raise NotQuick  # a word that no module takes
    return CONSTANT, steps, name


class PostfixRunner:
    """Runs token lists on one scene. Values that depend on the scene alone, such as a described object, are kept.

    Args:
        table: phrases of the semantics.
        world: what the modules' functions take first.
    """

    def __init__(self, table: PhraseTable, world: Any) -> None:
        self._table, self._world = table, world
        self._constants: dict[str, Any] = {}
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
        known = self._results.get(text)
        if known is not None:
            return known
        world, table, constants = self._world, self._table, self._constants
        types, stack = table.start, list[Any]()
        for phrase in text.split(CUT):
            steps, types = types.following.get(phrase) or table.add(types, phrase)
            for what, function, extra in steps:
                if what <= CONSTANT:
                    value = constants.get(extra)
                    if value is None:
                        value = constants[extra] = _constant(function, world)
                    if what == MASK:
                        stack[-1] &= value
                    else:
                        stack.append(value)
                elif what == UNARY:
                    stack[-1] = function(world, stack[-1])
                elif what == BINARY:
                    top = stack.pop()
                    stack[-1] = function(world, stack[-1], top)
                else:
                    stack[-1] = function(world, stack[-1], extra)
        if not types.ended:
            raise NotQuick
        if len(self._results) + len(constants) > MOST_RESULTS:
            self._results.clear()
            constants.clear()
        self._results[text] = result = (stack[0], types.kinds[0], types.answers)
        return result

    def _text(self, source: ProgramSource) -> str:
        """The tokens with spaces between them, and an end."""
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
        return text + END


def _constant(steps: Sequence[Step], world: Any) -> Any:
    """The value of a constant. Its first step takes nothing."""
    stack: list[Any] = []
    for what, function, word in steps:
        if what == CONSTANT:
            stack.append(function(world))
        elif what == UNARY:
            stack[-1] = function(world, stack[-1])
        elif what == WITH_WORD:
            stack[-1] = function(world, stack[-1], word)
        else:
            top = stack.pop()
            stack[-1] = function(world, stack[-1], top)
    return stack[0]
