"""Programs as a graph of network modules, for the baselines that a program assembles (IEP and TbD-net).

A text's program is the question's, or the option's followed by the question's, whose `belong_to` then joins the two values. A
step is an instruction: a module with its attribute or order word, such as "filter_color red". Equal steps about one video are
one node, so what texts have in common is computed once.
"""

from collections import defaultdict
from collections.abc import Callable
from functools import lru_cache
from itertools import product
from typing import NamedTuple

import torch
from torch import Tensor

from nsdr.baselines.vocabulary import PAD, PROGRAM_SEPARATOR
from nsdr.errors import ProgramError
from nsdr.question_parser.tokenizer import PROGRAM_TOKENS
from nsdr.symbolic.modules import MODULES, WORDS, Kind
from nsdr.symbolic.program import ANSWER_KINDS, Program

__all__ = ["INSTRUCTIONS", "MALFORMED", "Node", "ProgramGraph", "execute", "program_graph"]

MALFORMED = "malformed"
"""The instruction without arguments that stands for a program that is cut off, ill-typed, or gives no answer."""


def _instructions() -> dict[str, int]:
    """Number of arguments by instruction, from the signature table."""
    table = {MALFORMED: 0}
    word_kinds = set(WORDS.values())
    for module in MODULES.values():
        takes_word = [kinds[0] in word_kinds for kinds in module.arguments]
        choices = [_words(kinds[0]) for kinds, is_word in zip(module.arguments, takes_word, strict=True) if is_word]
        if module.in_data_set:
            table.update({" ".join((module.name, *words)): takes_word.count(False) for words in product(*choices)})
    return table


def _words(kind: Kind) -> list[str]:
    return [word for word, of in WORDS.items() if of == kind]


INSTRUCTIONS = _instructions()
"""Number of arguments (0-2) of every instruction of the data set's programs, and of `MALFORMED`."""


class Node(NamedTuple):
    """A value to compute.

    Attributes:
        instruction: key of `INSTRUCTIONS`.
        video: row of the video.
        inputs: indices of the nodes that give the arguments, all of them earlier ones.
    """

    instruction: str
    video: int
    inputs: tuple[int, ...]


Step = tuple[str, tuple[int, ...]]
"""Instruction of a step of a program, and the steps that give its arguments."""


class ProgramGraph(NamedTuple):
    """Programs of B texts.

    Attributes:
        nodes: every value of any text, once.
        texts: for each text the indices of its nodes, in the program's order; the last one's value is the program's.
    """

    nodes: list[Node]
    texts: list[list[int]]


def program_graph(programs: Tensor, videos: Tensor) -> ProgramGraph:
    """The graph of B programs.

    Args:
        programs: (B, P) int64 token indices: the question's program, and for an option of `PROGRAM_SEPARATOR` and the option's;
            padded with `PAD`.
        videos: (B,) int64 rows of the texts' videos.
    """
    index: dict[Node, int] = {}
    texts = []
    for tokens, video in zip(programs.tolist(), videos.tolist(), strict=True):
        text: list[int] = []
        for instruction, inputs in _steps(tuple(tokens)):
            node = Node(instruction, video, tuple([text[i] for i in inputs]))
            text.append(index.setdefault(node, len(index)))
        texts.append(text)
    return ProgramGraph(list(index), texts)


Run = Callable[[str, Tensor, list[Tensor]], Tensor]
"""Runs N nodes of one instruction: (instruction, (N,) rows of their videos, one (N, ...) tensor per argument) -> (N, ...)."""


def execute(graph: ProgramGraph, run: Run, device: torch.device) -> list[Tensor]:
    """The value of every node: level by level, all nodes of one instruction in one call.

    Args:
        graph: the programs.
        run: the network's modules.
        device: where the rows of the videos are wanted.

    Returns:
        Of each node, as the module gives it for one node: (F, h, w, channels).
    """
    levels: list[int] = []
    groups: dict[tuple[int, str], list[int]] = defaultdict(list)
    for index, node in enumerate(graph.nodes):
        levels.append(1 + max([levels[i] for i in node.inputs], default=-1))
        groups[levels[index], node.instruction].append(index)
    values: dict[int, Tensor] = {}
    for level, instruction in sorted(groups):
        members = groups[level, instruction]
        nodes = [graph.nodes[i] for i in members]
        arguments = [
            torch.stack([values[i] for i in inputs]) for inputs in zip(*[n.inputs for n in nodes], strict=True)
        ]
        videos = torch.tensor([n.video for n in nodes], device=device)
        values.update(zip(members, run(instruction, videos, arguments).unbind(), strict=True))
    return [values[i] for i in range(len(graph.nodes))]


@lru_cache(maxsize=1 << 16)
def _steps(tokens: tuple[int, ...]) -> tuple[Step, ...]:
    """Steps of a text's program, words joined to the modules that take them; one `MALFORMED` for what is no program."""
    try:
        program = _program(tokens)
    except ProgramError:
        return ((MALFORMED, ()),)
    steps: list[Step] = []
    place: dict[int, int] = {}
    for index, step in enumerate(program.steps):
        if step.module is not None:
            words = [program.tokens[i] for i in step.inputs if i not in place]
            place[index] = len(steps)
            steps.append((" ".join((step.token, *words)), tuple([place[i] for i in step.inputs if i in place])))
    return tuple(steps)


def _program(tokens: tuple[int, ...]) -> Program:
    """The program that answers a text; raises `ProgramError` where there is none."""
    end = len(tokens)
    while end and tokens[end - 1] == PAD:
        end -= 1
    cut = tokens.index(PROGRAM_SEPARATOR) if PROGRAM_SEPARATOR in tokens else end
    question, choice = ([PROGRAM_TOKENS[i] for i in part] for part in (tokens[:cut], tokens[cut + 1 : end]))
    if not (MODULES.keys() | WORDS.keys()).issuperset(question + choice):
        raise ProgramError("a token is neither a module nor a word")
    program = Program.parse(question) if cut == end else Program.parse(choice).then(Program.parse(question))
    if program.needs_choice or program.result not in ANSWER_KINDS:
        raise ProgramError("the program gives no answer")
    return program
