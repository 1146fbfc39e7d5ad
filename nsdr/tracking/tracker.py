"""Proposals of single frames -> tracks of objects through the video."""

import math
import warnings
from collections import defaultdict
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from nsdr.tracking.localization import ground_location
from nsdr.tracking.visibility import VisibilityConfig, cut_sides, hidden_sides
from nsdr.types import SceneObject, Track, VideoProposals, VideoTracks
from nsdr.validation import Count, NotNegative, PositiveCount, Settings, Share
from nsdr.world.camera import CLEVRER_CAMERA, Camera
from nsdr.world.vocabulary import SHAPES, attributes_of

__all__ = ["TrackerConfig", "track"]

MAX_SPACING_FRAMES = 8
"""Warned of when the processed frames are further apart (frames)."""
MIN_SAMPLES = 2
"""Processed frames in which an identity must be seen, however far apart they are."""
MAX_MISSED_SAMPLES = 1
"""Processed frames that a tracklet may miss where `TrackerConfig.max_gap_frames` would not even reach the next one."""
SWITCHED_WORDS = 2
"""Differing words of the attributes that show another object; a single wrong word is often a wrong label."""
NO_MATCH_COST = 1e3
"""Assignment cost of a forbidden pair (world units). It is finite, so that an assignment always exists; pairs that get it are
dropped afterwards."""


@dataclass(frozen=True)
class TrackerConfig(Settings):
    """How proposals become tracks.

    Frames are those of a video of 25 frames per second, all of them processed; where only some were processed, `track` counts
    each for those up to the next.

    Attributes:
        score: proposals with a score up to this are ignored (0-1; paper: 0.9).
        min_frames: an identity must be seen in more frames than this (paper: 10, with which wrong labels of other objects
            make more spurious ones). Set on scenes 0, 1, 3 and 5 of every 10 of `train`, like `late_share`, with the objects
            that `python benchmarks/objects.py` counts.
        min_late_frames: frames in which an identity must be seen if it enters late, at the image border.
        late_share: share of the frames from its first one to the video's end in which a late identity must be seen (0-1).
        late_end_frames: a late identity must be seen in one of this many last frames of the video.
        max_gap_frames: a tracklet ends when its last proposal is more than this many frames ago.
        gate_world: constant part of the largest distance between a proposal and a tracklet's predicted position (world units).
        gate_world_per_frame: growth of that distance with each frame since the tracklet's last proposal (world units per
            frame). Objects move by up to 0.1 per frame.
        mismatch_world: matching cost of each differing attribute word, as a distance (world units).
        switch_frames: a tracklet is cut where it goes over from one object to another: two words or more of the attributes
            change, for at least this many frames on both sides. Set on every 8th scene of `train`, whose missing and spurious
            objects `python benchmarks/collisions.py --every 8` counts.
        switch_share: share of the frames on each side that must have that side's attributes (0-1).
        velocity_memory: weight of a tracklet's previous velocity when a displacement updates it (0-1).
        duplicate_iou: boxes of two tracks coincide where their intersection over union exceeds this (0-1).
        duplicate_share: a track is dropped as a duplicate when it coincides with a longer one in at least this share of its
            frames (0-1).
        visibility: when a side of a box is cut or hidden.
    """

    score: Share = 0.9
    min_frames: Count = 12
    min_late_frames: Count = 1
    late_share: Share = 0.6
    late_end_frames: Count = 2
    max_gap_frames: PositiveCount = 8
    gate_world: NotNegative = 0.25
    gate_world_per_frame: NotNegative = 0.1
    mismatch_world: NotNegative = 0.12
    switch_frames: PositiveCount = 6
    switch_share: Share = 0.8
    velocity_memory: Share = 0.6
    duplicate_iou: Share = 0.5
    duplicate_share: Share = 0.9
    visibility: VisibilityConfig = field(default_factory=VisibilityConfig)


@dataclass
class _Tracklet:
    """Proposals of consecutive detections that are linked to each other.

    Attributes:
        rows: row numbers in the `VideoProposals`, one per frame.
        frame: frame index of the last row.
        position: (2,) ground position in that frame (world units).
        velocity: (2,) smoothed displacement per frame (world units per frame).
    """

    rows: list[int] = field(default_factory=list)
    frame: int = -1
    position: NDArray[Any] = field(default_factory=lambda: np.zeros(2))
    velocity: NDArray[Any] = field(default_factory=lambda: np.zeros(2))

    def add(self, row: int, frame: int, position: NDArray[Any], memory: float) -> None:
        if self.rows:
            step = (position - self.position) / (frame - self.frame)
            self.velocity = step if len(self.rows) == 1 else memory * self.velocity + (1 - memory) * step
        self.rows.append(row)
        self.frame, self.position = frame, position


def track(
    proposals: VideoProposals, config: TrackerConfig | None = None, camera: Camera = CLEVRER_CAMERA
) -> VideoTracks:
    """Track the objects of a video.

    Proposals are linked from frame to frame by predicted position and attributes (optimal assignment). The linked tracklets
    vote on their attributes. Tracklets of the same attribute triple are the same object, however long it was occluded or out
    of the image, because a triple never occurs twice in a video.

    Returns:
        Tracks in the order of their first frames; none when nothing was detected often enough.

    Differs from the paper: the paper matches by the attribute label alone and keeps identities of more than ten frames. Here,
    a tracklet outvotes wrong labels of single frames, and objects that enter in the last frames are kept.
    """
    spacing = _spacing_frames(proposals)
    c = _with_spacing(config or TrackerConfig(), spacing)
    kept = np.flatnonzero(proposals.score > c.score)
    positions = _positions(proposals, kept, c, camera)
    linked = [tracklet.rows for tracklet in _link(proposals, kept, positions, c)]
    by_identity = _identities(
        proposals, [part for rows in linked for part in _cut_at_switches(proposals, rows, c, spacing)]
    )
    tracks = []
    for attribute, rows in by_identity.items():
        seen_often = len(rows) * spacing > c.min_frames and len(rows) >= min(MIN_SAMPLES, spacing)
        if seen_often or _enters_late(proposals, rows, c, spacing):
            tracks.append(_track(proposals, attribute, rows, positions))
    tracks = [t for t in tracks if not any(_is_duplicate(t, o, c) for o in tracks)]
    tracks.sort(key=lambda t: (int(t.frame_index[0]), t.object.name))
    renamed = [
        Track(SceneObject(i, *_words(t)), t.frame_index, t.location_world, t.centroid_px, t.box_xyxy_px, t.score)
        for i, t in enumerate(tracks)
    ]
    return VideoTracks(proposals.n_frames, tuple(renamed), camera)


def _spacing_frames(proposals: VideoProposals) -> float:
    """Frames from one processed frame to the next (median)."""
    if proposals.processed is None or len(proposals.processed) < 2:
        return 1.0
    return float(np.median(np.diff(proposals.processed)))


def _with_spacing(c: TrackerConfig, spacing: float) -> TrackerConfig:
    """The thresholds for processed frames that are `spacing` frames apart; those for a spacing of 1 are `c` itself."""
    if spacing > MAX_SPACING_FRAMES:
        warnings.warn(
            f"one frame in {spacing:g} (of 25 per second) was processed: above {MAX_SPACING_FRAMES}, collisions are missed and "
            "misplaced; lower --stride, or use a video with more frames per second",
            stacklevel=3,
        )
    return replace(
        c,
        late_end_frames=max(c.late_end_frames, math.ceil(spacing) + 1),
        max_gap_frames=max(c.max_gap_frames, math.ceil(spacing * (MAX_MISSED_SAMPLES + 1))),
        # Positions are predicted as much worse as the gate is wider; words are read as well as ever.
        mismatch_world=c.mismatch_world * _gate_world(c, spacing) / _gate_world(c, 1),
        velocity_memory=c.velocity_memory**spacing,
    )


def _gate_world(c: TrackerConfig, gap: float) -> float:
    return c.gate_world + gap * c.gate_world_per_frame


def _enters_late(proposals: VideoProposals, rows: list[int], c: TrackerConfig, spacing: float) -> bool:
    """Whether the rows show an object that entered the image too late to be seen in `min_frames` frames."""
    frames = proposals.frame_index[rows]
    at_border = bool(cut_sides(proposals.box_xyxy_px[rows[0]], c.visibility).any())
    frames_left = proposals.n_frames - int(frames[0])
    return (
        at_border
        and len(rows) >= c.min_late_frames
        and int(frames[-1]) >= proposals.n_frames - c.late_end_frames
        and frames_left <= c.min_frames + c.max_gap_frames
        and len(rows) * spacing >= c.late_share * frames_left
    )


def _is_duplicate(t: Track, other: Track, c: TrackerConfig) -> bool:
    """Whether a track is the same object as a longer one: two objects cannot share a position all the time."""
    if len(t.frame_index) >= len(other.frame_index):
        return False
    other_box = np.stack([np.interp(t.frame_index, other.frame_index, side) for side in other.box_xyxy_px.T], 1)
    low, high = np.maximum(t.box_xyxy_px, other_box)[:, :2], np.minimum(t.box_xyxy_px, other_box)[:, 2:]
    shared = np.prod(np.clip(high - low, 0, None), axis=1)
    area = [np.prod(box[:, 2:] - box[:, :2], axis=1) for box in (t.box_xyxy_px, other_box)]
    overlap = shared / np.maximum(area[0] + area[1] - shared, 1)
    return bool((overlap > c.duplicate_iou).mean() >= c.duplicate_share)


def _words(t: Track) -> tuple[str, str, str]:
    return t.object.color, t.object.material, t.object.shape


def _positions(proposals: VideoProposals, kept: NDArray[Any], c: TrackerConfig, camera: Camera) -> NDArray[Any]:
    """(N, 2) ground positions of all rows (world units); NaN for rows that are not in `kept`."""
    positions = np.full((len(proposals), 2), np.nan)
    if not len(kept):
        return positions
    frames = proposals.frame_index[kept]
    starts = np.flatnonzero(np.diff(frames, prepend=-1))
    hidden = np.concatenate(
        [hidden_sides(proposals.box_xyxy_px[rows], c.visibility) for rows in np.split(kept, starts[1:])]
    )
    shapes = np.array([SHAPES.index(attributes_of(int(a))[2]) for a in proposals.attribute[kept]])
    for index, shape in enumerate(SHAPES):
        rows = kept[shapes == index]
        seen = proposals.centroid_px[rows], proposals.box_xyxy_px[rows], hidden[shapes == index]
        positions[rows] = ground_location(shape, *seen, camera)
    return positions


def _link(proposals: VideoProposals, kept: NDArray[Any], positions: NDArray[Any], c: TrackerConfig) -> list[_Tracklet]:
    """Link the kept rows frame by frame; returns all tracklets."""
    rows_by_frame = defaultdict(list)
    for row in kept.tolist():
        rows_by_frame[int(proposals.frame_index[row])].append(row)
    done: list[_Tracklet] = []
    active: list[_Tracklet] = []
    for frame, rows in rows_by_frame.items():
        done += [p for p in active if frame - p.frame > c.max_gap_frames]
        active = [p for p in active if frame - p.frame <= c.max_gap_frames]
        cost = np.full((len(rows), len(active)), np.inf)
        for j, tracklet in enumerate(active):
            gap = frame - tracklet.frame
            words = attributes_of(int(proposals.attribute[tracklet.rows[-1]]))
            for i, row in enumerate(rows):
                distance = float(np.hypot(*(positions[row] - tracklet.position - gap * tracklet.velocity)))
                if distance > _gate_world(c, gap):
                    continue
                other = attributes_of(int(proposals.attribute[row]))
                mismatches = sum(a != b for a, b in zip(words, other, strict=True))
                cost[i, j] = distance + c.mismatch_world * mismatches
        chosen_rows, chosen_tracklets = linear_sum_assignment(np.minimum(cost, NO_MATCH_COST))
        matched = set()
        for i, j in zip(chosen_rows.tolist(), chosen_tracklets.tolist(), strict=True):
            if np.isfinite(cost[i, j]):
                active[j].add(rows[i], frame, positions[rows[i]], c.velocity_memory)
                matched.add(i)
        for i in set(range(len(rows))) - matched:
            tracklet = _Tracklet()
            tracklet.add(rows[i], frame, positions[rows[i]], c.velocity_memory)
            active.append(tracklet)
    return done + active


def _cut_at_switches(proposals: VideoProposals, rows: list[int], c: TrackerConfig, spacing: float) -> list[list[int]]:
    """A tracklet's rows, cut where it goes over from one object to another, as where one hides another at the border."""
    attributes = proposals.attribute[rows]
    values, counts = np.unique(attributes, return_counts=True)
    enough = math.ceil(c.switch_frames / spacing)
    often = values[counts >= enough].tolist()
    best, cut = 0, 0
    for before in often:
        for after in often:
            words = zip(attributes_of(before), attributes_of(after), strict=True)
            if sum(a != b for a, b in words) < SWITCHED_WORDS:
                continue
            left, right = np.cumsum(attributes == before), np.cumsum((attributes == after)[::-1])[::-1]
            k = np.arange(1, len(rows))
            is_side = np.minimum(left[:-1] / k, right[1:] / k[::-1]) >= c.switch_share
            is_side &= np.minimum(left[:-1], right[1:]) >= enough
            total = np.where(is_side, left[:-1] + right[1:], 0)
            if len(total) and total.max() > best:
                best, cut = int(total.max()), int(total.argmax()) + 1
    if not cut:
        return [rows]
    return [part for side in (rows[:cut], rows[cut:]) for part in _cut_at_switches(proposals, side, c, spacing)]


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


def _track(proposals: VideoProposals, attribute: int, rows: list[int], positions: NDArray[Any]) -> Track:
    return Track(
        SceneObject(0, *attributes_of(attribute)),
        proposals.frame_index[rows],
        positions[rows],
        proposals.centroid_px[rows],
        proposals.box_xyxy_px[rows],
        proposals.score[rows],
    )
