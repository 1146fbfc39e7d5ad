"""Selects counterfactual questions with a given share of inferential options: those whose outcome the removal changes."""

import random
import warnings
from collections.abc import Mapping, Sequence
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nsdr.clevrer.files.questions import OPTION_TAGS, Choice, Question
from nsdr.generate.questions.candidates import is_negated

MAX_OWED = 10.0
"""A scene that would move the share away from its target is skipped, and its questions are owed to later scenes. Once this many
are owed, the best questions are asked anyway."""
QUESTION_WEIGHT = 2.0
"""How much a question with too frequent a number of correct options counts, compared with an option that misses its target."""
MORE_OPTIONS = 1.0
"""What another option of a question is worth, in options off their target: questions keep the release's sizes where they can.
Of 1 to 10 and 0.1 to 2 on 440 simulated training scenes, these two meet shares of 0.2 and 0.5 within the tolerance, with as
many correct as wrong options in each half (within 0.5 %) and the fewest questions without a correct one; the statistics of
`nsdr generate questions --questions.inferential_share 0.5` show all three."""
CELLS = tuple((tag, answer) for tag in OPTION_TAGS for answer in ("correct", "wrong"))
"""Kinds of options, (tag, answer): the last axis of all arrays of counts in this module."""
CORRECT, INFERENTIAL = [0, 2], [2, 3]
"""Indices of those `CELLS` that are correct, and of those that are inferential."""


class InferentialSelection:
    """Counts the counterfactual options that were selected so far, and chooses the next question with its options.

    Targets: the share of inferential options; as many correct as wrong options among the inferential ones, among the
    observational ones, with "not" and without it; and the release's distribution of the number of correct options.

    Args:
        share: target share of inferential options.
        correct_shares: target shares of questions by number of correct options.
        n_options: min and max number of options of a question.
        min_wrong: min number of wrong options of a question.
        tolerance: how far the share may miss its target, in addition to the options of one question.
        rng: chooses between equally good questions.
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
        self.share, self.tolerance, self.rng, self.max_options = share, tolerance, rng, n_options[1]
        every = np.array(list(product(range(self.max_options + 1), repeat=len(CELLS))))
        total, correct = every.sum(1), every[:, CORRECT].sum(1)
        fits = (n_options[0] <= total) & (total <= self.max_options) & (total - correct >= min_wrong)
        self.permitted = every[fits & np.isin(correct, list(correct_shares))]
        self.correct_shares = np.array([correct_shares.get(n, 0.0) for n in range(self.max_options + 1)])
        self.selected = np.zeros(len(CELLS), int)
        self.forms = np.zeros((2, 2), int)  # options by (whether the question has "not", whether they are correct)
        self.questions = np.zeros(self.max_options + 1, int)  # by their number of correct options

    def choose(self, candidates: Sequence[Question], owed: float) -> tuple[Question, list[Choice]] | None:
        """The question that brings the counts closest to their targets, and its options in random order.

        None if no candidate has enough options, or if all lead away from the share and few questions are owed.
        """
        having = np.array([[[(o.tag, o.answer) for o in q.choices].count(cell) for cell in CELLS] for q in candidates])
        enough = (having[:, None] >= self.permitted).all(2)
        has_not = np.array([is_negated(q) for q in candidates])
        fitting = [
            (distance, self.rng.random(), negated, k)
            for negated in (False, True)
            for k, distance in enumerate(self._distances(negated))
            if enough[has_not == negated, k].any()
        ]
        if not fitting:
            return None
        _, _, negated, k = min(fitting)
        numbers = self.permitted[k]
        if owed < MAX_OWED and self._leads_away(numbers):
            return None
        correct = numbers[CORRECT].sum()
        self.selected += numbers
        self.forms[int(negated)] += numbers.sum() - correct, correct
        self.questions[correct] += 1
        chosen = candidates[self.rng.choice(np.flatnonzero(enough[:, k] & (has_not == negated)))]
        options: list[Choice] = []
        for cell, n in zip(CELLS, numbers.tolist(), strict=True):
            options += self.rng.sample([o for o in chosen.choices if (o.tag, o.answer) == cell], n)
        self.rng.shuffle(options)
        return chosen, options

    def warn_if_missed(self) -> None:
        """Warn if the share misses its target by more than the tolerance and the options of one question."""
        total, reached = self.selected.sum(), self.selected[INFERENTIAL].sum()
        if total and self._missed(self.selected) <= self._allowed(self.selected):
            return
        what = f"{reached / total:.3f} was reached ({reached} of {total} options)" if total else "no option was found"
        warnings.warn(
            f"inferential_share: {self.share:g} was asked for, {what}: the scenes have too few fitting options;"
            " give more scenes, fewer counterfactual questions (per_video), or another share",
            stacklevel=2,
        )

    def _distances(self, negated: bool) -> NDArray[np.floating[Any]]:
        """By how many options all counts miss their targets after a question with the options in each row of `permitted`."""
        selected, added = self.selected + self.permitted, self.permitted.sum(1)
        total, correct = selected.sum(1), self.permitted[:, CORRECT].sum(1)
        halves = np.array([1 - self.share, 1 - self.share, self.share, self.share]) / 2
        cells = abs(selected - halves * total[:, None]).sum(1)
        forms = np.tile(self.forms, (len(added), 1, 1))
        forms[:, int(negated)] += np.stack([added - correct, correct], 1)
        of_forms = abs(forms.reshape(-1, 4) - total[:, None] / 4).sum(1)
        questions = self.questions + (correct[:, None] == np.arange(len(self.questions)))
        of_questions = abs(questions - self.correct_shares * questions.sum(1, keepdims=True)).sum(1)
        distances = cells + self._missed(selected) + of_forms + QUESTION_WEIGHT * of_questions - MORE_OPTIONS * added
        return np.asarray(distances)

    def _leads_away(self, numbers: NDArray[np.int_]) -> bool:
        """Whether these options would move the share farther from its target, and beyond the tolerance."""
        selected = self.selected + numbers
        return bool(self._missed(selected) > max(self._missed(self.selected), self._allowed(selected)))

    def _missed(self, selected: NDArray[np.int_]) -> Any:
        """How many inferential options there are too many or too few."""
        return abs(selected[..., INFERENTIAL].sum(-1) - self.share * selected.sum(-1))

    def _allowed(self, selected: NDArray[np.int_]) -> float:
        return float(self.tolerance * selected.sum() + self.max_options)
