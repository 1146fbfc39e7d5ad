"""Programs and scenes a second on one core: `python benchmarks/executor.py [--official DIR]`.

CPU time, 5-object scenes, all question types mixed, all programs as token lists. Needs no data: scenes and prediction files are
made up, programs come from the grammar. `--official DIR` runs the released research code of a clone in DIR on the same files
and programs; without it, programs are compared with 38,000 a second, measured on a core of this kind, and files with
0.37 times the rate of `json.load`, which is the share that the released code had where both were measured.
"""

import argparse
import importlib
import json
import random
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec

from nsdr.clevrer.files.predictions import (
    PredictionFile,
    predictions_from_document,
    read_predictions,
    scene_from_predictions,
)
from nsdr.errors import DataError, ExecutionError
from nsdr.language.texts import sample
from nsdr.symbolic import Executor, Program
from nsdr.symbolic.program import RESEARCH_NAMES
from nsdr.world.vocabulary import COLORS, MATERIALS, SHAPES

OBJECTS = 5
RELEASED_PROGRAMS_PER_S, RELEASED_SHARE_OF_JSON = 38_000, 126 / 343
RELEASED_NAMES = {ours: theirs for theirs, ours in RESEARCH_NAMES.items() if ours != "filter_stationary"}
RELEASED_NAMES |= {"start": "events filter_start", "end": "events filter_end"}


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


def released_code(folder: Path) -> tuple[Any, Any]:
    """The classes `Simulation` and `Executor` of a clone of the released research code.

    Raises:
        DataError: the folder has no `executor.py` with `simulation.py` beside it, or they cannot be imported.
    """
    places = [
        p for p in (folder, folder / "executor") if (p / "executor.py").is_file() and (p / "simulation.py").is_file()
    ]
    if not places:
        raise DataError(
            f"--official {folder}: expected a clone with executor/executor.py and executor/simulation.py, found neither"
        )
    for name in ("executor", "simulation"):
        sys.modules.pop(name, None)
    sys.path.insert(0, str(places[0]))
    try:
        classes = importlib.import_module("simulation").Simulation, importlib.import_module("executor").Executor
    except (ImportError, AttributeError, SyntaxError) as e:
        raise DataError(f"--official {folder}: expected classes Simulation and Executor, got {e}") from e
    finally:
        sys.path.remove(str(places[0]))
    return classes


def released_names(tokens: list[str]) -> list[str]:
    """A program in the released executor's names."""
    return " ".join(RELEASED_NAMES.get(token, token) for token in tokens).split()


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenes", type=int, default=100)
    parser.add_argument("--repeats", type=int, default=5, help="the best of so many runs counts")
    parser.add_argument("--official", type=Path, help="a clone of the released research code")
    options = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as folder:
        try:
            compare(options, Path(folder))
        except DataError as e:
            parser.error(str(e))


def compare(options: argparse.Namespace, folder: Path) -> None:
    """Print the rates of both sides."""
    rng = random.Random(0)
    documents = [prediction_file(rng) for _ in range(options.scenes)]
    files = [folder / f"sim_{i:05d}.json" for i in range(len(documents))]
    for file, document in zip(files, documents, strict=True):
        file.write_bytes(msgspec.json.encode(document))
    programs = [programs_for(d, rng) for d in documents]
    total = sum(len(p) for p in programs)
    tokens = sum(len(p) for listed in programs for p in listed) / total
    scenes = [scene_from_predictions(d) for d in documents]
    print(f"{len(files)} scenes of {OBJECTS} objects, {total} token lists of {tokens:.1f} tokens on average; CPU time")
    programs_per_s = float(RELEASED_PROGRAMS_PER_S)
    json_per_s = rate(lambda: len([json.loads(f.read_bytes()) for f in files]), options.repeats)
    scenes_per_s = RELEASED_SHARE_OF_JSON * json_per_s
    if options.official:
        simulation, executor = released_code(options.official)
        theirs = [executor(simulation(str(file), use_event_ann=True)) for file in files]
        renamed = [[released_names(p) for p in listed] for listed in programs]
        work = list(zip(theirs, renamed, strict=True))
        programs_per_s = rate(lambda: sum(len([e.run(p) for p in listed]) for e, listed in work), options.repeats)
        build = [lambda f=file: executor(simulation(str(f), use_event_ann=True)) for file in files]
        scenes_per_s = rate(lambda: len([make() for make in build]), options.repeats)
        print(f"{'released code, programs':<34}{programs_per_s:>12,.0f} programs/s")
        print(f"{'released code, scenes':<34}{scenes_per_s:>12,.0f} scenes/s")
    else:
        print("the released code is not at hand (--official DIR): compared with what was measured of it before")

    def each(run: Callable[[Executor, list[list[str]]], Any]) -> Callable[[], int]:
        def work() -> int:
            for scene, listed in zip(scenes, programs, strict=True):
                run(Executor(scene), listed)
            return total

        return work

    rows = {
        "values": each(lambda executor, listed: [executor.run(p) for p in listed]),
        "answers with traces": each(lambda executor, listed: [executor.answer(p) for p in listed]),
    }
    for name, work_of_row in rows.items():
        speed = rate(work_of_row, options.repeats)
        print(f"{name:<34}{speed:>12,.0f} programs/s {speed / programs_per_s:>6.1f}x")
    for name, make in (
        ("files to scenes", lambda f: scene_from_predictions(read_predictions(f))),
        ("files to official executors", lambda f: Executor(read_predictions(f), "official")),
    ):
        speed = rate(lambda make=make: len([make(f) for f in files]), options.repeats)  # type: ignore[misc]
        print(f"{name:<34}{speed:>12,.0f} scenes/s   {speed / scenes_per_s:>6.1f}x")
    print(f"{'json.load alone':<34}{json_per_s:>12,.0f} scenes/s   {json_per_s / scenes_per_s:>6.1f}x")


if __name__ == "__main__":
    main()
