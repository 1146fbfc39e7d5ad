"""Scores of a continuation: its errors, its collisions, and how well it agrees with the possible futures."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Annotated, Any

import numpy as np

from nsdr.clevrer.files.scenes import scene_from_truth
from nsdr.types import Event, SceneObject
from nsdr.types.arrays import ArrayHolder
from nsdr.types.events import SAME_EVENT_FRAMES
from nsdr.validation import Array, BoolArray, FloatArray, IntArray
from nsdr.world.world import World

Sums = dict[str, Any]
"""Sums by name: a number, or a list with a number for each frame after the cut. Sums of several runs or videos can be added."""
MIN_GIVEN_FRAMES = 8
"""An object must be in the image in at least this many of the given frames to be known from them."""
KERNEL_WORLD, KERNEL_FREEDOM = 0.02, 3.0
"""Scale (world units in CLEVRER) and degrees of freedom of Student's t distribution around each position of a possible future.
The scale is about twice the mean error with which the frame parser sees positions (the row "truth, as perceived" in
docs/video_models.md); the tails reach to what lies between the futures."""


@dataclass(frozen=True, eq=False, repr=False)
class Continuation(ArrayHolder):
    """A video, prediction or run in the F frames after the cut, with n objects that have the ids of the truth.

    Attributes:
        location_world: (n, F, 2) positions on the ground (world units); NaN where an object is not found.
        collisions: collisions, with frame numbers of the whole video.
        words: (n, F) int, 1 where an object has the same color, material and shape as in the given frames, 0 where it does not,
            -1 where this is not seen; None for predictions of positions alone.
    """

    location_world: Annotated[FloatArray, Array("n", "F", 2, nan=True)]
    collisions: tuple[Event, ...]
    words: Annotated[IntArray, Array("n", "F", low=-1, high=1)] | None = None


@dataclass(frozen=True, eq=False, repr=False)
class TrueFuture(ArrayHolder):
    """The true future: what happens after the given frames, and which part of it can be predicted from them.

    The motion of an object cannot be predicted after it has been affected, directly or through other objects, by an object that
    the given frames do not show.

    Attributes:
        objects: identities of the n objects.
        cut: number of given frames.
        given_world: (n, cut, 2) positions in the given frames (world units); NaN outside the image.
        location_world: (n, F, 2) positions after the cut (world units).
        asked: (n, F) bool, whether the object is in the image and its position can be predicted; only these positions are
            scored.
        collisions: the first collision of each pair after the cut that can be predicted and is in the image.
        touching: pairs that collide near the cut, whose collisions are not scored.
        world: the world of the scene.
    """

    objects: tuple[SceneObject, ...]
    cut: int
    given_world: Annotated[FloatArray, Array("objects", "cut", 2, nan=True)]
    location_world: Annotated[FloatArray, Array("objects", "F", 2, nan=True)]
    asked: Annotated[BoolArray, Array("objects", "F")]
    collisions: tuple[Event, ...]
    touching: frozenset[tuple[int, ...]]
    world: World

    @property
    def known(self) -> list[int]:
        """Ids of the objects that are scored in at least one frame."""
        return np.flatnonzero(self.asked.any(1)).tolist()

    def counted(self, collisions: Iterable[Event]) -> dict[tuple[int, ...], int]:
        """The frame of the first collision of each pair after the cut that is scored."""
        first: dict[tuple[int, ...], int] = {}
        for e in sorted(collisions, key=lambda e: e.frame):
            at = e.frame - self.cut
            inside = 0 <= at < self.asked.shape[1] and e.objects not in self.touching
            if inside and self.asked[list(e.objects), at].all():
                first.setdefault(e.objects, e.frame)
        return first


def true_future(truth: Mapping[str, Any], cut: int, end: int) -> TrueFuture:
    """Read the true future in the frames from `cut` up to, not including, `end` from a truth file.

    Args:
        truth: validated content of the file.
        cut: number of given frames.
        end: end of the future, at most the number of frames of the file.
    """
    scene = scene_from_truth(truth, end)
    n = len(scene.objects)
    location = np.zeros((n, end, 2))
    for f in range(end):
        for row in truth["frames"][f]["objects"]:
            location[row["object_id"], f] = row["location"][:2]
    known_until = np.where(scene.visible[:, :cut].sum(1) >= min(MIN_GIVEN_FRAMES, cut), end, 0)
    collisions = sorted(
        (Event("collision", c["frame_id"], tuple(sorted(c["object_ids"]))) for c in truth["collisions"]),
        key=lambda e: e.frame,
    )
    for e in collisions:
        pair = list(e.objects)
        if e.frame >= cut and (known_until[pair] <= e.frame).any():
            known_until[pair] = np.minimum(known_until[pair], e.frame)
    asked = (scene.visible & (np.arange(end) < known_until[:, None]))[:, cut:]
    given = np.where(scene.visible[:, :cut, None], location[:, :cut], np.nan)
    # A pair that collides this long before the cut may still touch at the cut.
    first_frame = cut - scene.world.physics.contact_pause_frames
    touching = frozenset(e.objects for e in collisions if first_frame <= e.frame <= cut + SAME_EVENT_FRAMES)
    objects = tuple(sorted(scene.objects, key=lambda o: o.id))
    future = TrueFuture(objects, cut, given, location[:, cut:], asked, (), touching, scene.world)
    first = future.counted(collisions).items()
    return replace(future, collisions=tuple(Event("collision", frame, pair) for pair, frame in first))


class PossibleFutures:
    """Possible futures: runs of Bullet from states that cannot be distinguished from the true ones in the given frames.

    Args:
        runs: R runs, at least two.
        truth: the true future.

    Attributes:
        location_world: (R, n, F, 2) positions in each run (world units).
        kernel_world: scale of the distribution around each position (world units).
        pairs: pairs that collide in at least one run.
    """

    def __init__(self, runs: Sequence[Continuation], truth: TrueFuture) -> None:
        self.location_world = np.stack([run.location_world for run in runs])
        self.kernel_world = KERNEL_WORLD * truth.world.scales.size
        self.pairs = frozenset(pair for run in runs for pair in truth.counted(run.collisions))
        others = [self.log_density(run.location_world, leave_out=r) for r, run in enumerate(runs)]
        self.reference: FloatArray = np.mean(others, axis=0)
        """(n, F) mean over all runs of the log density of a run's positions under the other runs."""

    def distances(self, location_world: FloatArray, leave_out: int | None = None) -> FloatArray:
        """(R, n, F) distances of positions (n, F, 2) from those in each run, except the run `leave_out` (world units)."""
        runs = self.location_world if leave_out is None else np.delete(self.location_world, leave_out, 0)
        return np.asarray(np.linalg.norm(location_world - runs, axis=-1))

    def log_density(self, location_world: FloatArray, leave_out: int | None = None) -> FloatArray:
        """(n, F) log density of positions (n, F, 2), up to a constant, under a mixture of Student's t around the runs.

        density ∝ mean over runs of (1 + (distance / s)² / ν)^(-(ν + 2) / 2), s = `kernel_world`, ν = `KERNEL_FREEDOM`
        """
        squared = (self.distances(location_world, leave_out) / self.kernel_world) ** 2
        kernel = (1 + squared / KERNEL_FREEDOM) ** (-(KERNEL_FREEDOM + 2) / 2)
        return np.asarray(np.log(kernel.mean(0)))


def score(found: Continuation, truth: TrueFuture, futures: PossibleFutures, leave_out: int | None = None) -> Sums:
    """Compute the sums from which `MEASURES` are computed.

    Args:
        found: the continuation.
        truth: the true future.
        futures: the possible futures.
        leave_out: index of the possible future that `found` is, which is not compared with itself; None for any other
            continuation.
    """
    place = found.location_world
    is_found = truth.asked & np.isfinite(place).all(-1)
    distances = np.where(is_found, futures.distances(place, leave_out), 0.0)
    nearest = distances[distances.sum((1, 2)).argmin()]
    error = np.where(is_found, np.linalg.norm(place - truth.location_world, axis=-1), 0.0)
    gain = np.where(is_found, futures.log_density(place, leave_out) - futures.reference, 0.0)
    sums: Sums = {
        "asked": truth.asked.sum(0).tolist(),
        "found": is_found.sum(0).tolist(),
        "error": error.sum(0).tolist(),
        "nearest": nearest.sum(0).tolist(),
        "gain": gain.sum(0).tolist(),
    }
    if found.words is not None:
        sums["named"] = (truth.asked & ((found.words >= 0) | ~is_found)).sum(0).tolist()
        sums["same"] = (is_found & (found.words == 1)).sum(0).tolist()
    return sums | _event_sums(truth.counted(found.collisions), truth, futures)


def _event_sums(found: Mapping[tuple[int, ...], int], truth: TrueFuture, futures: PossibleFutures) -> Sums:
    """Sums about collisions; `found` has the frame of the first collision of each pair."""
    true = {e.objects: e.frame for e in truth.collisions}
    right = [(true[pair], frame) for pair, frame in found.items() if pair in true]
    orders = [
        (a[0] - b[0]) * (a[1] - b[1]) > 0 for a, b in combinations(right, 2) if abs(a[0] - b[0]) > SAME_EVENT_FRAMES
    ]
    return {
        "collisions": len(found),
        "true_collisions": len(true),
        "right": len(right),
        "possible": len(found.keys() & (futures.pairs | true.keys())),
        "frames_off": sum(abs(a - b) for a, b in right),
        "orders": len(orders),
        "ordered": sum(orders),
    }


def add(sums: Iterable[Sums]) -> Sums:
    """Add the sums of several runs or videos. Lists may differ in length."""
    total: Sums = {}
    for one in sums:
        for name, value in one.items():
            if isinstance(value, list):
                known = total.setdefault(name, [])
                known += [0] * (len(value) - len(known))
                total[name] = [a + b for a, b in zip(known, value + [0] * (len(known) - len(value)), strict=True)]
            else:
                total[name] = total.get(name, 0) + value
    return total


@dataclass(frozen=True)
class Measure:
    """A measure that is a ratio of sums.

    Attributes:
        title: title of the column in the table, with the unit.
        above, below: functions (sums of `score`) -> numerator and denominator.
        is_share: whether the measure is a share, which is printed in %.
        decimals: number of decimals that are printed.
    """

    title: str
    above: Callable[[Mapping[str, Any]], Any]
    below: Callable[[Mapping[str, Any]], Any]
    is_share: bool = False
    decimals: int = 1


def _of(name: str) -> Callable[[Mapping[str, Any]], Any]:
    """A function (sums) -> the sum with this name as an array; 0 if it is missing."""
    return lambda sums: np.asarray(sums.get(name, 0.0), float)


MEASURES: dict[str, Measure] = {
    "error": Measure("error (world units)", _of("error"), _of("found"), decimals=3),
    "nearest": Measure("to the nearest future (world units)", _of("nearest"), _of("found"), decimals=3),
    "log_likelihood": Measure("log-likelihood (nats)", _of("gain"), _of("found"), decimals=2),
    "missing": Measure("missing (%)", lambda s: _of("asked")(s) - _of("found")(s), _of("asked"), True),
    "identity": Measure("identity kept (%)", _of("same"), _of("named"), True),
    "collisions": Measure(
        "collisions, F1 (%)",
        lambda s: 2 * _of("right")(s),
        lambda s: _of("collisions")(s) + _of("true_collisions")(s),
        True,
    ),
    "possible": Measure("possible collisions (%)", _of("possible"), _of("collisions"), True),
    "order": Measure("order right (%)", _of("ordered"), _of("orders"), True),
    "frames_off": Measure("off by (frames)", _of("frames_off"), _of("right")),
}
"""Columns of the table. "error" and "nearest" are mean distances of found objects, and "log_likelihood" is the mean over
objects and frames, relative to a held-out run of Bullet."""
