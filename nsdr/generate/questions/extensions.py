"""Questions beyond CLEVRER about scenes with known velocities and masses, and the choice of some of them for each scene."""

import random
from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import combinations

from nsdr.clevrer.files.questions import Choice, Question
from nsdr.errors import ExecutionError
from nsdr.generate.questions.candidates import Descriptive, MultipleChoice, Option, SceneWords
from nsdr.language.texts import clevrer
from nsdr.symbolic import Executor
from nsdr.symbolic.quantities import Simulate
from nsdr.types import Scene

__all__ = ["EXTENSION_KINDS", "ExtensionSelection", "changed_questions", "extension_questions"]

EXTENSION_KINDS = (
    *("speed", "direction", "is_faster", "faster", "extreme_speed"),
    *("is_heavier", "heavier", "heaviest"),
)
"""Subtypes of the descriptive questions beyond CLEVRER; in capitals their symbols in beyond.rules."""


def extension_questions(scene: Scene, rng: random.Random) -> Iterator[Descriptive]:
    """All descriptive questions beyond CLEVRER that have an answer in the scene, each in a random wording."""
    words, executor = SceneWords(scene, rng), Executor(scene)
    for subtype in EXTENSION_KINDS:
        for text, program in clevrer().every(subtype.upper(), words, rng):
            try:
                value = executor.answer(program).answer
            except ExecutionError:  # not known, or no such object or event
                continue
            assert value is not None
            yield Descriptive(text, tuple(program), subtype, value, subtype)


def changed_questions(scene: Scene, simulate: Simulate, rng: random.Random, n: int) -> Iterator[MultipleChoice]:
    """Up to `n` what-if questions about changed objects, drawn at random, each with all pairs of objects as options.

    Args:
        scene: the scene.
        simulate: gives the true collisions with a change.
        rng: draws objects, changes and wordings.
        n: number of questions; each takes two simulations.
    """
    words, executor = SceneWords(scene, rng), Executor(scene, simulate=simulate)
    drawn = [(text, tuple(tokens)) for text, tokens in clevrer().every("CHANGED", words, rng)]
    rng.shuffle(drawn)
    asked: set[tuple[str, ...]] = set()
    for text, program in drawn:
        change = program[: program.index("get_changed")]
        if len(asked) >= n or change in asked:
            continue
        try:
            options = _options(scene, words, executor, program, rng)
        except ExecutionError:  # impossible, or not known
            continue
        asked.add(change)
        yield MultipleChoice(text, program, "counterfactual", program[-1] == "negate", options)


def _options(
    scene: Scene, words: SceneWords, executor: Executor, program: Sequence[str], rng: random.Random
) -> tuple[Option, ...]:
    options = []
    for pair in combinations(range(len(scene.objects)), 2):
        words.named = list(rng.sample(pair, 2))
        text, choice = next(clevrer().every("HAPPENS", words, rng))
        options.append(Option(text, tuple(choice), bool(executor.run([*choice, *program])), "happens"))
    return tuple(options)


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
