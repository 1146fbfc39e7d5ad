"""Questions beyond CLEVRER about generated videos: how many are answered rightly, wrongly, and refused.

`python benchmarks/extensions.py DATA PROPOSALS [--first 10000] [--scenes 70] [--changed 2] [-o results/extensions.md]`

DATA is a data set of `nsdr generate dataset`, PROPOSALS holds `proposal_*.json` of its videos. The questions and their answers
come from the truth files; what-if questions are simulated in Bullet. They are parsed from their texts and answered on scenes
from the proposals: tracks, and the physics backend. A speed is right if it is off by at most `SPEED_TOLERANCE`. `--errors`
prints, instead, the errors of fitted masses and velocities, on which `DATA_ERROR_SCALE` and `velocity_error_world_per_s` of the
backend are based. About 10 seconds a scene with two what-if questions, 2 seconds with none.
"""

import argparse
from collections import Counter
from collections.abc import Iterable, Iterator
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from nsdr import Scene, load_backend
from nsdr.clevrer.files.annotations import read_truth_file
from nsdr.clevrer.files.proposals import read_proposals
from nsdr.clevrer.files.questions import Question, SceneQuestions
from nsdr.clevrer.files.scenes import scene_from_truth
from nsdr.dynamics.scene import scene_from_prediction
from nsdr.errors import ExecutionError
from nsdr.evaluation.measures import accuracy_interval
from nsdr.generate.physics.changed import TruthWorlds
from nsdr.generate.questions.candidates import EXTENSION_KINDS
from nsdr.generate.questions.selection import QuestionConfig, find_candidates, select_questions
from nsdr.io.checkpoint import find_checkpoint
from nsdr.question_parser.grammar import GrammarParser
from nsdr.symbolic import Executor
from nsdr.tracking.tracker import track

Outcome = tuple[str, str, int]
"""Kind, "right", "wrong" or "refused", and index of the scene."""
SPEED_TOLERANCE = 0.1
"""Speeds are said with one decimal (world units/s)."""
STRIDE = 4
"""Velocities are compared in every fourth frame."""
FITTED = 0.15
"""Mass ratios with a smaller standard deviation are those that the data tell something about (log)."""


def questions_of(paths: Iterable[Path], n_changed: int) -> Iterator[SceneQuestions]:
    """Questions beyond CLEVRER about truth files."""
    config = QuestionConfig(per_video={}, extensions=True, changed_per_video=n_changed)
    truths = map(read_truth_file, paths)
    scenes = ((t["scene_index"], "", scene_from_truth(t), TruthWorlds(t)) for t in truths)
    return select_questions((find_candidates(scene, config) for scene in scenes), config)


def judged(question: Question, executor: Executor, parser: GrammarParser) -> Iterator[tuple[str, str]]:
    """(kind, "right", "wrong" or "refused") of a question, or of each option."""
    if question.answer is not None:
        try:
            said = executor.answer(parser.parse(question.text)).answer
        except ExecutionError:
            yield str(question.subtype), "refused"
            return
        assert said is not None
        right = said == question.answer
        if question.subtype == "speed":
            right = abs(float(said.split()[0]) - float(question.answer.split()[0])) <= SPEED_TOLERANCE + 1e-9
        yield str(question.subtype), "right" if right else "wrong"
        return
    change = next(t for t in question.program or () if "_as_" in t or t == "standing_still")
    try:
        program = parser.parse(question.text, "multiple_choice")
        answer = executor.answer_choices(program, [(c.text, parser.parse(c.text, "choice")) for c in question.choices])
    except ExecutionError:
        outcomes = ["refused"] * len(question.choices)
    else:
        rows = zip(answer.choices, question.choices, strict=True)
        outcomes = ["refused" if a.error else "right" if a.answer == c.answer else "wrong" for a, c in rows]
    for outcome in outcomes:
        yield f"{change}, options", outcome
    whole = "right" if set(outcomes) == {"right"} else "wrong" if "wrong" in outcomes else "refused"
    yield "what-if, whole questions", whole


def table(rows: list[Outcome]) -> list[str]:
    """Lines of the table."""
    lines = [
        "| kind | asked | right | wrong | refused | right of the answered, % (95 %) |",
        "|---|---|---|---|---|---|",
    ]
    kinds = [*EXTENSION_KINDS, *sorted({kind for kind, *_ in rows} - set(EXTENSION_KINDS))]
    lines += [line(kind, [r for r in rows if r[0] == kind]) for kind in kinds]
    lines.append(line("all descriptive", [r for r in rows if r[0] in EXTENSION_KINDS]))
    return [*lines, line("all options", [r for r in rows if r[0].endswith("options")])]


def line(kind: str, rows: list[Outcome]) -> str:
    """A line of the table."""
    counts = Counter(outcome for _, outcome, _ in rows)
    answered = [(outcome == "right", scene) for _, outcome, scene in rows if outcome != "refused"]
    low, high = accuracy_interval([right for right, _ in answered], [scene for _, scene in answered])
    share = f"{100 * counts['right'] / len(answered):.1f} ({100 * low:.1f}-{100 * high:.1f})" if answered else "-"
    cells = [kind, len(rows), counts["right"], counts["wrong"], counts["refused"], share]
    return f"| {' | '.join(map(str, cells))} |"


def errors(scene: Scene, truth: Scene) -> tuple[list[tuple[float, float, float]], list[float]]:
    """(fitted, true, standard deviation) of log mass ratios, and errors of speeds."""
    physics, true = scene.physics, truth.physics
    assert physics is not None
    assert true is not None
    assert physics.log_mass is not None
    assert physics.log_mass_covariance is not None
    assert true.log_mass is not None
    ids = {o.name: o.id for o in truth.objects}
    known = [(o.id, ids[o.name]) for o in scene.objects if o.name in ids]
    masses, c = [], physics.log_mass_covariance
    for (i, a), (j, b) in combinations(known, 2):
        deviation = float(np.sqrt(max(c[i, i] + c[j, j] - 2 * c[i, j], 0.0)))
        masses.append(
            (float(physics.log_mass[i] - physics.log_mass[j]), float(true.log_mass[a] - true.log_mass[b]), deviation)
        )
    executor, true_executor = Executor(scene), Executor(truth)
    speeds = []
    for i, a in known:
        for frame in range(0, scene.n_frames, STRIDE):
            try:
                found = executor.world.quantities.speed(i, frame)
                speeds.append(found - true_executor.world.quantities.speed(a, frame))
            except ExecutionError:
                continue
    return masses, speeds


def print_errors(pairs: list[tuple[Scene, Scene]]) -> None:
    """Print how the errors compare with the standard deviations."""
    found = [errors(scene, truth) for scene, truth in pairs]
    fitted, true, deviation = np.array([row for masses, _ in found for row in masses]).T
    z, told = np.abs(fitted - true) / deviation, deviation < FITTED
    sure = np.abs(fitted) > 1.645 * deviation
    print(
        f"mass ratios: {len(z)}, fitted {told.sum()}; |error| / standard deviation of these: "
        f"68 % {np.quantile(z[told], 0.68):.2f}, 95 % {np.quantile(z[told], 0.95):.2f}"
    )
    print(f"sure: {sure.mean():.1%}, of these right {(fitted * true > 0)[sure].mean():.1%}")
    speeds = np.abs([s for _, row in found for s in row])
    quantiles = f"68 % {np.quantile(speeds, 0.68):.4f}, 95 % {np.quantile(speeds, 0.95):.4f}"
    print(f"speeds: {len(speeds)}, |error| {quantiles} world units/s")


def main() -> None:
    """Measure."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("data", type=Path)
    parser.add_argument("proposals", type=Path)
    parser.add_argument("--first", type=int, default=10_000, help="index of the first scene")
    parser.add_argument("--scenes", type=int, default=70)
    parser.add_argument("--changed", type=int, default=2, help="what-if questions per scene, at most")
    parser.add_argument("--errors", action="store_true", help="print errors of masses and speeds instead")
    parser.add_argument("-o", "--output", type=Path)
    options = parser.parse_args()
    backend: Any = load_backend(find_checkpoint("default"), "physics")
    question_parser = GrammarParser(extensions=True)
    outcomes, pairs = list[Outcome](), []
    indices = range(options.first, options.first + options.scenes)
    paths = [next(options.data.glob(f"truth/*/truth_{index:05d}.json")) for index in indices]
    asked = questions_of(paths, options.changed)
    for index, path in zip(indices, paths, strict=True):
        tracks = track(read_proposals(options.proposals / f"proposal_{index:05d}.json"))
        scene = scene_from_prediction(backend.predict(tracks))
        if options.errors:
            pairs.append((scene, scene_from_truth(read_truth_file(path))))
            continue

        def simulate(change: Any, frame: int, tracks: Any = tracks) -> Any:
            return backend.simulate(tracks, [change], frame).changed.collisions

        executor = Executor(scene, simulate=simulate)
        for question in next(asked).questions:
            outcomes += [(*found, index) for found in judged(question, executor, question_parser)]
    if options.errors:
        print_errors(pairs)
        return
    lines = table(outcomes)
    print("\n".join(lines))
    if options.output:
        options.output.write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
