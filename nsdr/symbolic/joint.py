"""Probabilities of the choices of one question, judged together."""

from collections import Counter
from collections.abc import Sequence

__all__ = ["Draws", "either_probability", "most_probable", "probabilities", "without_none_correct"]

Draws = Sequence[tuple[float, tuple[bool, ...]]]
"""(weight, whether each choice is correct) of possible worlds; the weights are positive."""
NONE_CORRECT = 169 / 18_642
"""Share of counterfactual questions without a correct choice, counted in CLEVRER's training questions."""
MIN_PROBABILITY = 0.2
"""Where every choice is less probable, nothing is concluded from the others: it may be a question that is none of CLEVRER's."""


def probabilities(draws: Draws) -> tuple[float, ...]:
    """Of each choice to be correct."""
    total = sum(weight for weight, _ in draws)
    return tuple(
        sum(weight * correct for weight, correct in zip((w for w, _ in draws), column, strict=True)) / total
        for column in zip(*(row for _, row in draws), strict=True)
    )


def most_probable(draws: Draws) -> tuple[bool, ...]:
    """The most probable judgement of all choices."""
    weights: Counter[tuple[bool, ...]] = Counter()
    for weight, row in draws:
        weights[row] += weight  # type: ignore[assignment]
    return max(weights, key=lambda row: weights[row])


def without_none_correct(draws: Draws) -> Draws:
    """The draws, given that hardly any of CLEVRER's counterfactual questions has no correct choice.

    By Bayes' rule: worlds are drawn without knowing how questions are made. Of m choices that are correct as often as not, none
    would be in a share 2^-m of questions, but that share is `NONE_CORRECT`; so worlds without a correct choice count
    `NONE_CORRECT` / 2^-m. Single choices, and questions without a choice of `MIN_PROBABILITY`, are left as they are.
    """
    n_choices = len(draws[0][1])
    if n_choices < 2 or max(probabilities(draws)) < MIN_PROBABILITY:
        return draws
    weight = NONE_CORRECT * 2**n_choices
    return [(n if any(row) else n * weight, row) for n, row in draws]


def either_probability(first: float, second: float) -> tuple[float, float]:
    """Probabilities of two independent events, given that exactly one of them happens."""
    one, other = first * (1 - second), second * (1 - first)
    return (one / (one + other), other / (one + other)) if one + other else (0.5, 0.5)
