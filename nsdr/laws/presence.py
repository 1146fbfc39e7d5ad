"""Evidence against permanence and identity: objects that are not seen where they should be, and attributes that change."""

from collections.abc import Iterator
from functools import partial
from itertools import pairwise, takewhile

import numpy as np
from numpy.typing import NDArray

from nsdr.laws.breaks import MIN_EVIDENCE
from nsdr.laws.motion import SAME_FRAMES, Evidence, PiecewiseMotion
from nsdr.tracking.localization import outline
from nsdr.tracking.tracker import detected_attributes
from nsdr.tracking.visibility import in_image
from nsdr.types import VideoProposals, VideoTracks
from nsdr.world.camera import on_ground
from nsdr.world.vocabulary import differing_words

SEEN_MARGIN_PX, COVERED_SHARE = 8.0, 0.3
"""An object should be seen if its outline is at least this far inside the image (pixels of CLEVRER's) and nearer objects cover
a smaller share of its box."""
MAX_UNKNOWN_WORLD = 0.15
"""Largest standard deviation of the position of an object that should be seen (world units in CLEVRER)."""
MISSED_NATS = 2.0
"""Evidence of each frame in which an object should be seen but is not, or has another color, material or shape (nats)."""
SAME_PLACE_PX = 8.0
"""A proposal this near to the last position of an object shows the same object (pixels of CLEVRER's images)."""
SAME_PLACE_WORLD = 0.3
"""An object that appears this near to one that disappears takes its place (world units in CLEVRER)."""


def presence(motion: PiecewiseMotion, processed: NDArray[np.bool_]) -> list[Evidence]:
    """Find evidence against permanence, or against identity where one object takes the place of another.

    Args:
        motion: motion of the objects.
        processed: (F,) bool, whether each frame was processed.
    """
    return _replaced(motion, list(_permanence(motion, processed)))


def _permanence(motion: PiecewiseMotion, processed: NDArray[np.bool_]) -> Iterator[Evidence]:
    """Find evidence against permanence: frames without a detection in which an object should be seen."""
    states = motion.states
    for i in range(len(motion.stretches)):
        seen = np.flatnonzero(states.detected[i])
        gaps = [
            (0, int(seen[0])),
            *((int(a) + 1, int(b)) for a, b in pairwise(seen)),
            (int(seen[-1]) + 1, motion.states.n_frames),
        ]
        for start, end in gaps:
            # Frames count from where the object was seen until it may be at the border or behind another object.
            order = range(end - 1, -1, -1) if start == 0 else range(start, end)
            missed = list(takewhile(partial(_should_be_seen, motion, i), (f for f in order if processed[f])))
            nats = len(missed) * MISSED_NATS * states.spacing_frames
            if nats > MIN_EVIDENCE:
                first, last = (end, end) if start == 0 else (missed[0], missed[-1] + 1)
                yield Evidence("permanence", (i,), first, last, abs(missed[-1] - missed[0]) + 1, "frames", nats)


def _should_be_seen(motion: PiecewiseMotion, i: int, frame: int) -> bool:
    """Whether object i would be seen in a frame if its motion continued."""
    states, world, camera = motion.states, motion.states.world, motion.states.camera
    near = min(motion.stretches[i], key=lambda s: max(s.start - frame, frame - s.last))
    at = np.array([frame])
    place = near.position_at(at)[0]
    if near.position_variance(at, motion.noise)[0] > (MAX_UNKNOWN_WORLD * world.scales.size) ** 2:
        return False
    shape = world.vocabulary.shape(states.objects[i].shape)
    if not in_image(shape, on_ground(place[None], shape.height_world), np.zeros(1), camera)[0]:
        return False
    polygon = outline(shape, float(place[0]), float(place[1]), camera=camera)
    low, high, margin = polygon.min(0), polygon.max(0), SEEN_MARGIN_PX * world.scales.px
    if (low < margin).any() or (high > np.array([camera.width, camera.height]) - margin).any():
        return False
    covered = 0.0
    for j in range(len(motion.stretches)):
        if j == i or not states.present[j, frame]:
            continue
        if _takes_place(motion, i, j) or _takes_place(motion, j, i):
            continue
        x0, y0, x1, y1 = states.box_xyxy_px[j, frame]
        if y1 > high[1] - 2:  # object j is nearer to the camera
            width, height = min(x1, high[0]) - max(x0, low[0]), min(y1, high[1]) - max(y0, low[1])
            covered += max(width, 0.0) * max(height, 0.0) / float(np.prod(high - low))
    return covered < COVERED_SHARE


def _takes_place(motion: PiecewiseMotion, new: int, old: int) -> bool:
    """Whether the object `new` appears where the object `old` disappears."""
    first = motion.stretches[new][0]
    near = motion.at(old, first.start)
    shown = slice(first.start, first.start + SAME_FRAMES)
    if first.start == 0 or near is None or motion.states.detected[old, shown].any():
        return False
    at, near_enough = np.array([first.start]), SAME_PLACE_WORLD * motion.states.world.scales.size
    return bool(np.hypot(*(near.position_at(at) - first.position_at(at))[0]) < near_enough)


def _replaced(motion: PiecewiseMotion, found: list[Evidence]) -> list[Evidence]:
    """Replace evidence against permanence by evidence against identity where one object takes the place of another."""
    objects = motion.states.objects
    result, used = [], set()
    for new, one in enumerate(motion.stretches):
        start = one[0].start
        for old in range(len(objects)):
            if old != new and _takes_place(motion, new, old):
                both = [e for e in found if e.objects in ((old,), (new,)) and e.frame - SAME_FRAMES <= start <= e.end]
                if both:
                    words = differing_words(objects[old].name.split(), objects[new].name.split())
                    nats = sum(e.nats for e in both)
                    looks, end = (objects[old].name, objects[new].name), one[-1].last + 1
                    result.append(Evidence("identity", (old, new), start, end, words, "words", nats, looks))
                    used |= set(both)
    return result + [e for e in found if e not in used]


def renamed(
    found: list[Evidence], tracks: VideoTracks, proposals: VideoProposals, processed: NDArray[np.bool_]
) -> list[Evidence]:
    """Replace evidence against permanence by evidence against identity if the object is seen there with another attribute.

    If one object takes the place of another at rest, the tracker sees one object, some of whose detections have wrong
    attributes.

    Args:
        found: evidence against permanence and identity.
        tracks: tracks of the video.
        proposals: proposals from which the tracks were made.
        processed: (F,) bool, whether each frame was processed.
    """
    return [_renamed(e, tracks, proposals, processed) if e.law == "permanence" else e for e in found]


def _renamed(e: Evidence, tracks: VideoTracks, proposals: VideoProposals, processed: NDArray[np.bool_]) -> Evidence:
    """Apply `renamed` to evidence against permanence."""
    track = tracks.tracks[e.objects[0]]
    if e.frame == e.end:  # it appears
        beside, k = int(np.flatnonzero(processed[: e.frame])[-1]), 0
    else:
        beside, k = e.frame, int(np.searchsorted(track.frame_index, e.frame)) - 1
    near = np.linalg.norm(proposals.centroid_px - track.centroid_px[k], axis=1) < SAME_PLACE_PX * tracks.world.scales.px
    own, attributes = track.object.name, proposals.attribute[near & (proposals.frame_index == beside)].tolist()
    looks_like = [tracks.world.vocabulary.triple(a) for a in attributes]
    differing = [(differing_words(own.split(), words), " ".join(words)) for words in looks_like]
    n, other = max(differing, default=(0, ""))
    looks = (other, own) if e.frame == e.end else (own, other)
    return e._replace(law="identity", amount=n, unit="words", looks=looks) if n else e


def other_words(motion: PiecewiseMotion, tracks: VideoTracks, proposals: VideoProposals) -> Iterator[Evidence]:
    """Find evidence against identity: consecutive reliable detections of an object with other attributes than in most frames.

    The object changes in the first of these frames. If it has had the other attributes from its first frame on, it changes
    after the last of them.
    """
    triple = tracks.world.vocabulary.triple
    for t in tracks.tracks:
        own, found = t.object.name, detected_attributes(t, proposals)
        differing = np.array([differing_words(own.split(), triple(a)) if a >= 0 else 0 for a in found.tolist()])
        reliable = motion.states.reliable[t.object.id, t.frame_index]
        best: list[int] = []
        seen_before = had_own = False
        run: list[int] = []
        for k in np.flatnonzero(reliable | (differing == 0)).tolist():
            if differing[k] == 0:
                run, had_own = [], had_own or bool(reliable[k])
                continue
            run = [*run, k]
            if len(run) > len(best):
                best, seen_before = run, had_own
        nats = len(best) * MISSED_NATS * motion.states.spacing_frames
        if nats > MIN_EVIDENCE:
            values, counts = np.unique(found[best], return_counts=True)
            looks, last = (own, " ".join(triple(int(values[counts.argmax()])))), int(t.frame_index[best[-1]]) + 1
            first, end = int(t.frame_index[best[0]]), last
            if not seen_before:
                looks, first, end = looks[::-1], last, int(t.frame_index[-1]) + 1
            count = int(differing[best].max())
            yield Evidence("identity", (t.object.id,), first, end, count, "words", nats, looks)
