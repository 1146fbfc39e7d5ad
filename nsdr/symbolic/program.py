"""Programs: postfix token lists, checked against the signature table before they run."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache

from nsdr.errors import ProgramError
from nsdr.symbolic.modules import MODULES, OBJECT_BELONGS, WORDS, Kind, Module

__all__ = ["Program", "Step"]

RESEARCH_NAMES = {
    "query_frame": "get_frame",
    "query_object": "get_object",
    "query_collision_partner": "get_col_partner",
    "filter_counterfact": "get_counterfact",
    "filter_resting": "filter_stationary",
}
"""The research executor's names -> the data set's tokens; `events filter_start|filter_end` stand for `start|end`."""

ANSWER_KINDS = (Kind.NUMBER, Kind.BOOLEAN, Kind.COLOR, Kind.MATERIAL, Kind.SHAPE)
CHOICE_KINDS = (Kind.EVENT, Kind.OBJECT)


@dataclass(frozen=True)
class Step:
    """A checked token.

    Attributes:
        token: as written.
        module: what runs; None for a word, which stands for itself.
        inputs: indices of the steps that give its arguments; -1 is the choice of a multiple-choice question.
        kind: type of the result.
    """

    token: str
    module: Module | None
    inputs: tuple[int, ...]
    kind: Kind


@dataclass(frozen=True)
class Program:
    """A well-typed program.

    Build it with `Program.parse`. A program is one of three: it answers a question (`result` is a number, truth value or
    attribute); it names a choice (`result` is an event or object); or it judges a choice (`needs_choice`).

    Attributes:
        tokens: postfix tokens in the data set's spelling.
        steps: one for each token.
        needs_choice: its `belong_to` waits for a choice's event or object.
    """

    tokens: tuple[str, ...]
    steps: tuple[Step, ...] = field(repr=False, compare=False)
    needs_choice: bool = field(default=False, compare=False)

    @property
    def result(self) -> Kind:
        """Type of the program's result."""
        return self.steps[-1].kind

    @classmethod
    def parse(cls, source: "str | Sequence[str] | Program") -> "Program":
        """Read a program in any of the three spellings.

        Args:
            source: postfix tokens (a list, or a string with spaces or commas), with the data set's or the research
                executor's names; or a tree as in the paper, `Count(Filter_shape(Objects, "cube"))`.

        Raises:
            ProgramError: an unknown token, a wrong type, or values left over; names the token and its place.
        """
        if isinstance(source, Program):
            return source
        if isinstance(source, str):
            source = _tree_tokens(source) if re.search(r"[()]", source) else re.findall(r"[^\s,]+", source)
        return _checked(tuple(source))

    def then(self, question: "Program") -> "Program":
        """This choice, judged by a multiple-choice question: one program.

        Raises:
            ProgramError: this is no choice, or `question` does not judge one.
        """
        if self.result not in CHOICE_KINDS:
            raise ProgramError(f"the choice's program gives a {self.result}; expected an event or object")
        if not question.needs_choice:
            raise ProgramError("the question's program takes no choice; expected one that ends in belong_to")
        return _checked(self.tokens + question.tokens)

    def tree(self) -> str:
        """The program as the paper writes it, such as `Count(Filter_shape(Objects, "cube"))`."""
        texts: list[str] = []
        for step in self.steps:
            if step.module is None:
                texts.append(f'"{step.token}"')
                continue
            arguments = ["Choice" if i < 0 else texts[i] for i in step.inputs]
            name = step.token.capitalize()
            texts.append(f"{name}({', '.join(arguments)})" if arguments else name)
        return texts[-1]

    def __str__(self) -> str:
        return " ".join(self.tokens)


@lru_cache(maxsize=65536)
def _checked(source: tuple[str, ...]) -> Program:
    tokens = _data_set_names(source)
    if not tokens:
        raise ProgramError("the program is empty")
    steps: list[Step] = []
    stack: list[int] = []
    needs_choice = False
    for place, token in enumerate(tokens):
        if token in WORDS:
            steps.append(Step(token, None, (), WORDS[token]))
        elif token in MODULES:
            module = MODULES[token]
            arity = len(module.arguments)
            if token == "belong_to" and len(stack) == 1 and not needs_choice:
                needs_choice = True
                stack.insert(0, -1)
            if len(stack) < arity:
                raise ProgramError(f"token {place + 1} {token!r}: takes {arity} arguments, found {len(stack)}")
            inputs = tuple(stack[len(stack) - arity :])
            del stack[len(stack) - arity :]
            kinds = [Kind.EVENT if i < 0 else steps[i].kind for i in inputs]
            for number, (kind, allowed) in enumerate(zip(kinds, module.arguments, strict=True), 1):
                if kind not in allowed:
                    expected = " or ".join(allowed)
                    raise ProgramError(f"token {place + 1} {token!r}: argument {number} is {kind}; expected {expected}")
            if token == "belong_to" and kinds[0] == Kind.OBJECT:
                module = OBJECT_BELONGS
            result = module.result or (Kind.OBJECT if kinds[0] == Kind.OBJECTS else Kind.EVENT)
            steps.append(Step(token, module, inputs, result))
        else:
            raise ProgramError(f"token {place + 1}: unknown module or word {token!r}")
        stack.append(place)
    if len(stack) != 1:
        raise ProgramError(f"{len(stack)} values are left at the end; expected one (is the program complete?)")
    if steps[-1].module is None:
        raise ProgramError(f"the program ends in the word {tokens[-1]!r}; expected a module")
    return Program(tokens, tuple(steps), needs_choice)


def _data_set_names(source: tuple[str, ...]) -> tuple[str, ...]:
    tokens: list[str] = []
    for token in source:
        if token in ("filter_start", "filter_end") and tokens and tokens[-1] == "events":
            tokens[-1] = token.removeprefix("filter_")
        else:
            tokens.append(RESEARCH_NAMES.get(token, token))
    return tuple(tokens)


_TREE_TOKEN = re.compile(r"\s*(?:([(),])|\"([^\"]*)\"|'([^']*)'|([\w]+))")


def _tree_tokens(text: str) -> tuple[str, ...]:
    """Postfix tokens of a tree. Each call is written after its arguments."""
    tokens: list[str] = []
    calls: list[str] = []
    name, place = "", 0
    while text[place:].strip():
        match = _TREE_TOKEN.match(text, place)
        if match is None:
            raise ProgramError(f"cannot read the program at {text[place : place + 20]!r}")
        place = match.end()
        mark, *words = match.groups()
        if mark == "(":
            calls.append(name)
            name = ""
            continue
        if mark and name:
            tokens.append(name)
            name = ""
        if mark == ")":
            if not calls:
                raise ProgramError("the program has a ) without its (")
            tokens.append(calls.pop())
        elif not mark:
            name = next(w for w in words if w is not None).lower()
            if name == "choice":
                name = ""
    if calls:
        raise ProgramError(f"the program has {len(calls)} ( without their )")
    return (*tokens, name) if name else tuple(tokens)
