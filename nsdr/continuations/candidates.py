"""Sources of continuations: a video after the cut, baselines that see the frames before it, and runs of Bullet."""

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation
from scipy.optimize import linear_sum_assignment

from nsdr.continuations.score import Continuation, TrueFuture
from nsdr.dynamics.motion_states import extrapolate, states_from_tracks
from nsdr.dynamics.registry import load_backend
from nsdr.errors import DataError, VideoError
from nsdr.generate.physics.bullet import BulletConfig, Simulator
from nsdr.generate.physics.disturbed import bodies_of, disturbed, states_at
from nsdr.io.device import resolve_device
from nsdr.pipeline_config import check_weights
from nsdr.tracking.tracker import TrackerConfig, detected_attributes, track
from nsdr.types import Event, VideoProposals, VideoTracks
from nsdr.validation import FloatArray
from nsdr.world.vocabulary import differing_words

OTHER_WORD_WORLD = 0.1
"""Distance that is added for each differing word (color, material or shape) when tracks are matched to objects (world units in
CLEVRER)."""
BRIDGED_FRAMES = 12
"""Between two detections, an object counts as found within this many frames of either, because another object may hide it."""
MIN_KNOWN_SHARE = 0.5
"""If a smaller share of the known objects is found in the given frames, the video does not start with the given frames."""
BACKENDS = {"PropNet": "propnet", "fitted simulator": "physics"}
"""Baselines that are dynamics backends: name in the table -> name of the backend."""
BASELINES = ("last frame frozen", "constant velocity", *BACKENDS)
"""Names of all baselines, which predict the future from the given frames."""


def perceived(
    proposals: VideoProposals, tracks: VideoTracks, collisions: Sequence[Event], truth: TrueFuture
) -> Continuation:
    """Make the continuation that a video shows after the cut.

    Args:
        proposals: proposals in the frames of the video, up to the last frame of the truth or further.
        tracks: tracks made from the proposals.
        collisions: collisions in the video, with the ids of the tracks.
        truth: the true future.

    Raises:
        VideoError: the given frames do not show the objects of the truth.
    """
    cut, end = truth.cut, truth.cut + truth.location_world.shape[1]
    states = states_from_tracks(tracks)
    words = _words(proposals, tracks)
    given = [_most(row[:cut]) for row in words]
    ids = _ids(tracks, given, truth)
    known = truth.known
    found = [i for i in known if i in ids]
    if len(found) < MIN_KNOWN_SHARE * len(known):
        names = ", ".join(truth.objects[i].name for i in known if i not in ids)
        raise VideoError(f"the first {cut} frames do not show {names}, so they are not those of the truth's video")
    reach = np.ones((1, 2 * BRIDGED_FRAMES + 1), bool)
    seen = (binary_dilation(states.detected, reach) & states.present)[:, cut:end]
    location = _by_truth(np.where(seen[..., None], states.location_world[:, cut:end], np.nan), ids, truth)
    same = np.full(location.shape[:2], -1, np.int8)
    for i, t in ids.items():
        after = words[t, cut:end]
        same[i] = np.where(after < 0, -1, after == given[t])
    return Continuation(location, _renamed(collisions, ids), same)


def _words(proposals: VideoProposals, tracks: VideoTracks) -> NDArray[np.int64]:
    """(tracks, frames) int, attribute index of each single detection; -1 without a detection."""
    words = np.full((len(tracks.tracks), tracks.n_frames), -1)
    for row, t in zip(words, tracks.tracks, strict=True):
        row[t.frame_index] = detected_attributes(t, proposals)
    return words


def _most(words: NDArray[np.int64]) -> int:
    """The most frequent attribute index in a sequence; -1 if it has none."""
    values, counts = np.unique(words[words >= 0], return_counts=True)
    return int(values[counts.argmax()]) if len(values) else -1


def _ids(tracks: VideoTracks, words: Sequence[int], truth: TrueFuture) -> dict[int, int]:
    """Match tracks to the objects of the truth in the given frames.

    Args:
        tracks: tracks of a video or of its given frames.
        words: attribute index of each track in the given frames; -1 for a track without detections there.
        truth: the true future.

    Returns:
        The index of the track of each object that was found, by the id of the object. The median of their distances in the
        given frames is less than the width of the object.
    """
    vocabulary, other_word = truth.world.vocabulary, OTHER_WORD_WORLD * truth.world.scales.size
    cost = np.full((len(truth.objects), len(tracks.tracks)), np.inf)
    for k, t in enumerate(tracks.tracks):
        before = t.frame_index < truth.cut
        off = truth.given_world[:, t.frame_index[before]] - t.location_world[before]
        distance = np.linalg.norm(off, axis=-1)
        for i, o in enumerate(truth.objects):
            shared = distance[i][np.isfinite(distance[i])]
            if len(shared) and np.median(shared) < 2 * vocabulary.shape(o.shape).half_width_world:
                differing = differing_words(o.name.split(), vocabulary.triple(words[k]))
                cost[i, k] = np.median(shared) + other_word * differing
    finite = np.where(np.isfinite(cost), cost, 1e3)  # so that there is an assignment
    return {int(i): int(k) for i, k in zip(*linear_sum_assignment(finite), strict=True) if np.isfinite(cost[i, k])}


def _by_truth(location_world: FloatArray, ids: dict[int, int], truth: TrueFuture) -> FloatArray:
    """Positions of tracks in the order of the objects of the truth; NaN for objects without a track."""
    location = np.full(truth.location_world.shape, np.nan)
    for i, k in ids.items():
        location[i] = location_world[k]
    return location


def _renamed(collisions: Sequence[Event], ids: dict[int, int]) -> tuple[Event, ...]:
    """Collisions of tracks with the ids of the truth. Those of tracks without an object are left out."""
    of_track = {k: i for i, k in ids.items()}
    named = [e for e in collisions if all(k in of_track for k in e.objects)]
    return tuple(Event("collision", e.frame, tuple(sorted(of_track[k] for k in e.objects))) for e in named)


def baselines(
    proposals: VideoProposals, config: TrackerConfig, weights: Path, truth: TrueFuture, device: str
) -> dict[str, Continuation]:
    """Make the prediction of each of `BASELINES`, without backends whose weights are for another world.

    Args:
        proposals: proposals of the true video; only those in the given frames are read.
        config: thresholds of the tracker.
        weights: folder of the checkpoint of the backends.
        truth: the true future.
        device: device on which the networks of the backends run, as in `Pipeline.from_pretrained`.

    Raises:
        VideoError: no object is found in the given frames.
    """
    cut, frames = truth.cut, truth.location_world.shape[1]
    rows = int(np.searchsorted(proposals.frame_index, cut))
    names = ("frame_index", "attribute", "score", "centroid_px", "area_px", "box_xyxy_px", "masks")
    arrays: dict[str, Any] = {n: v[:rows] for n in names if (v := getattr(proposals, n)) is not None}
    processed = proposals.processed
    processed = None if processed is None else processed[processed < cut]
    given = replace(proposals, n_frames=cut, processed=processed, **arrays)
    tracks = track(given, replace(config, min_frames=min(config.min_frames, cut // 2)))
    if not tracks.tracks:
        raise VideoError(f"no objects found in the first {cut} frames of the truth; give more frames")
    states = states_from_tracks(tracks)
    ids = _ids(tracks, [_most(row) for row in _words(given, tracks)], truth)
    last = np.repeat(states.location_world[:, -1:], frames, axis=1)
    straight = extrapolate(states.location_world, frames)[:, -frames:]
    half_width = np.array([truth.world.vocabulary.shape(o.shape).half_width_world for o in states.objects])
    found = {
        BASELINES[0]: Continuation(_by_truth(last, ids, truth), ()),
        BASELINES[1]: Continuation(
            _by_truth(straight, ids, truth), _renamed(_meetings(straight, half_width, cut), ids)
        ),
    }
    for name, backend_name in BACKENDS.items():
        backend = _backend(weights, backend_name, device)
        try:
            check_weights(backend, states.world)
        except DataError:
            continue
        rollout = backend.explain(states).rollout(frames=cut + frames)
        location = _by_truth(rollout.location_world[:, cut:], ids, truth)
        found[name] = Continuation(location, _renamed(rollout.collisions, ids))
    return found


@lru_cache(maxsize=4)
def _backend(weights: Path, name: str, device: str) -> Any:
    """A dynamics backend on a device, loaded once per process."""
    backend: Any = load_backend(name, weights)
    return backend.to(str(resolve_device(device)))


def _meetings(location_world: FloatArray, half_width_world: FloatArray, cut: int) -> list[Event]:
    """Collisions of pairs in the first frame in which their centres are nearer than the sum of half their widths."""
    events = []
    for i, j in combinations(range(len(location_world)), 2):
        near = np.linalg.norm(location_world[i] - location_world[j], axis=-1)
        near = near < half_width_world[i] + half_width_world[j]
        if near.any():
            events.append(Event("collision", cut + int(near.argmax()), (i, j)))
    return events


def bullet_runs(
    document: Any, truth: TrueFuture, error_world: float, runs: int, physics: BulletConfig
) -> list[Continuation]:
    """Run Bullet several times from the states in the last given frame, each time with different random errors.

    Args:
        document: content of the truth file.
        truth: the true future.
        error_world: error of positions, as in `nsdr.generate.physics.disturbed.disturbed` (world units).
        runs: number of runs.
        physics: settings of the physics of the scene.
    """
    start, frames = truth.cut - 1, truth.location_world.shape[1]
    states, words = states_at(document, start), [(o.shape, o.material) for o in truth.objects]
    shapes, materials = zip(*words, strict=True)
    rng = np.random.default_rng([document["seed"], round(1e6 * error_world)])
    found = []
    with Simulator(physics, truth.world) as simulator:
        for _ in range(runs):
            motion = simulator.run(bodies_of(shapes, disturbed(states, error_world, rng), materials), frames + 1)
            contacts = tuple(Event("collision", c.frame + start, tuple(sorted(c.bodies))) for c in motion.contacts)
            found.append(Continuation(motion.location_world[:, 1:, :2], contacts))
    return found
