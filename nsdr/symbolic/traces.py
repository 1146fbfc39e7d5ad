"""Execution traces as text and as trees, and probabilities in words."""

from collections.abc import Sequence

from nsdr.types import Answer, ChoiceAnswer, TraceStep


def format_trace(trace: Sequence[TraceStep]) -> str:
    """The trace as text, one step per line: number, module with the numbers of its inputs, and the result."""
    lines = []
    for number, step in enumerate(trace, 1):
        inputs = ", ".join(str(i + 1) for i in step.inputs)
        call = f"{step.module}({inputs})" if inputs else step.module
        lines.append(f"{number:>3}  {call:<26} {step.text}")
    return "\n".join(lines)


def format_probability(answer: Answer | ChoiceAnswer) -> str:
    """How probable it is that an answer or judgement is right, as " (98 %)"; "" where that is not known."""
    if answer.probability is None or answer.answer is None:
        return ""
    right = 1 - answer.probability if answer.answer == "wrong" else answer.probability
    return f" ({percent(right)})"


def percent(probability: float) -> str:
    """A probability (0-1) as "77 %", never as certainty."""
    rounded = round(100 * probability)
    return f"{'>99' if rounded == 100 else '<1' if rounded == 0 else rounded} %"


def format_tree(trace: Sequence[TraceStep]) -> str:
    """The trace as a tree with the answer at the root, each module with its result."""
    lines: list[str] = []

    def draw(index: int, first: str, following: str) -> None:
        step = trace[index]
        is_word = not step.inputs and step.module == step.text
        lines.append(first + (step.module if is_word else f"{step.module}: {step.text}"))
        for number, child in enumerate(step.inputs, 1):
            last = number == len(step.inputs)
            draw(child, following + ("└─ " if last else "├─ "), following + ("   " if last else "│  "))

    if trace:
        draw(len(trace) - 1, "", "")
    return "\n".join(lines)
