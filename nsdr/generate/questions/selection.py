"""CLEVRER questions for scenes with known ground truth, balanced over a data set.

`nsdr.generate.questions.candidates` lists all questions about a scene. The selection goes through the scenes in order and takes
the questions that bring the answers of the data set closest to their target shares. So the type and form of a question tell as
little about its answer as the scenes allow, and "not" tells as little about its options.
"""

import random
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from string import ascii_uppercase
from typing import Annotated

from msgspec import Meta
from msgspec.structs import replace

from nsdr.baselines.q_type import subtype_answers
from nsdr.clevrer.files.questions import PLAIN, Choice, Question, SceneQuestions
from nsdr.errors import DataError
from nsdr.generate.questions.candidates import (
    EXTENSION_KINDS,
    changed_questions,
    descriptive_questions,
    family,
    form,
    is_negated,
    multiple_choice_questions,
    plain_questions,
)
from nsdr.symbolic.quantities import Simulate
from nsdr.types import Scene
from nsdr.validation import Count, NotNegative, Settings, one_of
from nsdr.world.world import CLEVRER_WORLD, World

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
"""Mean number of questions per video in the train split."""
COUNT_SHARES = {"0": 0.25, "1": 0.25, "2": 0.24, "3": 0.17, "4": 0.08, "5": 0.01}
"""Target shares of the answers to "count", as uniform as scenes with four to six objects allow. Answers to other subtypes have
equal shares."""
OTHER_COUNT_SHARE = 0.01
"""Target share of each larger count."""
CORRECT_SHARES = {
    "explanatory": {0: 0.163, 1: 0.204, 2: 0.330, 3: 0.257, 4: 0.046},
    "predictive": {1: 1.0},
    "counterfactual": {0: 0.009, 1: 0.426, 2: 0.344, 3: 0.221},
}
"""Shares of the train split's questions by number of correct options."""
MAX_SURPLUS = 0.02
"""A question that would raise a share above its target by more than this is left out."""
KEPT_PER_ANSWER = 3
"""Max number of a scene's candidates with the same family and answer."""
MIN_OWED = 0.5
"""Questions are selected while at least this many are owed; 0.5 rounds to the nearest number."""
MIN_OPTIONS = 2
"""Min number of options of a question."""
MAX_OPTIONS = len(ascii_uppercase)
"""Upper bound of `QuestionConfig.max_options`: prompts name options by letters."""
PREDICTIVE_OPTIONS = 2
"""Options of a predictive question, as in the release."""
PREDICTIVE_PER_SCENE = 1
"""Max number of predictive questions per scene: they all have the same text."""
MIN_WRONG = {"explanatory": 0, "predictive": 1, "counterfactual": 1}
"""Min number of wrong options, as in the release."""


@dataclass(frozen=True)
class QuestionConfig(Settings):
    """Number and form of the questions.

    Attributes:
        per_video: mean number of questions per video, by descriptive subtype or other type. Defaults to the train split's.
        max_options: max number of options of a question, 2 to 26 (predictive ones have two).
        seed: seed for the wordings and for choices between equally good questions.
        extensions: whether there are also questions beyond CLEVRER, about speeds, directions and masses.
        changed_per_video: max number of what-if questions about changed objects. They need truth files of scenes with
            CLEVRER's physics, and each takes seconds of simulation.
        plain_per_video: max number of questions about objects alone, for training networks. A generated data set has them
            only in its training split.
    """

    per_video: Mapping[Annotated[str, one_of(PER_VIDEO)], NotNegative] = field(default_factory=lambda: dict(PER_VIDEO))
    max_options: Annotated[int, Meta(ge=MIN_OPTIONS, le=MAX_OPTIONS)] = 4
    seed: Count = 0
    extensions: bool = False
    changed_per_video: Count = 0
    plain_per_video: Count = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.changed_per_video and not self.extensions:
            raise DataError("changed_per_video: expected 0 without extensions; such questions are beyond CLEVRER")


def find_candidates(
    item: tuple[int, str, Scene] | tuple[int, str, Scene, Simulate | None], config: QuestionConfig | None = None
) -> SceneQuestions:
    """Candidate questions about a scene, with all their options. All ids are 0.

    There are at most `KEPT_PER_ANSWER` descriptive questions with the same answer and family of programs.

    Args:
        item: index, file name and scene; for what-if questions also the function that gives the true collisions after a change.
        config: which questions are wanted; None for CLEVRER's.
    """
    index, filename, scene, *simulate = item
    config = config or QuestionConfig()
    rng = random.Random(f"{config.seed} questions {index}")
    found = _kept(((family(q), q) for q in descriptive_questions(scene, rng)), rng)
    found += multiple_choice_questions(scene, rng)
    if config.extensions:
        rng = random.Random(f"{config.seed} extensions {index}")
        found += _kept(((str(q.subtype), q) for q in descriptive_questions(scene, rng, beyond=True)), rng)
        if config.changed_per_video and simulate and simulate[0] is not None:
            found += changed_questions(scene, simulate[0], rng, config.changed_per_video)
    found += plain_questions(scene, random.Random(f"{config.seed} plain {index}"), config.plain_per_video)
    return SceneQuestions(index, filename, tuple(found))


def _kept(questions: Iterable[tuple[str, Question]], rng: random.Random) -> list[Question]:
    """At most `KEPT_PER_ANSWER` questions of each group and answer, drawn at random from pairs (group, question)."""
    found, kept = list(questions), []
    seen: Counter[tuple[str, str | None]] = Counter()
    rng.shuffle(found)
    for group, question in found:
        key = (group, question.answer)
        if seen[key] < KEPT_PER_ANSWER:
            seen[key] += 1
            kept.append(question)
    return kept


def generate_questions(
    scenes: Iterable[tuple[int, str, Scene]], config: QuestionConfig | None = None
) -> Iterator[SceneQuestions]:
    """Balanced questions about scenes (index, file name, scene). The same scenes in the same order give the same questions.

    Predictive, counterfactual and motion questions are omitted for scenes that lack the ground truth they need.
    """
    config, scenes = config or QuestionConfig(), list(scenes)
    world = world_of([scene for _, _, scene in scenes])
    return select_questions((find_candidates(scene, config) for scene in scenes), config, world)


def world_of(scenes: Sequence[Scene]) -> World:
    """The world of all scenes; CLEVRER's if there are none.

    Raises:
        DataError: they have different words.
    """
    worlds = {scene.world.vocabulary: scene.world for scene in scenes}
    if len(worlds) > 1:
        raise DataError(
            f"scenes of the worlds {', '.join(world.name for world in worlds.values())}, which have different words; expected "
            "scenes of one world"
        )
    return next(iter(worlds.values()), CLEVRER_WORLD)


def select_questions(
    candidates: Iterable[SceneQuestions], config: QuestionConfig, world: World
) -> Iterator[SceneQuestions]:
    """Select from the candidates of each scene, in order, the questions that balance the data set of a world."""
    selection, beyond = _Selection(config, world), _ExtensionSelection(config.seed, config.max_options)
    for scene in candidates:
        plain = [q for q in scene.questions if q.subtype == PLAIN]
        found = [*selection.questions(scene.questions), *beyond.questions(scene.questions), *plain]
        yield replace(scene, questions=tuple(replace(q, id=i) for i, q in enumerate(found)))


class _Selection:
    """Counts CLEVRER's questions that were selected so far, and chooses the next ones."""

    def __init__(self, config: QuestionConfig, world: World) -> None:
        self.config, self.rng = config, random.Random(f"{config.seed} selection")
        self.possible = {subtype: len(answers) for subtype, answers in subtype_answers(world).items()}
        self.owed = dict.fromkeys(config.per_video, 0.0)
        self.answers: Counter[tuple[str, str]] = Counter()
        self.forms: Counter[str] = Counter()
        self.forms_with: Counter[tuple[str, str]] = Counter()
        self.families: Counter[tuple[str, str]] = Counter()
        self.negated: Counter[tuple[str, bool]] = Counter()
        self.correct: Counter[tuple[str, bool, int]] = Counter()
        self.options: Counter[tuple[str, bool, str, str]] = Counter()

    def questions(self, candidates: Sequence[Question]) -> list[Question]:
        """Select questions about a scene, descriptive ones first."""
        selected: list[Question] = []
        for kind in self.config.per_video:
            self.owed[kind] += self.config.per_video[kind]
            if kind in CORRECT_SHARES:
                selected += self._multiple_choice(kind, [q for q in candidates if q.type == kind and not _changes(q)])
            else:
                selected += self._descriptive(kind, [q for q in candidates if q.subtype == kind])
        return sorted(selected, key=lambda q: q.type != "descriptive")

    def _descriptive(self, kind: str, remaining: list[Question]) -> list[Question]:
        selected: list[Question] = []
        in_scene: Counter[str] = Counter()

        def rank(q: Question) -> tuple[float, ...]:
            return in_scene[family(q)], self._excess(q), self.families[kind, family(q)], self.rng.random()

        while remaining and self.owed[kind] >= MIN_OWED:
            answer = self._scarcest(kind, sorted({str(q.answer) for q in remaining}))
            best = min((q for q in remaining if q.answer == answer), key=rank)
            self.answers[kind, answer] += 1
            self.forms[form(best)] += 1
            self.forms_with[form(best), answer] += 1
            self.families[kind, family(best)] += 1
            in_scene[family(best)] += 1
            self.owed[kind] -= 1
            selected.append(best)
            remaining = [
                q for q in remaining if q.program != best.program and (family(q), q.answer) != (family(best), answer)
            ]
        return selected

    def _scarcest(self, kind: str, answers: Sequence[str]) -> str:
        """The answer that was selected least often, relative to its target share."""
        return min(answers, key=lambda a: (self.answers[kind, a] + self.rng.random()) / self._target_share(kind, a))

    def _excess(self, q: Question) -> float:
        """By how many questions of this form the answer would exceed its target share."""
        share = self._target_share(str(q.subtype), str(q.answer))
        return self.forms_with[form(q), str(q.answer)] + 1 - share * (self.forms[form(q)] + 1)

    def _target_share(self, subtype: str, answer: str) -> float:
        return COUNT_SHARES.get(answer, OTHER_COUNT_SHARE) if subtype == "count" else 1 / self.possible[subtype]

    def _multiple_choice(self, kind: str, remaining: list[Question]) -> list[Question]:
        self.rng.shuffle(remaining)
        selected: list[Question] = []
        limit = PREDICTIVE_PER_SCENE if kind == "predictive" else len(remaining)
        while remaining and self.owed[kind] >= MIN_OWED and len(selected) < limit:
            # Each question is asked in one form only: affirmative or negated, whichever was used less.
            remaining.sort(key=lambda q: self.negated[kind, is_negated(q)])
            question = remaining.pop(0)
            options = self._options(question)
            if not options:
                continue
            program = question.program or ()
            other = program[:-1] if is_negated(question) else (*program, "negate")
            remaining = [q for q in remaining if q.program != other]
            self.negated[kind, is_negated(question)] += 1
            self.owed[kind] -= 1
            selected.append(_with_choices(question, options))
        return selected

    def _options(self, question: Question) -> list[Choice]:
        """Options in random order, with that number of correct ones that is most below its target share; [] if none fits."""
        kind, group = question.type, (question.type, is_negated(question))
        correct, wrong = _by_answer(question)
        max_options = PREDICTIVE_OPTIONS if kind == "predictive" else self.config.max_options
        shares = CORRECT_SHARES[kind]
        total = sum(self.correct[*group, k] for k in shares) + 1
        feasible = {k: min(max_options - k, len(wrong)) for k in shares if k <= min(len(correct), max_options)}
        feasible = {k: w for k, w in feasible.items() if k + w >= MIN_OPTIONS and w >= MIN_WRONG[kind]}
        if not feasible:
            return []
        count = max(feasible, key=lambda k: (shares[k] - self.correct[*group, k] / total, self.rng.random()))
        if self.correct[*group, count] > (shares[count] + MAX_SURPLUS) * total:
            return []
        self.correct[*group, count] += 1
        options = self._least_used(group, correct, count) + self._least_used(group, wrong, feasible[count])
        self.rng.shuffle(options)
        return options

    def _least_used(self, group: tuple[str, bool], remaining: list[Choice], count: int) -> list[Choice]:
        """Options whose family was least often correct (or wrong, if these are wrong) relative to the opposite."""
        selected: list[Choice] = []

        def excess(o: Choice) -> float:
            opposite = "wrong" if o.answer == "correct" else "correct"
            used, others = (self.options[*group, family(o), answer] for answer in (str(o.answer), opposite))
            return used - others + self.rng.random()

        for _ in range(count):
            best = min(remaining, key=excess)
            remaining.remove(best)
            selected.append(best)
            self.options[*group, family(best), str(best.answer)] += 1
        return selected


class _ExtensionSelection:
    """Selects for each scene a question of each kind, with the answer that was selected least often so far.

    Args:
        seed: seed for choices between equally good questions and for the order of options.
        max_options: max number of options of a what-if question.
    """

    def __init__(self, seed: int, max_options: int) -> None:
        self.rng, self.max_options = random.Random(f"{seed} extensions"), max_options
        self.answers: Counter[tuple[str, str | None]] = Counter()

    def questions(self, candidates: Sequence[Question]) -> Iterator[Question]:
        """Yield the selected questions of a scene."""
        for kind in EXTENSION_KINDS:
            asked = [q for q in candidates if q.subtype == kind]
            if asked:
                best = min(asked, key=lambda q: (self.answers[kind, q.answer], self.rng.random()))
                self.answers[kind, best.answer] += 1
                yield best
        for question in filter(_changes, candidates):
            correct, wrong = _by_answer(question)
            if correct and wrong:  # as many as each other, where there are enough
                most = self.max_options
                n_correct = min(len(correct), max(most // 2, most - len(wrong)))
                options = self.rng.sample(correct, n_correct)
                options += self.rng.sample(wrong, min(len(wrong), most - n_correct))
                self.rng.shuffle(options)
                yield _with_choices(question, options)


def _changes(question: Question) -> bool:
    """Whether the question is a what-if question about a changed object."""
    return "get_changed" in (question.program or ())


def _by_answer(question: Question) -> tuple[list[Choice], list[Choice]]:
    """The correct and the wrong options."""
    correct = [c for c in question.choices if c.answer == "correct"]
    return correct, [c for c in question.choices if c.answer == "wrong"]


def _with_choices(question: Question, options: Sequence[Choice]) -> Question:
    return replace(question, choices=tuple(replace(o, id=i) for i, o in enumerate(options)))
