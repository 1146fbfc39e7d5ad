"""Programs and scenes a second on one core: `python benchmarks/executor.py`.

CPU time, 5-object scenes, all question types mixed, all programs as token lists. Needs no data: scenes and prediction files are
made up, programs come from the grammar.
"""

import argparse
import json
import random
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec

from nsdr.clevrer.files.predictions import (
    PredictionFile,
    read_predictions,
    scene_from_predictions,
)
from nsdr.errors import ExecutionError
from nsdr.language.texts import sample
from nsdr.symbolic import Executor, OfficialExecutor, Program
from nsdr.validation import convert
from nsdr.world.vocabulary import COLORS, MATERIALS, SHAPES

OBJECTS = 5


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
    return convert({"objects": listed, "predictions": [rollout(k) for k in range(-1, OBJECTS)]}, PredictionFile)


def programs_for(document: PredictionFile, rng: random.Random, count: int = 28) -> list[list[str]]:
    """Programs that run without error on the scene of a prediction file: 2 of 5 are choices with their question."""
    executor = Executor(scene_from_predictions(document))
    found: list[list[str]] = []
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
        found.append(list(program.tokens))
    return found


def rate(work: Callable[[], int], repeats: int = 5) -> float:
    """Best number of things done a second of CPU time."""
    best = 0.0
    for _ in range(repeats):
        start = time.process_time()
        done = work()
        best = max(best, done / (time.process_time() - start))
    return best


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenes", type=int, default=100)
    parser.add_argument("--repeats", type=int, default=5, help="the best of so many runs counts")
    options = parser.parse_args(arguments)
    rng = random.Random(0)
    documents = [prediction_file(rng) for _ in range(options.scenes)]
    programs = [programs_for(d, rng) for d in documents]
    scenes = [scene_from_predictions(d) for d in documents]
    total = sum(map(len, programs))
    tokens = sum(len(p) for listed in programs for p in listed) / total
    print(f"{len(scenes)} scenes of {OBJECTS} objects, {total} token lists of {tokens:.1f} tokens on average; CPU time")

    def each(run: Callable[[Executor, list[str]], Any]) -> int:
        for scene, listed in zip(scenes, programs, strict=True):
            executor = Executor(scene)
            for program in listed:
                run(executor, program)
        return total

    print(f"{'values':<34}{rate(lambda: each(Executor.run), options.repeats):>12,.0f} programs/s")
    print(f"{'answers with traces':<34}{rate(lambda: each(Executor.answer), options.repeats):>12,.0f} programs/s")
    with tempfile.TemporaryDirectory() as folder:
        files = [Path(folder) / f"sim_{i:05d}.json" for i in range(len(documents))]
        for file, document in zip(files, documents, strict=True):
            file.write_bytes(msgspec.json.encode(document))
        rows: dict[str, Callable[[Path], Any]] = {
            "files to scenes": lambda f: scene_from_predictions(read_predictions(f)),
            "files to official executors": lambda f: OfficialExecutor(read_predictions(f)),
            "json.load alone": lambda f: json.loads(f.read_bytes()),
        }
        for name, make in rows.items():
            speed = rate(lambda make=make: len([make(f) for f in files]), options.repeats)  # type: ignore[misc]
            print(f"{name:<34}{speed:>12,.0f} scenes/s")


if __name__ == "__main__":
    main()
