"""Sample results as in the paper's figures: a stroboscopic image with questions, programs and answers below it."""

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from nsdr.clevrer.files.questions import Question
from nsdr.types import Answer
from nsdr.visualize.figures import figure_png, pyplot

__all__ = ["sample_image"]

WIDTH_IN = 7.0
"""Width of a sample (inches, at `nsdr.visualize.figures.DPI`)."""
MARGIN_IN = 0.12
"""Space beside the text, and between two questions (inches)."""
LINE_IN = 0.17
"""Height of a line of text (inches)."""
TEXT_PT, PROGRAM_PT = 9.5, 8.0
"""Font sizes of questions and answers, and of programs (points)."""
TEXT_CHARACTERS, PROGRAM_CHARACTERS = 88, 104
"""Characters in a line of each."""
RIGHT_COLOR, WRONG_COLOR, UNKNOWN_COLOR = "#177245", "#aa3333", "#222222"
"""Colours of answers that agree with the ground truth, that do not, and of those without one."""
FAINT_COLOR = "#666666"
"""Colour of programs and question types."""


@dataclass(frozen=True)
class _Line:
    """A line of text with its style, and the space above it (inches)."""

    text: str
    style: dict[str, Any]
    above_in: float = 0.0


def sample_image(image: NDArray[np.uint8], results: Sequence[tuple[Question, Answer]]) -> NDArray[np.uint8]:
    """A picture of a video with its questions, their programs, and the answers, coloured by whether they are right.

    Args:
        image: (H, W, 3) uint8 RGB, such as of `stroboscopic_image`.
        results: questions with their true answers, if they are known, and the answers that were given.

    Returns:
        (H', W', 3) uint8 RGB.

    Raises:
        DataError: matplotlib is missing.
    """
    lines = [line for question, answer in results for line in _lines(question, answer)]
    picture_in = WIDTH_IN * image.shape[0] / image.shape[1]
    height_in = picture_in + sum(LINE_IN + line.above_in for line in lines) + MARGIN_IN
    figure = pyplot().figure(figsize=(WIDTH_IN, height_in))
    axes = figure.add_axes((0, 1 - picture_in / height_in, 1, picture_in / height_in))
    axes.imshow(image, interpolation="antialiased")
    axes.set_axis_off()
    top_in = height_in - picture_in
    for line in lines:
        top_in -= line.above_in
        figure.text(MARGIN_IN / WIDTH_IN, top_in / height_in, line.text, va="top", **line.style)
        top_in -= LINE_IN
    decoded = cv2.imdecode(np.frombuffer(figure_png(figure), np.uint8), cv2.IMREAD_COLOR_RGB)
    return np.asarray(decoded, np.uint8)


def _lines(question: Question, answer: Answer) -> list[_Line]:
    bold = {"fontsize": TEXT_PT, "weight": "bold"}
    lines = _wrapped(f"{question.type.capitalize()}: {question.text}", TEXT_CHARACTERS, bold, MARGIN_IN)
    program = {"fontsize": PROGRAM_PT, "family": "monospace", "color": FAINT_COLOR}
    lines += _wrapped(" ".join(answer.program), PROGRAM_CHARACTERS, program)
    if not question.choices:
        return lines + _wrapped(*_judged("Answer: ", str(answer.answer), question.answer))
    for choice, given in zip(question.choices, answer.choices, strict=True):
        lines += _wrapped(*_judged(f"{choice.text}: ", given.answer or "error", choice.answer))
    return lines


def _judged(before: str, given: str, true: str | None) -> tuple[str, int, dict[str, Any]]:
    """An answer with its mark, as arguments of `_wrapped`."""
    style: dict[str, Any] = {"fontsize": TEXT_PT, "color": UNKNOWN_COLOR}
    if true is None:
        return f"{before}{given}", TEXT_CHARACTERS, style
    if given == true:
        return f"{before}{given} \u2713", TEXT_CHARACTERS, style | {"color": RIGHT_COLOR}
    return f"{before}{given} \u2717 (ground truth: {true})", TEXT_CHARACTERS, style | {"color": WRONG_COLOR}


def _wrapped(text: str, characters: int, style: dict[str, Any], above_in: float = 0.0) -> list[_Line]:
    texts = textwrap.wrap(text, characters, subsequent_indent="   ")
    return [_Line(part, style, 0.0 if number else above_in) for number, part in enumerate(texts)]
