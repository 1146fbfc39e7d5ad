"""Questions beyond CLEVRER about generated videos: how many are answered rightly, wrongly, and refused.

`python -m benchmarks.extensions DATA PROPOSALS [--first 10000] [--scenes 70] [--changed 2] [-o FILE]`

DATA is a data set of `nsdr generate dataset`, PROPOSALS holds `proposal_*.json` of its videos. The questions and their answers
come from the truth files; what-if questions are simulated in Bullet. They are parsed from their texts and answered on scenes
from the proposals: tracks, and the physics backend. A speed is right if it is off by at most `SPEED_TOLERANCE`. Every object is
also asked about its direction in the image; the rows "sure" and "unsure" divide these questions by the probability that is
stated. About 10 seconds a scene with two what-if questions, 2 seconds with none.

`--errors` prints, instead, the errors of fitted masses, velocities and motion in the image, on which `DATA_ERROR_SCALE` and
`velocity_error_world_per_s` of the backend and `MOTION_ERROR_PX` in `nsdr/symbolic/quantities.py` are based. For the last,
PROPOSALS are the `derender_proposals` of the data set, which have exact masks.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.shared import load_default, parser_of, percent_right, show, table
from nsdr import Scene
from nsdr.clevrer.files.annotations import read_truth_file
from nsdr.clevrer.files.proposals import read_proposals
from nsdr.clevrer.files.questions import Question
from nsdr.clevrer.files.scenes import scene_from_truth
from nsdr.dynamics import simulate
from nsdr.dynamics.motion_states import states_from_tracks
from nsdr.dynamics.scene import motion_px, scene_from_prediction
from nsdr.errors import ExecutionError
from nsdr.generate.physics.changed import TruthSimulator
from nsdr.generate.questions.candidates import EXTENSION_KINDS
from nsdr.generate.questions.selection import QuestionConfig, find_candidates, select_questions
from nsdr.question_parser.grammar import GrammarParser
from nsdr.symbolic import Executor
from nsdr.tracking.tracker import existence, track
from nsdr.world.camera import CLEVRER_CAMERA as CAMERA
from nsdr.world.world import CLEVRER_WORLD

RIGHT, WRONG, REFUSED = "right", "wrong", "refused"
SPEED_TOLERANCE = 0.1
"""Speeds are said with one decimal (world units/s)."""
SURE = 0.9
"""Directions in the image that are said to be more probable are counted by themselves."""
STRIDE = 4
"""Velocities are compared in every fourth frame."""
FITTED = 0.15
"""Mass ratios with a smaller standard deviation are those that the data tell something about (log)."""


def judged(question: Question, executor: Executor, parser: GrammarParser) -> Iterator[tuple[str, str]]:
    """(kind, outcome) of a question, or of each option."""
    if question.answer is not None:
        kind = str(question.subtype)
        try:
            said = executor.answer(parser.parse(question.text)).text
        except ExecutionError:
            yield kind, REFUSED
            return
        assert said is not None
        is_right = said == question.answer
        if kind == "speed":
            is_right = abs(float(said.split()[0]) - float(question.answer.split()[0])) <= SPEED_TOLERANCE + 1e-9
        yield kind, RIGHT if is_right else WRONG
        return
    change = next(t for t in question.program or () if "_as_" in t or t == "standing_still")
    try:
        program = parser.parse(question.text, "multiple_choice")
        answer = executor.answer_choices(program, [(c.text, parser.parse(c.text, "choice")) for c in question.choices])
    except ExecutionError:
        outcomes = [REFUSED] * len(question.choices)
    else:
        rows = zip(answer.choices, question.choices, strict=True)
        outcomes = [REFUSED if a.error else RIGHT if a.answer == c.answer else WRONG for a, c in rows]
    yield from ((f"{change}, options", outcome) for outcome in outcomes)
    yield "what-if, whole questions", RIGHT if set(outcomes) == {RIGHT} else WRONG if WRONG in outcomes else REFUSED


def directions(found: Scene, true: Scene, parser: GrammarParser) -> Iterator[tuple[str, str]]:
    """(kind, outcome) of the direction of each object in the image."""
    for o in true.objects:
        if o.name not in {one.name for one in found.objects} or not true.visible[o.id].any():
            continue
        program = parser.parse(f"In which direction does the {o.name} move in the video?")
        answer, truth = (Executor(scene).answer(program) for scene in (found, true))
        outcome = RIGHT if answer.answer == truth.answer else WRONG
        yield "direction in the image", outcome
        yield f"the same, {'sure' if (answer.probability or 0) > SURE else 'unsure'}", outcome


def table_of(outcomes: Sequence[tuple[str, str, int]]) -> str:
    """Markdown; the outcomes are kind, outcome, and index of the scene."""
    found: dict[str, list[tuple[str, int]]] = {kind: [] for kind in EXTENSION_KINDS}
    for kind, outcome, scene in outcomes:
        found.setdefault(kind, []).append((outcome, scene))
    found["all descriptive"] = [row for kind in EXTENSION_KINDS for row in found[kind]]
    found["all options"] = [row for kind, rows in found.items() if kind.endswith("options") for row in rows]
    rows = []
    for kind, of_kind in found.items():
        answered = [(outcome == RIGHT, scene) for outcome, scene in of_kind if outcome != REFUSED]
        counts = [sum(outcome == name for outcome, _ in of_kind) for name in (RIGHT, WRONG, REFUSED)]
        rows.append((kind, len(of_kind), *counts, percent_right([r for r, _ in answered], [s for _, s in answered])))
    return table(("kind", "asked", RIGHT, WRONG, REFUSED, "right of the answered, % (95 %)"), rows)


def true_motion(truth: Any, true: Scene) -> Scene:
    """The true scene with the motion of objects in the image."""
    places = [[o["location"] for o in frame["objects"]] for frame in truth["frames"]]
    return replace(true, motion_px=motion_px(np.array(places).swapaxes(0, 1), true.visible, CAMERA))


def errors(scene: Scene, truth: Scene) -> tuple[list[tuple[float, float, float]], list[float], list[float]]:
    """(fitted, true, standard deviation) of log mass ratios; errors of speeds (world units/s) and motion (pixels)."""
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
        fitted, right = physics.log_mass[i] - physics.log_mass[j], true.log_mass[a] - true.log_mass[b]
        masses.append((float(fitted), float(right), deviation))
    executor, true_executor = Executor(scene), Executor(truth)
    speeds = []
    for i, a in known:
        for frame in range(0, scene.n_frames, STRIDE):
            try:
                found = executor.facts.quantities.speed(i, frame)
                speeds.append(found - true_executor.facts.quantities.speed(a, frame))
            except ExecutionError:
                continue
    moved = [(i, a) for i, a in known if truth.visible[a].any()]
    motion = [float(np.abs(scene.motion_px[i] - truth.motion_px[a]).max()) for i, a in moved]
    return masses, speeds, motion


def print_errors(pairs: Sequence[tuple[Scene, Scene]]) -> None:
    """Print how the errors compare with the standard deviations."""
    masses, speeds, motion = zip(*(errors(scene, truth) for scene, truth in pairs), strict=True)
    fitted, true, deviation = np.array([row for rows in masses for row in rows]).T
    z, is_fitted = np.abs(fitted - true) / deviation, deviation < FITTED
    sure = np.abs(fitted) > 1.645 * deviation
    print(
        f"mass ratios: {len(z)}, fitted {is_fitted.sum()}; |error| / standard deviation of these: {_quantiles(z[is_fitted])}"
    )
    print(f"sure: {sure.mean():.1%}, of these right {(fitted * true > 0)[sure].mean():.1%}")
    for name, unit, rows in (("speeds", "world units/s", speeds), ("motion in the image", "px", motion)):
        values = np.abs([value for row in rows for value in row])
        print(f"{name}: {len(values)}, |error| {_quantiles(values)} {unit}")


def _quantiles(values: Any) -> str:
    return f"68 % {np.nanquantile(values, 0.68):.4f}, 95 % {np.nanquantile(values, 0.95):.4f}"


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("data", type=Path)
    parser.add_argument("proposals", type=Path)
    parser.add_argument("--first", type=int, default=10_000, help="index of the first scene")
    parser.add_argument("--scenes", type=int, default=70)
    parser.add_argument("--changed", type=int, default=2, help="what-if questions per scene, at most")
    parser.add_argument("--errors", action="store_true", help="print errors of masses, speeds and motion instead")
    parser.add_argument("-o", "--output", type=Path)
    options = parser.parse_args()
    backend, question_parser = load_default(), GrammarParser(extensions=True)
    outcomes, pairs = list[tuple[str, str, int]](), []
    config = QuestionConfig(per_video={}, extensions=True, changed_per_video=options.changed)
    indices = range(options.first, options.first + options.scenes)
    truths = {i: read_truth_file(next(options.data.glob(f"truth/*/truth_{i:05d}.json"))) for i in indices}
    scenes = ((i, "", scene_from_truth(t), TruthSimulator(t)) for i, t in truths.items())
    asked = select_questions((find_candidates(scene, config) for scene in scenes), config, CLEVRER_WORLD)
    for index, truth in truths.items():
        tracks = track(read_proposals(options.proposals / f"proposal_{index:05d}.json"))
        explanation = backend.explain(states_from_tracks(tracks))
        scene = scene_from_prediction(explanation.prediction, existence(tracks))
        true = true_motion(truth, scene_from_truth(truth))
        if options.errors:
            pairs.append((scene, true))
            continue
        executor = Executor(scene, simulate=_changed(explanation))
        found = [row for q in next(asked).questions for row in judged(q, executor, question_parser)]
        outcomes += [(*row, index) for row in (*found, *directions(scene, true, question_parser))]
    if options.errors:
        print_errors(pairs)
    else:
        show(table_of(outcomes), options.output)


def _changed(explanation: Any) -> Callable[[Any, int], Any]:
    return lambda change, frame: simulate(explanation, [change], frame).changed.collisions


if __name__ == "__main__":
    main()
