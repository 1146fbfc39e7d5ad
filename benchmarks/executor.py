"""Programs and scenes a second on one core: `python benchmarks/executor.py`.

CPU time, 5-object scenes, all question types mixed. Needs no data: scenes and prediction files are made up, texts come from the
grammar. The released executor runs about 38,000 programs/s and builds about 250 scenes/s on a core of this kind.
"""

import argparse
import random
import time
from collections.abc import Callable
from typing import Any

from nsdr.clevrer.predictions import PredictionFile, predictions_from_document, scene_from_predictions
from nsdr.errors import ExecutionError
from nsdr.question_parser.grammar.templates import sample
from nsdr.symbolic import Executor, Program
from nsdr.symbolic.official import OfficialExecutor
from nsdr.world.vocabulary import COLORS, MATERIALS, SHAPES

OBJECTS = 5
RELEASED_PROGRAMS_PER_S, RELEASED_SCENES_PER_S = 38_000, 250


def prediction_file(rng: random.Random) -> PredictionFile:
    """A prediction file like the release's: 26 + 12 samples, one rollout per object, three collisions each."""
    triples = rng.sample([(c, m, s) for c in COLORS for m in MATERIALS for s in SHAPES], OBJECTS)
    objects = [{"color": c, "material": m, "shape": s} for c, m, s in triples]

    def rollout(what_if: int) -> dict[str, Any]:
        here = [o for i, o in enumerate(objects) if i != what_if]
        start = [(rng.uniform(10, 90), rng.uniform(10, 140), rng.uniform(-1, 1), rng.choice([0, 0.5])) for _ in here]
        first = [rng.choice([0, 0, 0, 20]) for _ in here]
        trajectory = [
            {
                "frame_index": t,
                "objects": [
                    {"x": x + vx * t * moves, "y": y + t * moves, **o}
                    for o, (x, y, vx, moves), f in zip(here, start, first, strict=True)
                    if t >= f
                ],
            }
            for t in range(0, 190, 5)
        ]
        collisions = [{"frame": rng.randrange(10, 170), "objects": rng.sample(here, 2)} for _ in range(3)]
        return {"what_if": what_if, "trajectory": trajectory, "collisions": collisions}

    listed = [{"id": i, **o} for i, o in enumerate(objects)]
    return predictions_from_document({"objects": listed, "predictions": [rollout(k) for k in range(-1, OBJECTS)]})


def programs_for(document: PredictionFile, rng: random.Random, count: int = 28) -> list[Program]:
    """Programs that run without error on the scene of a prediction file: 2 of 5 are choices with their question."""
    executor = Executor(scene_from_predictions(document))
    found: list[Program] = []
    while len(found) < count:
        if len(found) * 5 < count * 3:
            program = Program.parse(sample("descriptive", rng)[1])
        else:
            question = Program.parse(sample("multiple_choice", rng)[1])
            program = Program.parse(sample("choice", rng)[1]).then(question)
        try:
            executor.run(program)
        except ExecutionError:
            continue
        found.append(program)
    return found


def rate(work: Callable[[], int], repeats: int = 5) -> float:
    """Best number of things done a second of CPU time."""
    best = 0.0
    for _ in range(repeats):
        start = time.process_time()
        done = work()
        best = max(best, done / (time.process_time() - start))
    return best


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenes", type=int, default=100)
    count = parser.parse_args().scenes
    rng = random.Random(0)
    documents = [prediction_file(rng) for _ in range(count)]
    scenes = [scene_from_predictions(d) for d in documents]
    programs = [programs_for(d, rng) for d in documents]
    total = sum(len(p) for p in programs)
    tokens = sum(len(p.tokens) for listed in programs for p in listed) / total

    def single() -> int:
        for scene, listed in zip(scenes, programs, strict=True):
            executor = Executor(scene)
            for program in listed:
                executor.run(program)
        return total

    def batch() -> int:
        for scene, listed in zip(scenes, programs, strict=True):
            Executor(scene).run_batch(listed)
        return total

    def parse() -> int:
        for listed in programs:
            for program in listed:
                Program.parse(list(program.tokens))
        return total

    print(
        f"{count} scenes of {OBJECTS} objects, {total} programs of {tokens:.1f} tokens on average; one core, CPU time"
    )
    for name, work in (("single programs", single), ("batch call", batch), ("parsing token lists again", parse)):
        speed = rate(work)
        print(
            f"{name:<28}{speed:>12,.0f} programs/s {speed / RELEASED_PROGRAMS_PER_S:>7.1f}x the released executor's rate"
        )
    builders: tuple[tuple[str, Callable[[Any], Any]], ...] = (
        ("scenes, paper semantics", scene_from_predictions),
        ("worlds, official semantics", OfficialExecutor),
    )
    for name, build in builders:
        speed = rate(lambda build=build: len([build(d) for d in documents]))  # type: ignore[misc]
        print(
            f"{name:<28}{speed:>12,.0f} scenes/s   {speed / RELEASED_SCENES_PER_S:>7.1f}x the released executor's rate"
        )


if __name__ == "__main__":
    main()
