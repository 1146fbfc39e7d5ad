"""How precisely must states be known to say what happens without an object? Bullet, our simulator and the default compared.

`python -m benchmarks.precision DATA FOLDER [--scenes 300] [--runs 30] [-o results/precision.md]`

DATA is a data set of `nsdr generate dataset` with questions; FOLDER keeps what was found, one file a scene, so a second call
goes on. The course of events without each object that a counterfactual question of the validation split removes is told

- by Bullet from the true states, one run, from the frame before the removed object's first collision;
- by Bullet and by our simulator from states measured with an error: `--runs` runs start from them, all but the first with
  another such error, and what happens in most of them counts;
- by the default, fitted to the tracks of exact masks.

Whatever the removal cannot influence is as in the video, for all. Velocities, yaws and masses have errors in proportion to
those of positions. The questions are then answered in the true scene with these courses.
About 0.35 seconds of a core a run and scene.
"""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import combinations
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from msgspec import structs
from numpy.typing import NDArray

from benchmarks.shared import (
    Collisions,
    bullet_collisions,
    load_default,
    made_by,
    parser_of,
    planar_bodies,
    show,
    table,
)
from nsdr import Event, Scene, track
from nsdr.clevrer.files.annotations import read_truth_file
from nsdr.clevrer.files.proposals import parse_proposals
from nsdr.clevrer.files.questions import Question, SceneQuestions, read_questions
from nsdr.clevrer.files.scenes import scene_from_truth
from nsdr.dynamics.motion_states import states_from_tracks
from nsdr.dynamics.physics import VERSION
from nsdr.dynamics.physics.simulator import NO_CONTACT, simulate
from nsdr.evaluation.measures import percent
from nsdr.evaluation.score import score_scenes
from nsdr.generate.physics.bullet import BulletMotion, Contact, Simulator
from nsdr.generate.physics.disturbed import disturbed, states_at
from nsdr.generate.physics.scene import SimulatedScene
from nsdr.generate.scene_files import proposal_document
from nsdr.io.files import find_files, write_json
from nsdr.io.fingerprint import fingerprint
from nsdr.io.jobs import Job, run_jobs
from nsdr.io.reading import read_json
from nsdr.symbolic import Executor
from nsdr.world.camera import CLEVRER_CAMERA
from nsdr.world.vocabulary import CLEVRER
from nsdr.world.world import CLEVRER_WORLD

ERRORS_WORLD = (0.001, 0.003, 0.01)
"""Standard deviations of the errors of positions (world units; objects are 0.4 wide)."""
UNITS = {"position": " world units", "velocity": " world units/s", "log mass": ""}
"""Of the errors of the default's states."""
EXACT, DEFAULT = "Bullet, true states", "default, from tracks"
MEASURED = ("Bullet", "our simulator")


class Course(NamedTuple):
    """A scene without an object.

    Attributes:
        collisions: (i, j, frame) of the video and after it, with the object.
        removed: id of the object.
        start: frame before its first collision.
        states: (n, 13) location, Euler angles, velocity, angular velocity and mass of all objects at that frame.
        shapes: of all objects.
    """

    collisions: Collisions
    removed: int
    start: int
    states: NDArray[np.float64]
    shapes: list[str]

    @property
    def kept(self) -> list[int]:
        """Ids of the other objects."""
        return [i for i in range(len(self.shapes)) if i != self.removed]


def course_of(truth: Mapping[str, Any], removed: int) -> Course:
    """The scene of a truth file without an object that collides."""
    collisions = [[*sorted(c["object_ids"]), c["frame_id"]] for c in truth["collisions"]]
    start = max(min((f for i, j, f in collisions if removed in (i, j)), default=1) - 1, 0)
    return Course(collisions, removed, start, states_at(truth, start), [o["shape"] for o in truth["objects"]])


def by_bullet(course: Course, frames: int, simulator: Simulator) -> Collisions:
    """What Bullet finds from the course's start on."""
    shapes = {i: course.shapes[i] for i in course.kept}
    return bullet_collisions(shapes, course.states[course.kept], course.start, frames, simulator)


def by_ours(course: Course, frames: int) -> Collisions:
    """What our simulator finds: the first contact of each pair."""
    exists = np.arange(len(course.shapes)) != course.removed
    bodies = planar_bodies(course.shapes, course.states)
    contacts = simulate(bodies, exists, frames, start=course.start).contacts[0]
    return [[i, j, int(contacts[i, j])] for i, j in combinations(course.kept, 2) if contacts[i, j] != NO_CONTACT]


def with_video(course: Course, found: Collisions) -> Collisions:
    """A run's collisions, with those of the video instead where neither object is influenced by the removal until then."""
    since = dict.fromkeys(range(len(course.shapes)), math.inf) | {course.removed: -1.0}
    for i, j, frame in sorted([*course.collisions, *found], key=lambda row: row[2]):
        if min(since[i], since[j]) <= frame:  # also in a collision that does not take place any more
            since[i], since[j] = min(since[i], frame), min(since[j], frame)

    def is_changed(row: list[int]) -> bool:
        return min(since[row[0]], since[row[1]]) < row[2] or course.removed in row[:2]

    pause = CLEVRER_WORLD.physics.contact_pause_frames
    rows = [row for row in course.collisions if not is_changed(row)]
    before = {(i, j): frame for i, j, frame in rows}
    rows += [row for row in found if is_changed(row) and row[2] > before.get((row[0], row[1]), -math.inf) + pause]
    return sorted(rows, key=lambda row: row[2])


def most(runs: Sequence[Collisions]) -> Collisions:
    """The first collision of each pair that collides in most runs, at the median of its frames."""
    frames: dict[tuple[int, int], list[int]] = {}
    for rows in runs:
        first: dict[tuple[int, int], int] = {}
        for i, j, frame in rows:
            first.setdefault((i, j), frame)
        for pair, frame in first.items():
            frames.setdefault(pair, []).append(frame)
    return [[*pair, int(np.median(at))] for pair, at in frames.items() if len(at) > len(runs) / 2]


def simulated_scene(truth: Mapping[str, Any]) -> SimulatedScene:
    """What a truth file was made of."""
    scene = scene_from_truth(truth)
    names = ("location", "orientation", "velocity", "angular_velocity")
    arrays = [np.array([[o[name] for o in f["objects"]] for f in truth["frames"]]).swapaxes(0, 1) for name in names]
    contacts = tuple(Contact(c["frame_id"], tuple(c["object_ids"]), tuple(c["location"])) for c in truth["collisions"])
    mass = np.array([o["mass"] for o in truth["objects"]])
    return SimulatedScene(truth["seed"], scene.objects, mass, scene.n_frames, BulletMotion(*arrays, contacts), {})


def by_default(
    truth: Mapping[str, Any], removed: Sequence[int], backend: Any
) -> tuple[dict[int, Collisions], dict[str, list[float]]]:
    """The default's collisions without each object, and the errors of its states where the courses start.

    Errors are those of places and velocities (lengths) of moving objects, and of the log masses, relative to their mean, of
    objects that collide in the video.
    """
    document = proposal_document(simulated_scene(truth), truth["scene_index"], "", CLEVRER_CAMERA)
    tracks = track(parse_proposals(json.dumps(document).encode(), "proposals"))
    explanation = backend.explain(states_from_tracks(tracks))
    observed, physics = explanation.observed, explanation.physics
    numbers = {o["color"] + o["material"] + o["shape"]: o["object_id"] for o in truth["objects"]}
    true_id = [numbers.get(o.color + o.material + o.shape, -1) for o in explanation.objects]
    courses, errors = {}, {name: list[float]() for name in UNITS}
    met = {t for c in truth["collisions"] if c["frame_id"] < explanation.n_frames for t in c["object_ids"]}
    for i in (i for i in removed if i in true_id):
        found = explanation.counterfactual[true_id.index(i)].collisions
        rows = [[*sorted(true_id[k] for k in e.objects), e.frame] for e in found]
        courses[i] = [row for row in rows if row[0] >= 0]
        course = course_of(truth, i)
        if course.start >= explanation.n_frames:
            continue
        place, velocity = observed.location_world[:, course.start], physics.velocity_world_per_s[:, course.start]
        for k, t in enumerate(true_id):
            is_moving = (
                t in course.kept and np.hypot(*course.states[t, 6:8]) > CLEVRER_WORLD.physics.moving_speed_world_per_s
            )
            if is_moving and np.isfinite([place[k], velocity[k]]).all():
                errors["position"].append(math.dist(place[k], course.states[t, 0:2]))
                errors["velocity"].append(math.dist(velocity[k], course.states[t, 6:8]))
        weighed = [k for k, t in enumerate(true_id) if t in met]
        if weighed:
            off = physics.log_mass[weighed] - np.log(course.states[[true_id[k] for k in weighed], 12])
            errors["log mass"] += (off - off.mean()).tolist()
    return courses, errors


def explore(runs: int, item: tuple[Path, Sequence[int]], output: Path) -> None:
    """Write what every source finds of a scene without each of some objects: the item is its truth file, and their ids."""
    truth_path, removed = item
    truth = read_truth_file(truth_path)
    rng, frames = np.random.default_rng(truth["seed"]), len(truth["frames"])
    found: dict[str, dict[int, Collisions]] = {EXACT: {}}
    with Simulator() as simulator:
        for i in removed:
            course = course_of(truth, i)
            told = partial(by_bullet, frames=frames, simulator=simulator), partial(by_ours, frames=frames)
            found[EXACT][i] = most([with_video(course, told[0](course))])
            found.setdefault(f"{MEASURED[1]}, true states", {})[i] = most([with_video(course, told[1](course))])
            for error in ERRORS_WORLD:
                measured = course._replace(states=disturbed(course.states, error, rng))
                others = (disturbed(measured.states, error, rng) for _ in range(runs - 1))
                starts = [measured, *(course._replace(states=states) for states in others)]
                for name, tell in zip(MEASURED, told, strict=True):
                    of_runs = [with_video(course, tell(start)) for start in starts]
                    found.setdefault(f"{name}, {error:g}", {})[i] = most(of_runs)
    found[DEFAULT], errors = by_default(truth, removed, load_default())
    write_json(output, {"found": found, "errors": errors})


def removed_by(question: Question, scene: Scene) -> int:
    """Id of the object that a counterfactual question removes."""
    assert question.program is not None
    before = question.program[: question.program.index("get_counterfact")]
    words = CLEVRER.attributes.keys() & set(before)
    (one,) = [o.id for o in scene.objects if words <= {o.color, o.material, o.shape}]
    return one


def answers(
    asked: Sequence[SceneQuestions], truths: Mapping[int, Scene], documents: Mapping[int, Any], name: str
) -> Any:
    """The report of all questions in the true scenes with a source's courses."""
    executors = []
    for scene in asked:
        courses = {
            int(i): tuple(Event("collision", f, (a, b)) for a, b, f in rows)
            for i, rows in documents[scene.scene_index]["found"][name].items()
        }
        executors.append(Executor(replace(truths[scene.scene_index], counterfactual=courses)))
    return score_scenes(zip(asked, executors, strict=True))["counterfactual"]


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("data", type=Path)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--scenes", type=int, default=300)
    parser.add_argument("--runs", type=int, default=30)
    parser.add_argument("--workers", type=int, default=0)
    parser.add_argument("-o", "--output", type=Path)
    options = parser.parse_args()
    truths, jobs, asked = {}, [], []
    for scene in read_questions(options.data / "questions" / "validation.json")[: options.scenes]:
        index = scene.scene_index
        (path,) = find_files(options.data / "truth" / "validation", f"truth_{index:05d}.json")
        questions = tuple(q for q in scene.questions if q.type == "counterfactual")
        if questions:
            truths[index] = scene_from_truth(read_truth_file(path))
            asked.append(structs.replace(scene, questions=questions))
            removed = sorted({removed_by(q, truths[index]) for q in questions})
            key = fingerprint(inputs=[path], config=[VERSION, options.runs, removed, ERRORS_WORLD])
            jobs.append(Job(f"scene {index}", (path, removed), options.folder / f"{index}.json", key))
    done = run_jobs(partial(explore, options.runs), jobs, options.folder, workers=options.workers)
    done.succeeded(jobs, options.folder, keep_going=False)
    documents = {scene.scene_index: read_json(job.output) for scene, job in zip(asked, jobs, strict=True)}
    rows = []
    for name in next(iter(documents.values()))["found"]:
        report = answers(asked, truths, documents, name)
        rows.append((name, *(percent(report, kind, " ({:.1f}-{:.1f})") for kind in ("per_option", "per_question"))))
    n_questions = sum(len(scene.questions) for scene in asked)
    lines = ["# How precisely states must be known", ""]
    lines += [table(("worlds without an object", "options (%)", "questions (%)"), rows), ""]
    lines.append(
        f"{n_questions} counterfactual questions about {len(jobs)} generated scenes; {options.runs} runs. 95 % intervals."
    )
    for name, unit in UNITS.items():
        errors = [abs(value) for document in documents.values() for value in document["errors"][name]]
        middle, most_of = np.quantile(errors, [0.5, 0.68])
        lines.append(f"Errors of the default's {name}: median {middle:.4f}, 68 % below {most_of:.4f}{unit}.")
    show("\n".join([*lines, "", made_by()]), options.output)


if __name__ == "__main__":
    main()
