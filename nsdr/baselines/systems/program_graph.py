"""Programs as a graph of network modules, for the baselines that are assembled by programs (IEP and TbD-net).

The program of a text is the question's, or the option's followed by the question's; then `belong_to` joins the two values. A
step is an instruction: a module with its attribute or order word, such as "filter_color red". Equal steps about one video are
one node, so what several texts have in common is computed once.
"""

from collections import defaultdict
from collections.abc import Callable
from functools import cache, lru_cache
from itertools import product
from typing import NamedTuple

import torch
from torch import Tensor

from nsdr.baselines.data import PAD, PROGRAM_SEPARATOR
from nsdr.errors import ProgramError
from nsdr.question_parser.tokenizer import decoder_tokens
from nsdr.symbolic.modules import MODULES, program_words
from nsdr.symbolic.program import ANSWER_KINDS, Program
from nsdr.world.vocabulary import Vocabulary

MALFORMED = "malformed"
"""The instruction, without arguments, that stands for a program that is cut off, ill-typed or without an answer."""


@cache
def instructions(vocabulary: Vocabulary) -> dict[str, int]:
    """Number of arguments (0-2) of every instruction of the data set's programs, and of `MALFORMED`."""
    table, kinds = {MALFORMED: 0}, program_words(vocabulary)
    words = {kind: [word for word, of in kinds.items() if of == kind] for kind in kinds.values()}
    for module in (m for m in MODULES.values() if m.in_data_set):
        choices = [words[kinds[0]] for kinds in module.arguments if kinds[0] in words]
        for chosen in product(*choices):
            table[" ".join((module.name, *chosen))] = len(module.arguments) - len(chosen)
    return table


class Node(NamedTuple):
    """A value to compute.

    Attributes:
        instruction: key of `instructions`.
        video: row of the video.
        inputs: indices of the nodes whose values are the arguments; all of them are earlier nodes.
    """

    instruction: str
    video: int
    inputs: tuple[int, ...]


class ProgramGraph(NamedTuple):
    """Programs of B texts.

    Attributes:
        nodes: every value of any text, once.
        texts: for each text, the indices of its nodes in the program's order; the last node has the value of the program.
    """

    nodes: list[Node]
    texts: list[list[int]]


def program_graph(programs: Tensor, videos: Tensor, vocabulary: Vocabulary) -> ProgramGraph:
    """The graph of B programs.

    Args:
        programs: (B, P) int64 token indices, as `Batch.program`.
        videos: (B,) int64 rows of the texts' videos.
        vocabulary: of the tokens.
    """
    index: dict[Node, int] = {}
    texts = []
    for tokens, video in zip(programs.tolist(), videos.tolist(), strict=True):
        text: list[int] = []
        for instruction, inputs in _steps(tuple(tokens), vocabulary):
            node = Node(instruction, video, tuple([text[i] for i in inputs]))
            text.append(index.setdefault(node, len(index)))
        texts.append(text)
    return ProgramGraph(list(index), texts)


Run = Callable[[str, Tensor, list[Tensor]], Tensor]
"""Runs N nodes of one instruction: (instruction, (N,) rows of their videos, one (N, ...) tensor per argument) -> (N, ...)."""


def execute(graph: ProgramGraph, run: Run, device: torch.device) -> list[Tensor]:
    """Compute the value (F, h, w, channels) of every node, level by level: all nodes with one instruction in one call.

    Args:
        graph: the programs.
        run: the network's modules.
        device: the device of the indices that are given to `run`.
    """
    levels: list[int] = []
    groups: dict[tuple[int, str], list[int]] = defaultdict(list)
    for index, node in enumerate(graph.nodes):
        levels.append(1 + max([levels[i] for i in node.inputs], default=-1))
        groups[levels[index], node.instruction].append(index)
    values: dict[int, Tensor] = {}
    for (_, instruction), members in sorted(groups.items()):
        nodes = [graph.nodes[i] for i in members]
        inputs = zip(*[n.inputs for n in nodes], strict=True)
        arguments = [torch.stack([values[i] for i in of_argument]) for of_argument in inputs]
        videos = torch.tensor([n.video for n in nodes], device=device)
        values.update(zip(members, run(instruction, videos, arguments).unbind(), strict=True))
    return [values[i] for i in range(len(graph.nodes))]


@lru_cache(maxsize=1 << 16)
def _steps(tokens: tuple[int, ...], vocabulary: Vocabulary) -> tuple[tuple[str, tuple[int, ...]], ...]:
    """The instructions of a text's program, each with the steps of its arguments; `MALFORMED` alone if there is no program."""
    try:
        program = _program(tokens, vocabulary)
    except ProgramError:
        return ((MALFORMED, ()),)
    steps: list[tuple[str, tuple[int, ...]]] = []
    place: dict[int, int] = {}
    for index, step in enumerate(program.steps):
        if step.module is not None:
            words = [program.tokens[i] for i in step.inputs if i not in place]
            place[index] = len(steps)
            steps.append((" ".join((step.token, *words)), tuple([place[i] for i in step.inputs if i in place])))
    return tuple(steps)


def _program(tokens: tuple[int, ...], vocabulary: Vocabulary) -> Program:
    """The program that answers a text; raises `ProgramError` where there is none."""
    end = len(tokens)
    while end and tokens[end - 1] == PAD:
        end -= 1
    cut = tokens.index(PROGRAM_SEPARATOR) if PROGRAM_SEPARATOR in tokens else end
    names = decoder_tokens(vocabulary)
    question, choice = ([names[i] for i in part] for part in (tokens[:cut], tokens[cut + 1 : end]))
    if not (MODULES.keys() | program_words(vocabulary).keys()).issuperset(question + choice):
        raise ProgramError("a token is neither a module nor a word")
    program = Program.parse(question, vocabulary)
    if cut != end:
        program = Program.parse(choice, vocabulary).then(program)
    if program.needs_choice or program.result not in ANSWER_KINDS:
        raise ProgramError("the program gives no answer")
    return program
