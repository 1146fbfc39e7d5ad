"""Choices of one question, judged together: what is known about how many of them are correct."""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache, partial

from nsdr.types import ChoiceAnswer
from nsdr.types.answers import with_lazy

__all__ = ["Draws", "exactly_one", "hardly_none", "most_probable", "probabilities", "with_probabilities"]

Draws = Sequence[tuple[float, tuple[bool | None, ...]]]
"""(weight, whether each choice is correct) of possible worlds; the weights are positive. None: what the choice supposes does
not happen there."""
NONE_CORRECT = 169 / 18_642
"""Share of counterfactual questions without a correct choice, counted in CLEVRER's training questions."""
SIMULATED = frozenset({"unseen_events", "get_counterfact"})
BORDER_EVENTS = frozenset({"filter_in", "filter_out"})
MIN_PROBABILITY = 0.2
"""Where every choice is less probable, nothing is concluded from the others: the question may be none of CLEVRER's.
`python benchmarks/joint_choices.py` on 150 simulated scenes: 26 of 28 changed questions become right."""


def probabilities(draws: Draws) -> tuple[float, ...]:
    """Of each choice to be correct, given that what it supposes happens; 0 where it happens nowhere."""
    columns = zip(*([(weight, correct) for correct in row] for weight, row in draws), strict=True)
    shares = []
    for column in columns:
        total = sum(weight for weight, correct in column if correct is not None)
        shares.append(sum(weight for weight, correct in column if correct) / total if total else 0.0)
    return tuple(shares)


def most_probable(draws: Draws) -> tuple[bool, ...]:
    """The most probable judgement of all choices; of equally probable ones the first."""
    weights: Counter[tuple[bool, ...]] = Counter()
    for weight, row in draws:
        weights[tuple(map(bool, row))] += weight  # type: ignore[assignment]
    return max(weights, key=lambda row: weights[row])


def hardly_none(draws: Draws) -> Draws:
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


def exactly_one(answers: Sequence[ChoiceAnswer], scores: tuple[float, float], stated: bool) -> list[ChoiceAnswer]:
    """Two choices of which exactly one is correct: if both are judged alike, the one with the higher score is.

    Args:
        answers: the two choices, judged one by one.
        scores: probabilities of their collisions; with equal ones, the first is the correct one.
        stated: whether the choices get probabilities.
    """
    if answers[0].answer == answers[1].answer:
        words = ("correct", "wrong") if scores[0] >= scores[1] else ("wrong", "correct")
        answers = [replace(a, answer=word) for a, word in zip(answers, words, strict=True)]
    if not stated:
        return list(answers)
    one, other = scores[0] * (1 - scores[1]), scores[1] * (1 - scores[0])
    first = one / (one + other) if one + other else 0.5
    makers = (lambda: first, lambda: 1 - first)
    return [with_lazy(a, probability=make) for a, make in zip(answers, makers, strict=True)]


def _beyond_simulation(program: Sequence[str]) -> bool:
    """Whether a choice is an entrance or exit after the video or without an object."""
    return not SIMULATED.isdisjoint(program) and not BORDER_EVENTS.isdisjoint(program)


def with_probabilities(
    answers: Sequence[ChoiceAnswer], draws: Callable[[Sequence[tuple[str, ...]]], Draws], counterfactual: bool
) -> list[ChoiceAnswer]:
    """The choices with probabilities, which are computed when they are read.

    If no choice of a counterfactual question is judged correct, those that are correct in the most probable world given
    `hardly_none` are.

    Args:
        answers: the choices, judged one by one; those with an error get no probability, nor do entrances and exits that would
            have to be simulated: only collisions are.
        draws: of some choices' programs.
        counterfactual: whether the question is.
    """
    judged = [i for i, a in enumerate(answers) if not a.error and not _beyond_simulation(a.program)]
    found = list(answers)
    if not judged:
        return found

    @lru_cache(1)
    def drawn() -> Draws:
        of_programs = draws([answers[i].program for i in judged])
        return hardly_none(of_programs) if counterfactual else of_programs

    def probability(k: int) -> float:
        return probabilities(drawn())[k]

    if counterfactual and len(judged) > 1 and all(answers[i].answer == "wrong" for i in judged):
        for i, correct in zip(judged, most_probable(drawn()), strict=True):
            found[i] = replace(answers[i], answer="correct" if correct else "wrong")
    return [
        with_lazy(a, probability=partial(probability, judged.index(i))) if i in judged else a
        for i, a in enumerate(found)
    ]
