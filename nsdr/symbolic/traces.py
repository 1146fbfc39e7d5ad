"""Execution traces as text and as trees."""

from collections.abc import Sequence

from nsdr.types import TraceStep


def format_trace(trace: Sequence[TraceStep]) -> str:
    """The trace as text, one step per line: number, module with the numbers of its inputs, and the result."""
    lines = []
    for number, step in enumerate(trace, 1):
        inputs = ", ".join(str(i + 1) for i in step.inputs)
        call = f"{step.module}({inputs})" if inputs else step.module
        lines.append(f"{number:>3}  {call:<26} {step.text}")
    return "\n".join(lines)


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
