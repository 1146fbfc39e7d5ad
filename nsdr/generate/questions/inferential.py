"""Counterfactual questions with a wanted share of inferential options, those whose outcome the removal changes."""

import random
import warnings
from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import product

from nsdr.clevrer.files.questions import OPTION_TAGS, Choice, Question
from nsdr.generate.questions.candidates import is_negated

__all__ = ["InferentialSelection"]

MAX_OWED = 10.0
"""Scenes that would move the share away from its target are skipped, and their questions asked about later scenes, until this
many questions are owed; then the best ones are asked all the same."""
QUESTION_WEIGHT = 2.0
"""What a question is worth whose number of correct options is off its target, in options off theirs."""
MORE_OPTIONS = 1.0
"""What another option of a question is worth, in options off their target: questions keep the release's sizes where they can.
Of 1 to 10 and 0.1 to 2 on 440 simulated training scenes, these two meet shares of 0.2 and 0.5 within the tolerance, with as
many correct as wrong options in each half (within 0.5 %) and the fewest questions without a correct one; the statistics of
`nsdr generate questions --questions.inferential_share 0.5` show all three."""
CELLS = tuple((tag, answer) for tag in OPTION_TAGS for answer in ("correct", "wrong"))
"""Kinds of options, (tag, answer), in the order of all tuples of numbers here."""

FORMS = ((False, False), (False, True), (True, False), (True, True))
"""Options by (whether the question has "not", whether they are correct)."""


class InferentialSelection:
    """Counts of the counterfactual options selected so far, and the choice of the next question with its options.

    Targets: the share of inferential options; as many correct as wrong ones among the inferential and among the observational
    ones, and with and without "not"; and the release's numbers of correct options.

    Args:
        share: target share of inferential options.
        correct_shares: target shares of questions by number of correct options.
        n_options: min and max number of options of a question.
        min_wrong: min number of wrong options of a question.
        tolerance: how far the share may be off its target, beside the options of one question.
        rng: draws among equals.
    """

    def __init__(
        self,
        share: float,
        correct_shares: Mapping[int, float],
        n_options: tuple[int, int],
        min_wrong: int,
        tolerance: float,
        rng: random.Random,
    ) -> None:
        self.share, self.correct_shares, self.tolerance, self.rng = share, correct_shares, tolerance, rng
        self.max_options = n_options[1]
        self.permitted = [
            numbers
            for numbers in product(range(self.max_options + 1), repeat=len(CELLS))
            if n_options[0] <= sum(numbers) <= self.max_options
            and sum(numbers) - _correct(numbers) >= min_wrong
            and _correct(numbers) in correct_shares
        ]
        self.selected = (0,) * len(CELLS)
        self.forms: Counter[tuple[bool, bool]] = Counter()
        self.questions: Counter[int] = Counter()

    def choose(self, candidates: Sequence[Question], owed: float) -> tuple[Question, list[Choice]] | None:
        """The question that brings the counts closest to their targets, and its options in random order.

        None where no candidate has options enough, or where all lead away from the share and few questions are owed.
        """
        having = [(c, Counter((o.tag, o.answer) for o in c.choices)) for c in candidates]
        fitting: dict[tuple[bool, tuple[int, ...]], list[Question]] = {}
        for negated, numbers in product((False, True), self.permitted):
            found = [
                candidate
                for candidate, available in having
                if is_negated(candidate) == negated
                and all(available[cell] >= n for cell, n in zip(CELLS, numbers, strict=True))
            ]
            if found:
                fitting[negated, numbers] = found
        if not fitting:
            return None
        negated, numbers = min(fitting, key=lambda form: (self._distance(*form), self.rng.random()))
        if owed < MAX_OWED and self._leads_away(numbers):
            return None
        self.selected = _sum(self.selected, numbers)
        self.forms += _form(negated, numbers)
        self.questions[_correct(numbers)] += 1
        chosen = self.rng.choice(fitting[negated, numbers])
        options = []
        for cell, n in zip(CELLS, numbers, strict=True):
            options += self.rng.sample([o for o in chosen.choices if (o.tag, o.answer) == cell], n)
        self.rng.shuffle(options)
        return chosen, options

    def warn_if_missed(self) -> None:
        """Warn where the share that was reached is farther from its target than the tolerance and one question's options."""
        total, reached = sum(self.selected), _inferential(self.selected)
        if total and self._missed(self.selected) <= self._allowed(self.selected):
            return
        what = f"{reached / total:.3f} was reached ({reached} of {total} options)" if total else "no option was found"
        warnings.warn(
            f"inferential_share: {self.share:g} was asked for, {what}: the scenes have too few fitting options;"
            " give more scenes, fewer counterfactual questions (per_video), or another share",
            stacklevel=2,
        )

    def _distance(self, negated: bool, numbers: tuple[int, ...]) -> float:
        """Distance of all counts from their targets, in options, if a question with these numbers of options is added."""
        selected = _sum(self.selected, numbers)
        total, asked = sum(selected), self.questions.total() + 1
        halves = (1 - self.share, 1 - self.share, self.share, self.share)
        cells = sum(abs(n - share / 2 * total) for n, share in zip(selected, halves, strict=True))
        forms = self.forms + _form(negated, numbers)
        of_forms = sum(abs(forms[form] - total / 4) for form in FORMS)
        of_questions = sum(
            abs(self.questions[k] + (k == _correct(numbers)) - share * asked)
            for k, share in self.correct_shares.items()
        )
        return cells + self._missed(selected) + of_forms + QUESTION_WEIGHT * of_questions - MORE_OPTIONS * sum(numbers)

    def _leads_away(self, numbers: tuple[int, ...]) -> bool:
        """Whether these options bring the share farther from its target, and beyond the tolerance."""
        selected = _sum(self.selected, numbers)
        return self._missed(selected) > max(self._missed(self.selected), self._allowed(selected))

    def _missed(self, selected: tuple[int, ...]) -> float:
        """Inferential options too many or too few."""
        return abs(_inferential(selected) - self.share * sum(selected))

    def _allowed(self, selected: tuple[int, ...]) -> float:
        return self.tolerance * sum(selected) + self.max_options


def _sum(one: tuple[int, ...], other: tuple[int, ...]) -> tuple[int, ...]:
    return tuple(a + b for a, b in zip(one, other, strict=True))


def _correct(numbers: tuple[int, ...]) -> int:
    return sum(n for (_, answer), n in zip(CELLS, numbers, strict=True) if answer == "correct")


def _inferential(numbers: tuple[int, ...]) -> int:
    return sum(n for (tag, _), n in zip(CELLS, numbers, strict=True) if tag == OPTION_TAGS[1])


def _form(negated: bool, numbers: tuple[int, ...]) -> Counter[tuple[bool, bool]]:
    """Numbers of options by form, as in `FORMS`."""
    return Counter({(negated, True): _correct(numbers), (negated, False): sum(numbers) - _correct(numbers)})
