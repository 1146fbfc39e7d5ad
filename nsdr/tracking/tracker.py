"""Proposals of single frames -> objects followed through the video."""

from collections import defaultdict
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from nsdr.tracking.localization import ground_location
from nsdr.tracking.visibility import VisibilityConfig, hidden_sides
from nsdr.types import SceneObject, Track, VideoProposals, VideoTracks
from nsdr.world.camera import HEIGHT_PX, WIDTH_PX
from nsdr.world.vocabulary import SHAPES, attributes_of

__all__ = ["TrackerConfig", "track"]


@dataclass(frozen=True)
class TrackerConfig:
    """How proposals become tracks.

    Attributes:
        score: proposals must exceed it (paper: 0.9).
        min_frames: an identity must be seen in more frames than this (paper: 10).
        min_late_frames: enough for an identity that enters at the image's border and is seen until the video's end.
        max_gap_frames: a tracklet of track waits this long for its next proposal.
        reach_world: largest distance from the expected position, and
        reach_world_per_frame: its growth for every frame in between (objects move up to 0.1 a frame).
        border_px: outlines this close to the image's border may be cut by it.
        shadow_overlap: a track whose boxes overlap those of a longer one so much (intersection over union) in
        shadow_share: of its frames is the same object under another name.
        mismatch_world: each differing attribute word counts as this much distance.
    """

    score: float = 0.9
    min_frames: int = 10
    min_late_frames: int = 1
    max_gap_frames: int = 8
    reach_world: float = 0.25
    reach_world_per_frame: float = 0.1
    mismatch_world: float = 0.12
    border_px: int = 6
    shadow_overlap: float = 0.5
    shadow_share: float = 0.9
    visibility: VisibilityConfig = field(default_factory=VisibilityConfig)


@dataclass
class _Tracklet:
    """Proposals that surely belong together: row numbers, with the last position and velocity a frame."""

    rows: list[int] = field(default_factory=list)
    frame: int = -1
    position: NDArray[Any] = field(default_factory=lambda: np.zeros(2))
    velocity: NDArray[Any] = field(default_factory=lambda: np.zeros(2))

    def add(self, row: int, frame: int, position: NDArray[Any]) -> None:
        if self.rows:
            step = (position - self.position) / (frame - self.frame)
            self.velocity = step if len(self.rows) == 1 else 0.6 * self.velocity + 0.4 * step
        self.rows.append(row)
        self.frame, self.position = frame, position


def track(proposals: VideoProposals, config: TrackerConfig | None = None) -> VideoTracks:
    """Follow the objects of a video.

    Proposals are linked from frame to frame by expected position and attributes (optimal assignment), the linked tracklets
    vote on their attributes, and tracklets of one attribute triple are one object (a triple never occurs twice in a
    video), however long it was hidden or out of the image.

    Returns:
        Tracks in the order of first sight; none when nothing was detected often enough.

    Differs from the paper: the paper matches by the attribute label alone and keeps identities of more than ten frames; here
    wrong labels of single frames are outvoted by their tracklet, and objects that enter in the last frames are kept.
    """
    c = config or TrackerConfig()
    kept = np.flatnonzero(proposals.score > c.score)
    positions = _positions(proposals, kept, c)
    tracklets = _link(proposals, kept, positions, c)
    by_identity = _identities(proposals, tracklets)
    tracks = []
    for attribute, rows in by_identity.items():
        if len(rows) > c.min_frames or _enters_late(proposals, rows, c):
            tracks.append(_track(proposals, attribute, rows, positions))
    tracks = [t for t in tracks if not any(_shadows(t, o, c) for o in tracks)]
    tracks.sort(key=lambda t: (int(t.frame_index[0]), t.object.name))
    renamed = [
        Track(SceneObject(i, *_words(t)), t.frame_index, t.location_world, t.centroid_px, t.box_xyxy_px, t.score)
        for i, t in enumerate(tracks)
    ]
    return VideoTracks(proposals.n_frames, tuple(renamed))


def _enters_late(proposals: VideoProposals, rows: list[int], c: TrackerConfig) -> bool:
    """Whether rows are of an object that came into the image too late to be seen often."""
    frames = proposals.frame_index[rows]
    left, top, right, bottom = (int(side) for side in proposals.box_xyxy_px[rows[0]])
    margin = c.border_px
    at_border = left < margin or top < margin or right > WIDTH_PX - margin or bottom > HEIGHT_PX - margin
    since = proposals.n_frames - int(frames[0])
    return (
        at_border
        and len(rows) >= c.min_late_frames
        and int(frames[-1]) >= proposals.n_frames - 2
        and since <= c.min_frames + c.max_gap_frames
        and len(rows) >= 0.7 * since
    )


def _shadows(t: Track, other: Track, c: TrackerConfig) -> bool:
    """Whether a track is a second name for a longer one: two objects cannot be at one position all the time."""
    if len(t.frame_index) >= len(other.frame_index):
        return False
    between = np.stack([np.interp(t.frame_index, other.frame_index, side) for side in other.box_xyxy_px.T], 1)
    low, high = np.maximum(t.box_xyxy_px, between)[:, :2], np.minimum(t.box_xyxy_px, between)[:, 2:]
    shared = np.prod(np.clip(high - low, 0, None), axis=1)
    area = [np.prod(box[:, 2:] - box[:, :2], axis=1) for box in (t.box_xyxy_px, between)]
    overlap = shared / np.maximum(area[0] + area[1] - shared, 1)
    return bool((overlap > c.shadow_overlap).mean() >= c.shadow_share)


def _words(t: Track) -> tuple[str, str, str]:
    return t.object.color, t.object.material, t.object.shape


def _positions(proposals: VideoProposals, kept: NDArray[Any], c: TrackerConfig) -> NDArray[Any]:
    """(N, 2) ground positions of the kept rows, NaN elsewhere."""
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
        found = ground_location(
            shape, proposals.centroid_px[rows], proposals.box_xyxy_px[rows], hidden[shapes == index]
        )
        positions[rows] = found
    return positions


def _link(proposals: VideoProposals, kept: NDArray[Any], positions: NDArray[Any], c: TrackerConfig) -> list[_Tracklet]:
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
                if distance > c.reach_world + gap * c.reach_world_per_frame:
                    continue
                other = attributes_of(int(proposals.attribute[row]))
                mismatches = sum(a != b for a, b in zip(words, other, strict=True))
                cost[i, j] = distance + c.mismatch_world * mismatches
        # An unmatched row must stay possible: a large finite cost stands for "no match".
        chosen_rows, chosen_tracklets = linear_sum_assignment(np.minimum(cost, 1e3))
        matched = set()
        for i, j in zip(chosen_rows.tolist(), chosen_tracklets.tolist(), strict=True):
            if np.isfinite(cost[i, j]):
                active[j].add(rows[i], frame, positions[rows[i]])
                matched.add(i)
        for i in set(range(len(rows))) - matched:
            tracklet = _Tracklet()
            tracklet.add(rows[i], frame, positions[rows[i]])
            active.append(tracklet)
    return done + active


def _identities(proposals: VideoProposals, tracklets: list[_Tracklet]) -> dict[int, list[int]]:
    """Rows of each attribute triple: tracklets vote; where two of one triple overlap in time, the longer one has the frame."""
    by_identity: dict[int, dict[int, int]] = defaultdict(dict)
    for tracklet in sorted(tracklets, key=lambda p: -len(p.rows)):
        votes: dict[int, float] = defaultdict(float)
        for row in tracklet.rows:
            # Objects cut by the image's border are often mislabelled; whole ones show more pixels.
            votes[int(proposals.attribute[row])] += float(proposals.score[row]) * int(proposals.area_px[row])
        identity = max(votes, key=lambda a: votes[a])
        for row in tracklet.rows:
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
