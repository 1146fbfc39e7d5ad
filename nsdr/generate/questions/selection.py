"""CLEVRER questions for scenes with known ground truth, balanced over a data set.

`nsdr.generate.questions.candidates` lists all questions of a scene. The selection goes through the scenes in order and takes
the questions that bring the data set's answers closest to their target shares, so that a question's type and form say as little
as scenes allow about its answer, nor does "not" about its options'.
"""

import random
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from string import ascii_uppercase
from typing import Annotated

from msgspec import Meta
from msgspec.structs import replace

from nsdr.baselines.q_type import ANSWERS
from nsdr.clevrer.files.questions import Choice, Question, SceneQuestions
from nsdr.errors import DataError
from nsdr.generate.questions.candidates import (
    EXTENSION_KINDS,
    Descriptive,
    MultipleChoice,
    Option,
    changed_questions,
    descriptive_questions,
    multiple_choice_questions,
)
from nsdr.generate.questions.inferential import InferentialSelection
from nsdr.symbolic.quantities import Simulate
from nsdr.types import Scene
from nsdr.validation import Count, NotNegative, Settings, Share

__all__ = [
    "Candidates",
    "ExtensionSelection",
    "QuestionConfig",
    "find_candidates",
    "generate_questions",
    "select_questions",
]

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
"""Target shares of the answers to "count", as uniform as scenes of four to six objects allow. Other answers are uniform."""
OTHER_COUNT_SHARE = 0.01
"""Target share of larger counts."""
CORRECT_SHARES = {
    "explanatory": {0: 0.163, 1: 0.204, 2: 0.330, 3: 0.257, 4: 0.046},
    "predictive": {1: 1.0},
    "counterfactual": {0: 0.009, 1: 0.426, 2: 0.344, 3: 0.221},
}
"""Shares of the train split's questions by number of correct options."""
MAX_SURPLUS = 0.02
"""Questions that would raise a share above its target by more than this are left out."""
KEPT_PER_ANSWER = 3
"""Max number of a scene's candidates with the same family and answer."""
MIN_OWED = 0.5
"""Another question is selected while at least this many are owed, which rounds to the nearest number."""
MIN_OPTIONS = 2
"""Min number of options of a question."""
MAX_OPTIONS = len(ascii_uppercase)
"""Largest max number of options: prompts name them by letters."""
PREDICTIVE_OPTIONS = 2
"""Options of a predictive question, as in the release."""
PREDICTIVE_PER_SCENE = 1
"""Max number of predictive questions per scene; they all have the same text."""
MIN_WRONG = {"explanatory": 0, "predictive": 1, "counterfactual": 1}
"""Min number of wrong options, as in the release."""


@dataclass(frozen=True)
class QuestionConfig(Settings):
    """Number and form of the questions.

    Attributes:
        per_video: mean number of questions per video, by descriptive subtype or other type. Defaults to the train split's.
        max_options: max number of options of a question, 2 to 26 (predictive ones have two).
        seed: seed of the wordings and of ties.
        inferential_share: share of the options of counterfactual questions that are inferential
            (`nsdr.clevrer.files.questions.OPTION_TAGS`), met as closely as the scenes allow; None leaves it as it falls (about
            0.15 in CLEVRER).
        extensions: whether each video also gets questions beyond CLEVRER, about speeds, directions and masses.
        changed_per_video: max number of what-if questions about changed objects, for truth files of scenes with CLEVRER's
            physics; each takes seconds of simulation.
    """

    per_video: Mapping[str, NotNegative] = field(default_factory=lambda: dict(PER_VIDEO))
    max_options: Annotated[int, Meta(ge=MIN_OPTIONS, le=MAX_OPTIONS)] = 4
    seed: Count = 0
    inferential_share: Share | None = None
    extensions: bool = False
    changed_per_video: Count = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        if set(self.per_video) - set(PER_VIDEO):
            raise DataError(f"per_video: expected some of {', '.join(PER_VIDEO)}, got {', '.join(self.per_video)}")
        if self.changed_per_video and not self.extensions:
            raise DataError("changed_per_video: expected 0 without extensions; such questions are beyond CLEVRER")


@dataclass(frozen=True)
class Candidates:
    """The questions that can be asked about one scene.

    Attributes:
        scene_index: index of the video.
        video_filename: file name of the video.
        descriptive: descriptive questions with their answers.
        multiple_choice: multiple-choice questions with all options.
        extensions: descriptive questions beyond CLEVRER.
        changed: what-if questions about changed objects, with all options.
    """

    scene_index: int
    video_filename: str
    descriptive: tuple[Descriptive, ...]
    multiple_choice: tuple[MultipleChoice, ...]
    extensions: tuple[Descriptive, ...] = ()
    changed: tuple[MultipleChoice, ...] = ()


def find_candidates(
    item: tuple[int, str, Scene] | tuple[int, str, Scene, Simulate | None], config: QuestionConfig | None = None
) -> Candidates:
    """Candidate questions of a scene, at most `KEPT_PER_ANSWER` per family and answer.

    Args:
        item: index, file name and scene; for what-if questions also what gives the true collisions with a change.
        config: the questions that are wanted; None for CLEVRER's.
    """
    index, filename, scene, *simulate = item
    config = config or QuestionConfig()
    rng = random.Random(f"{config.seed} questions {index}")
    kept = _kept(descriptive_questions(scene, rng), rng)
    options = tuple(multiple_choice_questions(scene, rng))
    if not config.extensions:
        return Candidates(index, filename, kept, options)
    rng = random.Random(f"{config.seed} extensions {index}")
    beyond = _kept(descriptive_questions(scene, rng, beyond=True), rng)
    changed: tuple[MultipleChoice, ...] = ()
    if config.changed_per_video and simulate and simulate[0] is not None:
        changed = tuple(changed_questions(scene, simulate[0], rng, config.changed_per_video))
    return Candidates(index, filename, kept, options, beyond, changed)


def _kept(questions: Iterable[Descriptive], rng: random.Random) -> tuple[Descriptive, ...]:
    """At most `KEPT_PER_ANSWER` per family and answer, drawn at random."""
    found, kept = list(questions), []
    seen: Counter[tuple[str, str]] = Counter()
    rng.shuffle(found)
    for question in found:
        key = (question.family, question.answer)
        if seen[key] < KEPT_PER_ANSWER:
            seen[key] += 1
            kept.append(question)
    return tuple(kept)


def generate_questions(
    scenes: Iterable[tuple[int, str, Scene]], config: QuestionConfig | None = None
) -> Iterator[SceneQuestions]:
    """Balanced questions for scenes (index, file name, scene); deterministic for the same scenes in the same order.

    Predictive, counterfactual and motion questions are omitted for scenes that lack the ground truth they need.
    """
    config = config or QuestionConfig()
    return select_questions((find_candidates(scene, config) for scene in scenes), config)


def select_questions(candidates: Iterable[Candidates], config: QuestionConfig) -> Iterator[SceneQuestions]:
    """Select from the candidates of each scene, in order, the questions that balance the data set.

    Warns at the end if the scenes did not allow `QuestionConfig.inferential_share`.
    """
    selection, beyond = _Selection(config), ExtensionSelection(config.seed, config.max_options)
    for scene in candidates:
        found = selection.scene(scene)
        more = beyond.questions(scene.extensions, scene.changed, len(found.questions))
        yield replace(found, questions=(*found.questions, *more))
    if selection.inferential is not None:
        selection.inferential.warn_if_missed()


class _Selection:
    """Counts of the questions selected so far, and the choice of the next ones."""

    def __init__(self, config: QuestionConfig) -> None:
        self.config, self.rng = config, random.Random(f"{config.seed} selection")
        self.owed = dict.fromkeys(config.per_video, 0.0)
        self.answers: Counter[tuple[str, str]] = Counter()
        self.forms: Counter[str] = Counter()
        self.forms_with: Counter[tuple[str, str]] = Counter()
        self.families: Counter[tuple[str, ...]] = Counter()
        self.correct: Counter[tuple[str, bool, int]] = Counter()
        self.options: Counter[tuple[str, bool, str, bool]] = Counter()
        self.inferential: InferentialSelection | None = None
        if (share := config.inferential_share) is not None:
            kind, n_options = "counterfactual", (MIN_OPTIONS, config.max_options)
            self.inferential = InferentialSelection(
                share, CORRECT_SHARES[kind], n_options, MIN_WRONG[kind], MAX_SURPLUS, self.rng
            )

    def scene(self, candidates: Candidates) -> SceneQuestions:
        questions: list[Question] = []
        for kind in self.config.per_video:
            self.owed[kind] += self.config.per_video[kind]
            select = self._multiple_choice if kind in CORRECT_SHARES else self._descriptive
            questions += select(kind, candidates)
        ordered = sorted(questions, key=lambda q: q.type != "descriptive")
        return SceneQuestions(
            candidates.scene_index,
            candidates.video_filename,
            tuple(replace(q, id=i) for i, q in enumerate(ordered)),
        )

    def _descriptive(self, kind: str, candidates: Candidates) -> list[Question]:
        remaining = [c for c in candidates.descriptive if c.subtype == kind]
        selected: list[Question] = []
        in_scene: Counter[str] = Counter()
        while remaining and self.owed[kind] >= MIN_OWED:
            answer = self._scarcest(kind, sorted({c.answer for c in remaining}))
            best = min(
                (c for c in remaining if c.answer == answer),
                key=lambda c: (in_scene[c.family], self._excess(c), self.families[kind, c.family], self.rng.random()),
            )
            self.answers[kind, answer] += 1
            self.forms[best.form] += 1
            self.forms_with[best.form, answer] += 1
            self.families[kind, best.family] += 1
            in_scene[best.family] += 1
            self.owed[kind] -= 1
            selected.append(Question(0, best.text, "descriptive", kind, best.program, best.answer, ()))
            remaining = [
                c for c in remaining if c.program != best.program and (c.family, c.answer) != (best.family, best.answer)
            ]
        return selected

    def _scarcest(self, kind: str, answers: Sequence[str]) -> str:
        """The answer that was given least, relative to its target share."""
        return min(answers, key=lambda a: (self.answers[kind, a] + self.rng.random()) / _target_share(kind, a))

    def _excess(self, c: Descriptive) -> float:
        """By how many questions of its form its answer would exceed its target share."""
        return self.forms_with[c.form, c.answer] + 1 - _target_share(c.subtype, c.answer) * (self.forms[c.form] + 1)

    def _multiple_choice(self, kind: str, candidates: Candidates) -> list[Question]:
        remaining = [c for c in candidates.multiple_choice if c.type == kind]
        self.rng.shuffle(remaining)
        selected: list[Question] = []
        limit = PREDICTIVE_PER_SCENE if kind == "predictive" else len(remaining)
        while remaining and self.owed[kind] >= MIN_OWED and len(selected) < limit:
            if kind == "counterfactual" and self.inferential is not None:
                found = self.inferential.choose(remaining, self.owed[kind])
                if found is None:
                    break
                candidate, options = found
                remaining.remove(candidate)
            else:
                # Each question is asked in one form only: affirmative or negated, whichever was used less.
                remaining.sort(key=lambda c: self.families[kind, str(c.negated)])
                candidate = remaining.pop(0)
                options = self._options(candidate)
            if not options:
                continue
            other = candidate.program[:-1] if candidate.negated else (*candidate.program, "negate")
            remaining = [c for c in remaining if c.program != other]
            self.families[kind, str(candidate.negated)] += 1
            self.owed[kind] -= 1
            choices = tuple(
                Choice(i, o.text, o.program, "correct" if o.correct else "wrong", o.tag) for i, o in enumerate(options)
            )
            selected.append(Question(0, candidate.text, kind, None, candidate.program, None, choices))
        return selected

    def _options(self, question: MultipleChoice) -> list[Option]:
        """Options in random order, with the number of correct ones that is most below its target share; [] when none fits."""
        kind, form = question.type, (question.type, question.negated)
        correct = [o for o in question.options if o.correct]
        wrong = [o for o in question.options if not o.correct]
        max_options = PREDICTIVE_OPTIONS if kind == "predictive" else self.config.max_options
        shares = CORRECT_SHARES[kind]
        total = sum(self.correct[*form, k] for k in shares) + 1
        feasible = {k: min(max_options - k, len(wrong)) for k in shares if k <= min(len(correct), max_options)}
        feasible = {k: w for k, w in feasible.items() if k + w >= MIN_OPTIONS and w >= MIN_WRONG[kind]}
        if not feasible:
            return []
        count = max(feasible, key=lambda k: (shares[k] - self.correct[*form, k] / total, self.rng.random()))
        if self.correct[*form, count] > (shares[count] + MAX_SURPLUS) * total:
            return []
        self.correct[*form, count] += 1
        options = self._least_used(question, correct, count) + self._least_used(question, wrong, feasible[count])
        self.rng.shuffle(options)
        return options

    def _least_used(self, question: MultipleChoice, options: Sequence[Option], count: int) -> list[Option]:
        """Options whose kind was least often correct (or wrong, like these) relative to the opposite."""
        remaining, selected = list(options), []
        for _ in range(count):

            def excess(o: Option) -> float:
                same = self.options[question.type, question.negated, o.kind, o.correct]
                return same - self.options[question.type, question.negated, o.kind, not o.correct] + self.rng.random()

            best = min(remaining, key=excess)
            remaining.remove(best)
            selected.append(best)
            self.options[question.type, question.negated, best.kind, best.correct] += 1
        return selected


class ExtensionSelection:
    """Selects, for one scene after another, a question of each kind with the answer that was used least.

    Args:
        seed: of ties and of the order of options.
        max_options: max number of options of a what-if question.
    """

    def __init__(self, seed: int, max_options: int) -> None:
        self.rng, self.max_options = random.Random(f"{seed} extensions"), max_options
        self.answers: Counter[tuple[str, str]] = Counter()

    def questions(
        self, descriptive: Sequence[Descriptive], changed: Sequence[MultipleChoice], first_id: int
    ) -> list[Question]:
        """The selected questions of a scene, with ids from `first_id` on."""
        found: list[Question] = []
        for kind in EXTENSION_KINDS:
            options = [c for c in descriptive if c.subtype == kind]
            if not options:
                continue
            best = min(options, key=lambda c: (self.answers[kind, c.answer], self.rng.random()))
            self.answers[kind, best.answer] += 1
            number = first_id + len(found)
            found.append(Question(number, best.text, "descriptive", kind, best.program, best.answer, ()))
        for c in changed:
            choices = self._choices(c)
            if choices:
                found.append(Question(first_id + len(found), c.text, c.type, None, c.program, None, choices))
        return found

    def _choices(self, question: MultipleChoice) -> tuple[Choice, ...]:
        """Options in random order, as many correct as wrong ones where there are enough; none where all are alike."""
        correct = [o for o in question.options if o.correct]
        wrong = [o for o in question.options if not o.correct]
        if not correct or not wrong:
            return ()
        most = self.max_options
        n_correct = min(len(correct), max(most // 2, most - len(wrong)))
        options = self.rng.sample(correct, n_correct) + self.rng.sample(wrong, min(len(wrong), most - n_correct))
        self.rng.shuffle(options)
        return tuple(Choice(i, o.text, o.program, "correct" if o.correct else "wrong") for i, o in enumerate(options))


def _target_share(subtype: str, answer: str) -> float:
    return COUNT_SHARES.get(answer, OTHER_COUNT_SHARE) if subtype == "count" else 1 / len(ANSWERS[subtype])
