"""What the benchmarks share: options, real scenes with their truth, Markdown tables, shares with intervals, and timing."""

import shlex
import sys
import time
from argparse import ArgumentParser, Namespace, RawDescriptionHelpFormatter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from nsdr import Event, Scene, SceneObject, VideoTracks, track
from nsdr.clevrer.files.annotations import read_truth
from nsdr.clevrer.files.compact_proposals import read_compact_proposals
from nsdr.clevrer.files.scenes import scene_from_ground_truth
from nsdr.dynamics.motion_states import MotionStates, states_from_tracks
from nsdr.dynamics.physics.bodies import body_records
from nsdr.dynamics.physics.simulator import BodyStates
from nsdr.dynamics.registry import load_backend
from nsdr.evaluation.measures import accuracy_interval, wilson_interval
from nsdr.generate.physics.bullet import Simulator
from nsdr.generate.physics.disturbed import bodies_of
from nsdr.io.fingerprint import code_revision
from nsdr.world.world import CLEVRER_WORLD

Names = tuple[str, ...]
"""Names of the objects of an event, in alphabetical order: they are the same in a perceived scene and in the true one."""


def parser_of(description: str | None) -> ArgumentParser:
    """A parser of options whose help is the docstring of a script."""
    return ArgumentParser(description=description, formatter_class=RawDescriptionHelpFormatter)


def table(columns: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """A Markdown table."""
    head, *body = (f"| {' | '.join(map(str, line))} |" for line in (columns, *rows))
    return "\n".join([head, "|---" * len(columns) + "|", *body])


def percent(count: int, total: int, digits: int = 1) -> str:
    """A share in percent with Wilson's 95 % interval, such as "97.5 (95.3-99.4)"; "-" of nothing."""
    if not total:
        return "-"
    low, high = wilson_interval(count / total, total)
    return f"{100 * count / total:.{digits}f} ({100 * low:.{digits}f}-{100 * high:.{digits}f})"


def percent_right(right: Sequence[bool], scenes: Sequence[int]) -> str:
    """As `percent`, of answers some of which are about the same scene."""
    if not len(right):
        return "-"
    low, high = accuracy_interval(right, scenes)
    return f"{100 * np.mean(right):.1f} ({100 * low:.1f}-{100 * high:.1f})"


def made_by() -> str:
    """The last line of a table in `results/`: the command that made it, and the revision of the code."""
    script = Path(sys.argv[0]).stem
    return (
        f"Made by `{shlex.join(['python', '-m', f'benchmarks.{script}', *sys.argv[1:]])}`, revision {code_revision()}."
    )


def show(text: str, output: Path | None) -> None:
    """Print a table, and write it to a file if there is one."""
    print(text)
    if output:
        output.write_text(text + "\n", encoding="utf-8")


def fastest(runs: Mapping[str, Callable[[], Any]], rounds: int) -> dict[str, tuple[float, float]]:
    """CPU time and wall time (s) of functions that are run by turns; of each, the fastest run after the first round counts."""
    best = dict.fromkeys(runs, (float("inf"), float("inf")))
    for k in range(rounds + 1):
        for name, run in runs.items():
            cpu, wall = time.process_time(), time.perf_counter()
            run()
            spent = time.process_time() - cpu, time.perf_counter() - wall
            if k:
                best[name] = min(best[name][0], spent[0]), min(best[name][1], spent[1])
    return best


def collision_frames(scene: Scene) -> dict[Names, int]:
    """Frame of the observed collision of each pair."""
    return {named(scene, e): e.frame for e in scene.events if e.kind == "collision"}


def named(scene: Scene, event: Event) -> Names:
    """The objects of an event by their names."""
    return tuple(sorted(scene.objects[i].name for i in event.objects))


def load_default(dynamics: str = "physics") -> Any:
    """A dynamics backend with the default weights."""
    return load_backend(dynamics)


def add_real_scenes(parser: ArgumentParser) -> None:
    """Options that say which real scenes are measured."""
    parser.add_argument("--proposals", type=Path, required=True, help="compact official proposals, .npz")
    parser.add_argument("--truth", type=Path, required=True, help="compact truth, .json.gz")
    parser.add_argument("--every", type=int, default=1, help="keep the scenes whose index has the remainder --first")
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--scenes", type=int, help="number of scenes; all by default")


@dataclass(frozen=True)
class RealScene:
    """A video as it was tracked from official proposals, and its truth."""

    index: int
    tracks: VideoTracks
    truth: Scene

    @cached_property
    def states(self) -> MotionStates:
        """Of the tracks."""
        return states_from_tracks(self.tracks)

    @property
    def true_names(self) -> set[str]:
        """Names of the true objects."""
        return {o.name for o in self.truth.objects}

    @property
    def found_names(self) -> set[str]:
        """Names of the tracked objects."""
        return {t.object.name for t in self.tracks.tracks}

    @cached_property
    def true_collisions(self) -> list[Event]:
        """True collisions by the ids of the tracks; true objects that have no track have ids from 100 on."""
        ids = {t.object.name: t.object.id for t in self.tracks.tracks}
        number = [ids.get(o.name, 100 + o.id) for o in self.truth.objects]
        collisions = (e for e in self.truth.events if e.kind == "collision")
        return [Event("collision", e.frame, tuple(sorted(number[i] for i in e.objects))) for e in collisions]


def real_scenes(options: Namespace) -> Iterator[RealScene]:
    """The scenes of the options of `add_real_scenes`."""
    truth = read_truth(options.truth)
    chosen = (row for row in read_compact_proposals(options.proposals) if row[0] % options.every == options.first)
    for index, proposals in islice(chosen, options.scenes):
        true = scene_from_ground_truth(truth[index], truth[index]["n_frames"])
        yield RealScene(index, track(proposals), true)


Collisions = list[list[int]]
"""Rows (i, j, frame) with i < j."""


def bullet_collisions(
    shapes: Mapping[int, str], states: np.ndarray, start: int, end: int, simulator: Simulator
) -> Collisions:
    """What Bullet finds from a frame on.

    Args:
        shapes: of the objects that are there, by id.
        states: rows of `nsdr.generate.physics.disturbed.states_at` of these objects, in the same order; mass 0 for fixed ones.
        start, end: frames at which the simulation starts, and before which it ends.
        simulator: Bullet.
    """
    ids = list(shapes)
    contacts = simulator.run(bodies_of(list(shapes.values()), states), end - start).contacts
    return [[*sorted(ids[k] for k in c.bodies), c.frame + start] for c in contacts]


def planar_bodies(shapes: Sequence[str], states: np.ndarray) -> BodyStates:
    """The rows of `states_at` for the simulator of the physics backend; yaws are those of cubes alone."""
    planar = states[:, [0, 1, 6, 7, 5, 11]].copy()
    objects = [SceneObject(i, "red", "metal", shape) for i, shape in enumerate(shapes)]
    planar[[shape != "cube" for shape in shapes], 4:] = 0.0
    return BodyStates(body_records(objects, CLEVRER_WORLD), planar, states[:, 12].copy())
