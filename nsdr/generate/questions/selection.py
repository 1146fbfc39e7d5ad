"""CLEVRER's questions for scenes whose truth is known, balanced over a whole data set.

Every scene offers all its questions (`nsdr.generate.questions.candidates`); from scene to scene those are taken that bring
the data set's answers nearer to their shares, so that the type of a question tells nothing about its answer.
"""

import random
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial

from nsdr.clevrer.questions import Choice, Question, SceneQuestions
from nsdr.errors import DataError
from nsdr.generate.questions.candidates import (
    Descriptive,
    MultipleChoice,
    Option,
    descriptive_questions,
    multiple_choice_questions,
)
from nsdr.types import Scene

__all__ = ["Candidates", "QuestionConfig", "find_candidates", "generate_questions", "select_questions"]

PER_VIDEO = {
    "count": 4.0,
    "exist": 2.0,
    "query_color": 1.845,
    "query_shape": 1.688,
    "query_material": 1.461,
    "explanatory": 1.68,
    "predictive": 0.718,
    "counterfactual": 1.864,
}
"""The train split's questions a video."""
COUNT_SHARES = {"0": 0.25, "1": 0.25, "2": 0.24, "3": 0.17, "4": 0.08, "5": 0.01}
"""Wanted shares of counts: even as far as scenes of four to six objects have them. All other answers are wanted evenly."""
CORRECT_SHARES = {
    "explanatory": {0: 0.163, 1: 0.204, 2: 0.330, 3: 0.257, 4: 0.046},
    "predictive": {1: 1.0},
    "counterfactual": {0: 0.009, 1: 0.426, 2: 0.344, 3: 0.221},
}
"""Shares of questions with that many right options in the train split."""
MAX_SURPLUS = 0.02
"""By so much a share may exceed what is wanted before questions of that kind are left out."""
KEPT_PER_ANSWER = 3
"""Of each scene's questions of one family with one answer, so many are kept for the selection."""


@dataclass(frozen=True)
class QuestionConfig:
    """Which questions are wanted.

    Attributes:
        per_video: mean number of questions of each descriptive subtype and each other type; as in the train split.
        max_options: options of a question (predictive ones have two).
        seed: of wordings and ties.
    """

    per_video: Mapping[str, float] = field(default_factory=lambda: dict(PER_VIDEO))
    max_options: int = 4
    seed: int = 0

    def __post_init__(self) -> None:
        if set(self.per_video) - set(PER_VIDEO):
            raise DataError(f"per_video: expected some of {', '.join(PER_VIDEO)}, got {', '.join(self.per_video)}")
        if self.max_options < 2:
            raise DataError(f"max_options: expected at least 2, got {self.max_options}")


@dataclass(frozen=True)
class Candidates:
    """What one scene offers."""

    scene_index: int
    video_filename: str
    descriptive: tuple[Descriptive, ...]
    multiple_choice: tuple[MultipleChoice, ...]


def find_candidates(item: tuple[int, str, Scene], seed: int = 0) -> Candidates:
    """The questions that a scene (index, file name, scene) offers, thinned to a few for each family and answer."""
    index, filename, scene = item
    rng = random.Random(f"{seed} questions {index}")
    kept: list[Descriptive] = []
    seen: Counter[tuple[str, str]] = Counter()
    found = list(descriptive_questions(scene, rng))
    rng.shuffle(found)
    for question in found:
        key = (question.family, question.answer)
        if seen[key] < KEPT_PER_ANSWER:
            seen[key] += 1
            kept.append(question)
    return Candidates(index, filename, tuple(kept), tuple(multiple_choice_questions(scene, rng)))


def generate_questions(
    scenes: Iterable[tuple[int, str, Scene]], config: QuestionConfig | None = None
) -> Iterator[SceneQuestions]:
    """Balanced questions for scenes (index, file name, scene); deterministic for the same scenes in the same order.

    Scenes without unseen or counterfactual truth get descriptive and explanatory questions only, without motion none about it.
    """
    config = config or QuestionConfig()
    return select_questions(map(partial(find_candidates, seed=config.seed), scenes), config)


def select_questions(candidates: Iterable[Candidates], config: QuestionConfig) -> Iterator[SceneQuestions]:
    """Take from each scene's candidates, in order, the questions that balance the data set."""
    selection = _Selection(config)
    for scene in candidates:
        yield selection.scene(scene)


class _Selection:
    """What was taken so far, and what to take next."""

    def __init__(self, config: QuestionConfig) -> None:
        self.config, self.rng = config, random.Random(f"{config.seed} selection")
        self.owed = dict.fromkeys(config.per_video, 0.0)
        self.answers: Counter[tuple[str, str]] = Counter()
        self.families: Counter[tuple[str, ...]] = Counter()
        self.correct: Counter[tuple[str, int]] = Counter()
        self.options: Counter[tuple[str, bool, str, bool]] = Counter()

    def scene(self, candidates: Candidates) -> SceneQuestions:
        questions: list[Question] = []
        for kind in self.config.per_video:
            self.owed[kind] += self.config.per_video[kind]
            take = self._multiple_choice if kind in CORRECT_SHARES else self._descriptive
            questions += take(kind, candidates)
        ordered = sorted(questions, key=lambda q: q.type != "descriptive")
        return SceneQuestions(
            candidates.scene_index,
            candidates.video_filename,
            tuple(
                Question(i, q.text, q.type, q.subtype, q.program, q.answer, q.choices) for i, q in enumerate(ordered)
            ),
        )

    def _descriptive(self, kind: str, candidates: Candidates) -> list[Question]:
        open_ = [c for c in candidates.descriptive if c.subtype == kind]
        taken: list[Question] = []
        here: Counter[str] = Counter()
        while open_ and self.owed[kind] >= 0.5:
            best = min(
                open_, key=lambda c: (self._answer_use(c), here[c.family], self._family_use(c), self.rng.random())
            )
            self.answers[kind, best.answer] += 1
            self.families[kind, best.family] += 1
            self.families[best.family, best.answer] += 1
            here[best.family] += 1
            self.owed[kind] -= 1
            taken.append(Question(0, best.text, "descriptive", kind, best.program, best.answer, ()))
            open_ = [
                c for c in open_ if c.program != best.program and (c.family, c.answer) != (best.family, best.answer)
            ]
        return taken

    def _answer_use(self, c: Descriptive) -> float:
        share = COUNT_SHARES.get(c.answer, 0.01) if c.subtype == "count" else 1.0
        return (self.answers[c.subtype, c.answer] + self.rng.random()) / share

    def _family_use(self, c: Descriptive) -> float:
        return self.families[c.subtype, c.family] + 2 * self.families[c.family, c.answer]

    def _multiple_choice(self, kind: str, candidates: Candidates) -> list[Question]:
        open_ = [c for c in candidates.multiple_choice if c.type == kind]
        self.rng.shuffle(open_)
        taken: list[Question] = []
        most = 1 if kind == "predictive" else len(open_)
        while open_ and self.owed[kind] >= 0.5 and len(taken) < most:
            # One wording of each question: "not" or without it, whichever was used less.
            open_.sort(key=lambda c: self.families[kind, str(c.negated)])
            candidate = open_.pop(0)
            options = self._options(candidate)
            if not options:
                continue
            other = candidate.program[:-1] if candidate.negated else (*candidate.program, "negate")
            open_ = [c for c in open_ if c.program != other]
            self.families[kind, str(candidate.negated)] += 1
            self.owed[kind] -= 1
            choices = tuple(
                Choice(i, o.text, o.program, "correct" if o.correct else "wrong") for i, o in enumerate(options)
            )
            taken.append(Question(0, candidate.text, kind, None, candidate.program, None, choices))
        return taken

    def _options(self, question: MultipleChoice) -> Sequence[Option]:
        """Options in random order, as many right ones as brings the data set nearer to its shares; none when it cannot be."""
        kind = question.type
        right = [o for o in question.options if o.correct]
        wrong = [o for o in question.options if not o.correct]
        most = 2 if kind == "predictive" else self.config.max_options
        shares = CORRECT_SHARES[kind]
        total = sum(self.correct[kind, k] for k in shares) + 1
        feasible = {k: min(most - k, len(wrong)) for k in shares if k <= min(len(right), most)}
        min_wrong = 0 if kind == "explanatory" else 1  # as in the release
        feasible = {k: w for k, w in feasible.items() if k + w >= 2 and w >= min_wrong}
        if not feasible:
            return []
        count = max(feasible, key=lambda k: (shares[k] - self.correct[kind, k] / total, self.rng.random()))
        if self.correct[kind, count] > (shares[count] + MAX_SURPLUS) * total:
            return []
        self.correct[kind, count] += 1
        options = self._least_used(question, right, count) + self._least_used(question, wrong, feasible[count])
        self.rng.shuffle(options)
        return options

    def _least_used(self, question: MultipleChoice, options: Sequence[Option], count: int) -> list[Option]:
        """Options whose kind of content was used least with such an answer, compared with the other answer."""
        left, taken = list(options), []
        for _ in range(count):

            def excess(o: Option) -> float:
                same = self.options[question.type, question.negated, o.kind, o.correct]
                return same - self.options[question.type, question.negated, o.kind, not o.correct] + self.rng.random()

            best = min(left, key=excess)
            left.remove(best)
            taken.append(best)
            self.options[question.type, question.negated, best.kind, best.correct] += 1
        return taken
