"""Proposals of single frames -> tracks of objects through the video; and tracks from annotations, as a perfect tracker's."""

import math
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from nsdr.io.worlds import world_in
from nsdr.tracking.localization import ground_location, turned_location
from nsdr.tracking.visibility import cut_sides, hidden_sides
from nsdr.types import SceneObject, Track, VideoProposals, VideoTracks
from nsdr.validation import BoolArray, Count, IntArray, Settings, Share
from nsdr.world.shapes import surface_points
from nsdr.world.vocabulary import differing_words
from nsdr.world.world import Scales, World

PROPOSAL_SCORE = 0.9
"""The paper's threshold for proposals: those with a score up to this are ignored (0-1)."""
GATE_WORLD, GATE_WORLD_PER_FRAME = 0.25, 0.1
"""Largest distance between a proposal and a tracklet's predicted position, and its growth with each frame since the
tracklet's last proposal (world units, world units per frame). CLEVRER's objects move by up to 0.1 per frame. In other worlds
these and other distances grow with `World.scales`, as numbers of frames do with the frame rate."""
MISMATCH_WORLD = 0.12
"""Matching cost of each differing attribute word, as a distance (world units)."""
MAX_GAP_FRAMES = 8
"""A tracklet ends when its last proposal is more than this many frames ago."""
MAX_MISSED_SAMPLES = 1
"""Processed frames that a tracklet may miss where `MAX_GAP_FRAMES` would not even reach the next one."""
VELOCITY_MEMORY = 0.6
"""Weight (0-1) of a tracklet's previous velocity when a displacement updates it."""
NO_MATCH_COST = 1e3
"""Assignment cost of a forbidden pair (world units). It is finite, so that an assignment always exists; pairs that get it are
dropped afterwards."""
SWITCHED_WORDS, SWITCH_FRAMES, SWITCH_SHARE = 2, 6, 0.8
"""A tracklet is cut where it goes over from one object to another: so many words of the attributes change (a single one is
often a wrong label) for so many frames on both sides, of which this share has that side's attributes. Set on every 8th scene
of `train`, whose missing and spurious objects `python -m benchmarks.collisions --every 8` counts."""
LATE_SHARE = 0.6
"""An identity that enters late must be seen in this share of the frames from its first one to the video's end. Set like
`TrackerConfig.min_frames`."""
DUPLICATE_WORLD, DUPLICATE_SHARE = 0.25, 0.33
"""A track is dropped that is nearer than this to a longer one, or to an equally long and surer one, in this share of its
frames: centres of two of CLEVRER's objects are at least 0.4 apart (world units). Set on `train`, whose missing and spurious
objects `python -m benchmarks.objects` counts: 51 and 9 of 42,745. Smaller values keep more spurious ones, larger ones drop
objects."""
SAME_IOU = 0.5
"""Boxes of two consecutive frames with at least this intersection over union can belong to one object however far apart its
positions on the ground are: near the border and far away, positions have larger errors than objects move."""
MIN_SAMPLES = 2
"""Processed frames in which an identity must be seen, however far apart they are."""
LATE_DETECTIONS = 4
"""A cube or cylinder that was detected n times, at the end of the video, is another kind of object with a probability of
about 0.5 to the power of n, for n up to this value. In the scenes of `train`, these were 5 of 9 objects with one detection,
2 of 9 with two, 2 of 6 with three and none of 6 with four (`python -m benchmarks.objects`), but none of 90 spheres; in
`validation`, 1 of 23 spheres and 2 of 4 others."""
DOUBTFUL_SPACING_FRAMES = 8
"""Processed frames that are further apart than this are noted (frames)."""


@dataclass(frozen=True)
class TrackerConfig(Settings):
    """Which proposals and identities count.

    Attributes:
        score: proposals with a score up to this are ignored (0-1). The default is the paper's.
        min_frames: an identity must be seen in more frames than this (paper: 10, with which wrong labels of other objects
            make more spurious ones). Set on scenes 0, 1, 3 and 5 of every 10 of `train` with the objects that
            `python -m benchmarks.objects` counts. Frames are those of a video of 25 frames per second; where only some were
            processed, each counts for those up to the next.
    """

    score: Share = PROPOSAL_SCORE
    min_frames: Count = 12


@dataclass
class _Tracklet:
    """Proposals of consecutive detections that are linked to each other.

    Attributes:
        rows: row numbers in the `VideoProposals`, one per frame.
        frame: frame index of the last row.
        position: (2,) ground position in that frame (world units).
        velocity: (2,) smoothed displacement per frame (world units per frame).
    """

    rows: list[int]
    frame: int
    position: NDArray[Any]
    velocity: NDArray[Any] = field(default_factory=lambda: np.zeros(2))

    def add(self, row: int, frame: int, position: NDArray[Any], memory: float) -> None:
        step = (position - self.position) / (frame - self.frame)
        self.velocity = step if len(self.rows) == 1 else memory * self.velocity + (1 - memory) * step
        self.rows.append(row)
        self.frame, self.position = frame, position


def track(proposals: VideoProposals, config: TrackerConfig | None = None) -> VideoTracks:
    """Track the objects of a video.

    Proposals are linked from frame to frame by predicted position and attributes (optimal assignment). The linked tracklets
    vote on their attributes. Tracklets of the same attribute triple are the same object, however long it was occluded or out
    of the image, because a triple never occurs twice in a video.

    Returns:
        Tracks in the order of their first frames; none when nothing was detected often enough.

    Differs from the paper: the paper matches by the attribute label alone and keeps identities of more than ten frames. Here,
    a tracklet outvotes wrong labels of single frames, and objects that enter in the last frames are kept.
    """
    c, processed, world = config or TrackerConfig(), proposals.processed, proposals.world
    min_frames = c.min_frames * world.scales.rate
    spacing = 1.0 if processed is None or len(processed) < 2 else float(np.median(np.diff(processed)))
    notes = [*proposals.notes]
    doubtful = DOUBTFUL_SPACING_FRAMES * world.scales.rate
    if spacing > doubtful:
        notes.append(
            f"one frame in {spacing:g} (of {world.timeline.fps} per second) was processed: above {doubtful:g}, collisions are "
            "missed and misplaced; lower the stride (`--set stride=N`), or use a video with more frames per second"
        )
    kept = np.flatnonzero(proposals.score > c.score)
    hidden = hidden_rows(proposals, kept)
    positions = ground_positions(proposals, kept, hidden)
    kept = kept[np.isfinite(positions[kept]).all(1)]  # nothing stands above the horizon
    linked = [tracklet.rows for tracklet in _link(proposals, kept, positions, spacing)]
    parts = [part for rows in linked for part in _cut_at_switches(proposals, rows, spacing)]
    tracks = []
    for attribute, rows in _identities(proposals, parts).items():
        seen_often = len(rows) * spacing > min_frames and len(rows) >= min(MIN_SAMPLES, spacing)
        if seen_often or _enters_late(proposals, rows, min_frames, spacing):
            tracks.append(
                track_of(SceneObject(0, *world.vocabulary.triple(attribute)), proposals, rows, positions, hidden)
            )
    tracks.sort(key=lambda t: (len(t.frame_index), float(t.score.sum())), reverse=True)
    near = DUPLICATE_WORLD * world.scales.size
    tracks = [t for k, t in enumerate(tracks) if not any(_share_place(t, better, near) for better in tracks[:k])]
    tracks.sort(key=lambda t: (int(t.frame_index[0]), t.object.name))
    numbered = [replace(t, object=replace(t.object, id=i)) for i, t in enumerate(tracks)]
    return VideoTracks(proposals.n_frames, tuple(numbered), world, tuple(notes))


def _iou(boxes: NDArray[Any], others: NDArray[Any]) -> NDArray[Any]:
    """Intersection over union (n, m) of boxes (n, 4) with others (m, 4)."""
    low, high = np.maximum(boxes[:, None, :2], others[:, :2]), np.minimum(boxes[:, None, 2:], others[:, 2:])
    shared = np.prod(np.clip(high - low, 0, None), axis=2)
    area, other_area = (np.prod(b[:, 2:] - b[:, :2], axis=1) for b in (boxes, others))
    return shared / np.maximum(area[:, None] + other_area - shared, 1)


def _gate_world(gap: Any, scales: Scales) -> Any:
    return GATE_WORLD * scales.size + gap * (GATE_WORLD_PER_FRAME * scales.frame)


def _max_gap_frames(spacing: float, scales: Scales) -> float:
    return max(MAX_GAP_FRAMES * scales.rate, math.ceil(spacing * (MAX_MISSED_SAMPLES + 1)))


def _enters_late(proposals: VideoProposals, rows: list[int], min_frames: float, spacing: float) -> bool:
    """Whether the rows show an object that entered at the border too late for `min_frames` frames and has not left."""
    frames = proposals.frame_index[rows]
    frames_left = proposals.n_frames - int(frames[0])
    return (
        bool(cut_sides(proposals.box_xyxy_px[rows], proposals.world.camera).any())
        and int(frames[-1]) >= proposals.n_frames - math.ceil(spacing) - 1
        and frames_left <= min_frames + _max_gap_frames(spacing, proposals.world.scales)
        and len(rows) * spacing >= LATE_SHARE * frames_left
    )


def _share_place(t: Track, other: Track, near_world: float) -> bool:
    """Whether a track is the same object as one of at least as many detections: two objects cannot share a place."""
    frames, known = t.frame_index, other.frame_index
    place = [np.interp(frames, known, axis, left=np.nan, right=np.nan) for axis in other.location_world.T]
    near = np.hypot(*(t.location_world.T - place)) < near_world
    return bool(near.mean() >= DUPLICATE_SHARE)


def track_of(
    scene_object: SceneObject,
    proposals: VideoProposals,
    rows: Sequence[int] | IntArray,
    positions: NDArray[Any],
    hidden: BoolArray,
) -> Track:
    """The track of an object that is seen in these rows of the proposals; `positions` (N, 2) and `hidden` (N, 4) are those of
    all rows."""
    frames, location, world = proposals.frame_index[rows], positions[rows], proposals.world
    centroid, box, score = (getattr(proposals, name)[rows] for name in ("centroid_px", "box_xyxy_px", "score"))
    shape = world.vocabulary.shape(scene_object.shape)
    if not shape.is_square:
        turned = turned_location(shape, frames, centroid, box, hidden[rows], world.camera)
        location = np.where(np.isfinite(turned), turned, location)
    return Track(scene_object, frames, location, centroid, box, score)


def hidden_rows(proposals: VideoProposals, kept: NDArray[Any]) -> BoolArray:
    """(N, 4) which sides are hidden of the rows in `kept`, see `hidden_sides`."""
    hidden = np.zeros((len(proposals), 4), bool)
    starts = np.flatnonzero(np.diff(proposals.frame_index[kept], prepend=-1))
    for rows in np.split(kept, starts[1:]):
        hidden[rows] = hidden_sides(proposals.box_xyxy_px[rows], proposals.world.camera)
    return hidden


def ground_positions(proposals: VideoProposals, kept: NDArray[Any], hidden: BoolArray) -> NDArray[Any]:
    """(N, 2) ground positions of all rows (world units); NaN above the horizon, and for rows that are not in `kept`."""
    positions = np.full((len(proposals), 2), np.nan)
    shapes = proposals.world.vocabulary.shapes
    index = proposals.attribute[kept] % len(shapes)
    for number, shape in enumerate(shapes):
        rows = kept[index == number]
        seen = proposals.centroid_px[rows], proposals.box_xyxy_px[rows], hidden[rows]
        positions[rows] = ground_location(shape, *seen, proposals.world.camera)
    return positions


def _link(proposals: VideoProposals, kept: NDArray[Any], positions: NDArray[Any], spacing: float) -> list[_Tracklet]:
    """Link the kept rows frame by frame; returns all tracklets."""
    scales = proposals.world.scales
    max_gap, memory = _max_gap_frames(spacing, scales), VELOCITY_MEMORY**spacing
    # Positions are predicted as much worse as the gate is wider; words are read as well as ever.
    mismatch_world = MISMATCH_WORLD * scales.size * _gate_world(spacing, scales) / _gate_world(1, scales)
    words = np.array(proposals.world.vocabulary.triples)[proposals.attribute]
    rows_by_frame = defaultdict(list)
    for row in kept.tolist():
        rows_by_frame[int(proposals.frame_index[row])].append(row)
    done: list[_Tracklet] = []
    active: list[_Tracklet] = []
    for frame, rows in rows_by_frame.items():
        done += [p for p in active if frame - p.frame > max_gap]
        active = [p for p in active if frame - p.frame <= max_gap]
        gap = np.array([frame - p.frame for p in active], int)
        last = np.array([p.rows[-1] for p in active], int)
        predicted = np.array([p.position + n * p.velocity for p, n in zip(active, gap, strict=True)]).reshape(-1, 2)
        distance = np.hypot(*np.moveaxis(positions[rows][:, None] - predicted, 2, 0))
        overlaps = (gap == 1) & (_iou(proposals.box_xyxy_px[rows], proposals.box_xyxy_px[last]) >= SAME_IOU)
        may_be_same = (distance <= _gate_world(gap, scales)) | (overlaps & np.isfinite(distance))
        differing = (words[rows][:, None] != words[last]).sum(2)
        cost = np.minimum(distance, _gate_world(gap, scales)) + mismatch_world * differing
        cost[~may_be_same] = NO_MATCH_COST
        chosen_rows, chosen_tracklets = linear_sum_assignment(cost)
        matched = set()
        for i, j in zip(chosen_rows.tolist(), chosen_tracklets.tolist(), strict=True):
            if may_be_same[i, j]:
                active[j].add(rows[i], frame, positions[rows[i]], memory)
                matched.add(i)
        for i in set(range(len(rows))) - matched:
            active.append(_Tracklet([rows[i]], frame, positions[rows[i]]))
    return done + active


def _cut_at_switches(proposals: VideoProposals, rows: list[int], spacing: float) -> list[list[int]]:
    """A tracklet's rows, cut where it goes over from one object to another, as where one hides another at the border."""
    attributes, triples = proposals.attribute[rows], proposals.world.vocabulary.triples
    values, counts = np.unique(attributes, return_counts=True)
    enough = math.ceil(SWITCH_FRAMES * proposals.world.scales.rate / spacing)
    often = values[counts >= enough].tolist()
    best, cut = 0, 0
    for before in often:
        for after in often:
            if differing_words(triples[before], triples[after]) < SWITCHED_WORDS:
                continue
            left, right = np.cumsum(attributes == before), np.cumsum((attributes == after)[::-1])[::-1]
            k = np.arange(1, len(rows))
            is_side = np.minimum(left[:-1] / k, right[1:] / k[::-1]) >= SWITCH_SHARE
            is_side &= np.minimum(left[:-1], right[1:]) >= enough
            total = np.where(is_side, left[:-1] + right[1:], 0)
            if len(total) and total.max() > best:
                best, cut = int(total.max()), int(total.argmax()) + 1
    if not cut:
        return [rows]
    return [part for side in (rows[:cut], rows[cut:]) for part in _cut_at_switches(proposals, side, spacing)]


def _identities(proposals: VideoProposals, tracklets: list[list[int]]) -> dict[int, list[int]]:
    """Rows of each attribute index, one per frame, by a vote in each tracklet.

    Where two tracklets of the same triple have a row in the same frame, the longer one's is used.
    """
    by_identity: dict[int, dict[int, int]] = defaultdict(dict)
    for tracklet in sorted(tracklets, key=len, reverse=True):
        votes: dict[int, float] = defaultdict(float)
        for row in tracklet:
            # Objects cut by the image border are often mislabelled, so votes are weighted by visible area.
            votes[int(proposals.attribute[row])] += float(proposals.score[row]) * int(proposals.area_px[row])
        identity = max(votes, key=lambda a: votes[a])
        for row in tracklet:
            by_identity[identity].setdefault(int(proposals.frame_index[row]), row)
    return {identity: [rows[f] for f in sorted(rows)] for identity, rows in by_identity.items()}


def rows_of(found: Track, proposals: VideoProposals) -> NDArray[np.int64]:
    """(n,) row that each detection of a track has among the proposals, by frame and box; -1 where they have none there."""
    rows, seen = (zip(x.frame_index.tolist(), x.box_xyxy_px.tolist(), strict=True) for x in (proposals, found))
    known = {(frame, *box): row for row, (frame, box) in enumerate(rows)}
    return np.array([known.get((frame, *box), -1) for frame, box in seen])


def detected_attributes(found: Track, proposals: VideoProposals) -> NDArray[np.int64]:
    """(n,) attribute index that each detection of a track has by itself; -1 where the proposals have none there."""
    return np.append(proposals.attribute, -1)[rows_of(found, proposals)]


def existence(tracks: VideoTracks) -> NDArray[np.float64]:
    """Probability that each object (n,) exists: 1 except for boxes and cylinders with few detections at the video's end."""
    shape_of = tracks.world.vocabulary.shape
    last = max((int(t.frame_index[-1]) for t in tracks.tracks), default=0)
    found = np.ones(len(tracks.tracks))
    for i, t in enumerate(tracks.tracks):
        n, is_late = len(t.frame_index), int(t.frame_index[-1]) == last and t.frame_index[0] > 0
        if is_late and n <= LATE_DETECTIONS and shape_of(t.object.shape).solid != "sphere":
            found[i] -= 0.5**n
    return found


def tracks_from_annotation(annotation: Mapping[str, Any], world: World | None = None) -> VideoTracks:
    """True positions of all objects in the frames where they are in view, with the boxes of their outlines and score 1.

    Objects that are never in view are left out.

    Args:
        annotation: validated content of an annotation file: its `object_property` and `motion_trajectory`.
        world: the world that the video is of; None for the one that the annotation says, or CLEVRER's.
    """
    world = world or world_in(annotation)
    camera = world.camera
    size = np.array([camera.width, camera.height])
    tracks: list[Track] = []
    frames = annotation["motion_trajectory"]
    for properties in sorted(annotation["object_property"], key=lambda p: int(p["object_id"])):
        words = (properties["color"], properties["material"], properties["shape"])
        seen, positions, boxes = [], [], []
        for f, frame in enumerate(frames):
            row = next((o for o in frame["objects"] if o["object_id"] == properties["object_id"]), None)
            if row is None or not row["inside_camera_view"]:
                continue
            points = surface_points(world.vocabulary.shape(words[2]), row["orientation"][2])
            outline = camera.pixels(points + np.array(row["location"]))
            low, high = np.clip(np.floor(outline.min(0)), 0, size), np.clip(np.ceil(outline.max(0)), 0, size)
            if np.isfinite(outline).all() and (high > low).all():
                seen.append(f)
                positions.append(row["location"][:2])
                boxes.append([*low, *high])
        if seen:
            box = np.array(boxes, int)
            centre = (box[:, :2] + box[:, 2:]) / 2
            scene_object = SceneObject(len(tracks), *words)
            location = np.array(positions, float)
            tracks.append(Track(scene_object, np.array(seen), location, centre, box, np.ones(len(seen))))
    return VideoTracks(len(frames), tuple(tracks), world)
