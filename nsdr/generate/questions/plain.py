"""Questions about objects alone, such as "How many cubes are there?": without events, from which networks learn sooner."""

import random
from collections import Counter

from nsdr.clevrer.files.questions import Question
from nsdr.errors import ExecutionError
from nsdr.language.texts import in_words
from nsdr.symbolic import Executor
from nsdr.types import Scene
from nsdr.world.vocabulary import ATTRIBUTES

__all__ = ["PLAIN", "plain_questions"]

PLAIN = "plain"
"""Subtype of these questions."""
TRIES = 10
"""Questions that are drawn for each that is wanted, of which many have no answer, or a frequent one."""
SAME_ANSWER = 0.25
"""Largest share of a scene's questions with the same ending and answer."""
WITH_TIME = 0.3
"""Share of the questions about motion when the video begins or ends."""


def plain_questions(scene: Scene, rng: random.Random, count: int) -> list[Question]:
    """At most `count` different questions about a scene's objects. CLEVRER itself has none of those without motion."""
    executor, used = Executor(scene), Counter[tuple[str, str]]()
    found: dict[str, Question] = {}
    for _ in range(TRIES * count if scene.objects else 0):
        program = _drawn(scene, rng)
        try:
            answer = executor.answer(program).answer
        except ExecutionError:
            continue
        key = program[-1], str(answer)
        if used[key] < max(1, SAME_ANSWER * count):
            text = in_words(program)
            used[key] += text not in found
            found[text] = Question(0, text, "descriptive", PLAIN, program, answer, ())
        if len(found) == count:
            break
    return list(found.values())


def _drawn(scene: Scene, rng: random.Random) -> tuple[str, ...]:
    """A random program: objects by one or two of an object's attributes, or by a random one; their motion; what is asked."""
    ending = rng.choice(["count", "exist", *[f"query_{name}" for name in ATTRIBUTES]])
    names = [name for name in ATTRIBUTES if ending != f"query_{name}"]
    chosen = rng.choice(scene.objects)
    words = {name: getattr(chosen, name) for name in rng.sample(names, rng.randint(1, 2))}
    if ending in ("count", "exist") and rng.random() < 0.5:
        name = rng.choice(names)
        words = {name: rng.choice(ATTRIBUTES[name])}
    program = ["objects", *(token for name in sorted(words) for token in (words[name], f"filter_{name}"))]
    if rng.random() < WITH_TIME:
        program += [rng.choice(["start", "end"]), "get_frame", rng.choice(["filter_moving", "filter_stationary"])]
    return (*program, *([] if ending in ("count", "exist") else ["unique"]), ending)
