"""When each frame of a video was taken, where that is not what its frame rate says.

A copy at another frame rate often leaves frames out, or shows frames again: then all moving objects jump or pause together, by
whole frames of the original. A picture may also stand still while something should move.
"""

from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import product
from typing import Any

import numpy as np

from nsdr.dynamics.motion_states import states_from_tracks
from nsdr.laws.motion import Evidence
from nsdr.laws.stretches import costs
from nsdr.types import Track, VideoProposals, VideoTracks
from nsdr.validation import FloatArray, IntArray
from nsdr.world.physics_constants import FPS

STEP_NOISE_WORLD, STEP_NOISE_SHARE = 0.0045, 0.035
"""Standard deviation of each coordinate of a step from one frame to the next: this, and this share of the step (world units).
Measured on 22 scenes of `train` against the mean velocity of the 6 frames on either side: 0.0046 at 0.015 world units per
frame, 0.0053 at 0.03, 0.007 at 0.08."""
VELOCITY_FRAMES = 6
"""Frames on either side of a step that tell the velocity."""
RATES = (24.0, 24000 / 1001, 30000 / 1001, 30.0, 50.0, 60.0, 20.0, 15.0, 12.5, 12.0, 10.0, 25 / 3, 8.0)
"""Frame rates that a copy may have had on its way (frames per second)."""
PHASES, FINE_PHASES = (tuple((np.arange(n) + 0.5) / n) for n in (25, 100))
"""When a copy's first frame was taken, within a frame of what it was copied from (frames): of copies of copies, and of
others."""
MIN_GAIN_NATS = 10.0
"""A video is a copy of another rate if this explains the steps so much better (nats). Of 22 lawful scenes of `train` at 25
frames a second none gains more than 3; at 24 a second with one frame in 25 missing, none less than 20."""
CHAIN_NATS = 5.0
"""A copy of a copy must explain the steps better by so much (nats)."""
MIN_STILL_FRAMES = 4.0
"""A standstill lasts at least so long; shorter ones are frames that are shown again (frames)."""
MIN_STILL_NATS = 10.0
"""Less evidence of a standstill is none (nats): of 145 lawful scenes of `train` three have some, of 5 to 7."""
SAME_NATS = 2.0
"""Where a standstill begins and ends, each frame counts so much (nats)."""
MOVED_NATS = 20.0
"""What moves by so much does not stand still (nats)."""
MAX_STANDSTILLS = 4
"""Most standstills that are looked for in a video."""
ROUNDING, TINY = 1e-6, 1e-12
"""Times are known so well (frames); the least square of a distance that is divided by (world units²)."""


@dataclass(frozen=True, eq=False)
class Timing:
    """When the frames of a video were taken.

    Attributes:
        n_frames: number of frames of the video.
        shown: (P,) the frames that were processed.
        slot: (P,) the frame of 25 per second that each of them is, in ascending order; equal for the same picture.
        late: (P,) how much later it was taken (frames).
        evidence: of standstills.
        notes: what a user should know of it.
    """

    n_frames: int
    shown: IntArray
    slot: IntArray
    late: FloatArray
    evidence: tuple[Evidence, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def _own_frames(self) -> int:
        """Number of frames at their own times."""
        return int(self.slot[-1]) + self.n_frames - int(self.shown[-1])

    @property
    def _first(self) -> IntArray:
        """Indices of the first frame with each picture."""
        return np.unique(self.slot, return_index=True)[1]

    def tracks(self, tracks: VideoTracks) -> VideoTracks:
        """Tracks at the times at which the frames were taken: positions between frames lie on straight lines."""
        slot = np.full(self.n_frames, -1)
        slot[self.shown] = self.slot
        late = np.zeros(self._own_frames)
        late[self.slot[self._first]] = self.late[self._first]
        moved = tuple(_on_time(_first_of(t, slot[t.frame_index]), late) for t in tracks.tracks)
        return replace(tracks, n_frames=self._own_frames, tracks=moved)

    def proposals(self, proposals: VideoProposals) -> VideoProposals:
        """Proposals at those times, each picture once."""
        slot = np.full(self.n_frames, -1)
        slot[self.shown[self._first]] = self.slot[self._first]
        rows = np.flatnonzero(slot[proposals.frame_index] >= 0)
        names = ("attribute", "score", "centroid_px", "area_px", "box_xyxy_px")
        columns: dict[str, Any] = {name: getattr(proposals, name)[rows] for name in names}
        return replace(
            proposals,
            n_frames=self._own_frames,
            frame_index=slot[proposals.frame_index[rows]],
            masks=None if proposals.masks is None else tuple(proposals.masks[r] for r in rows.tolist()),
            processed=self.slot[self._first],
            **columns,
        )

    def as_shown(self, e: Evidence) -> Evidence:
        """Evidence with frames of the video in place of frames at their own times."""
        frame, end = self._shown(e.frame), self._shown(e.end)
        is_time = e.unit == "frames" and e.end > e.frame
        amount = e.amount * (end - frame) / (e.end - e.frame) if is_time else e.amount
        return e._replace(frame=frame, end=end, amount=amount)

    def _shown(self, slot: int) -> int:
        k = int(np.searchsorted(self.slot, slot))
        return int(self.shown[k]) if k < len(self.slot) else self.n_frames


def _first_of(t: Track, slot: IntArray) -> Track:
    """A track's first detection of each picture."""
    slots, rows = np.unique(slot, return_index=True)
    names = ("location_world", "centroid_px", "box_xyxy_px", "score")
    arrays: dict[str, Any] = {name: getattr(t, name)[rows] for name in names}
    return replace(t, frame_index=slots, **arrays)


def _on_time(t: Track, late: FloatArray) -> Track:
    frames, location = t.frame_index, t.location_world
    if len(frames) < 2 or not late[frames].any():
        return t
    taken = frames + late[frames]
    moved = np.stack([np.interp(frames, taken, along) for along in location.T], 1)
    for end, beside in ((0, 1), (-1, -2)):
        velocity = (location[beside] - location[end]) / (taken[beside] - taken[end])
        moved[end] = location[end] + (frames[end] - taken[end]) * velocity
    return replace(t, location_world=moved)


def timing_of(tracks: VideoTracks, processed: IntArray, late: FloatArray) -> Timing:
    """When the frames of a video were taken, by its frame rate and by the common steps of its objects.

    Args:
        tracks: of the video, as it is shown.
        processed: (P,) frames that were processed.
        late: (F,) how much later each frame was taken than at 25 per second, by the video's own rate (frames).
    """
    said, slot = processed + late[processed], processed
    pattern: IntArray | None = None
    stills: list[Evidence] = []
    states = states_from_tracks(tracks)
    steps = _Steps(np.where(states.reliable[..., None], states.location_world, np.nan)[:, processed])
    every, order = tuple(range(len(tracks.tracks))), np.arange(len(processed))
    for _ in range(MAX_STANDSTILLS):
        pattern = steps.pattern(said)
        still = steps.standstill(said if pattern is None else pattern.astype(float))
        if still is None:
            break
        a, b, nats = still
        first, end = int(processed[a]), int(processed[b]) + 1
        stills.append(Evidence("standstill", every, first, end, end - first, "frames", nats))
        # Nothing is taken while time stands still.
        said, slot = (np.where(order < b, np.minimum(t, t[a]), t - t[b] + t[a]) for t in (said, slot))
    else:  # the pattern is that before the last standstill
        pattern = steps.pattern(said)
    if pattern is None:
        return Timing(tracks.n_frames, processed, slot, said - slot, tuple(stills))
    again = int((np.diff(pattern) == 0).sum()) if not stills else 0
    notes = copy_notes(int(pattern[-1]) + 1, len(np.unique(pattern)), again)
    return Timing(tracks.n_frames, processed, pattern, np.zeros(len(pattern)), tuple(stills), notes)


def copy_notes(taken: int, shown: int, again: int) -> tuple[str, ...]:
    """What a user should know of a copy at another rate.

    Args:
        taken: frames of the original.
        shown: how many of them the copy shows.
        again: how many it shows once more.
    """
    parts = []
    if shown < taken:
        parts.append(f"{taken - shown} of {taken} frames are missing")
    if again:
        parts.append(f"{again} are shown again")
    how = f" ({', '.join(parts)})" if parts else ""
    return (f"copied from {FPS} frames a second to another rate{how}; each frame is judged at its own time",)


@dataclass(frozen=True, eq=False)
class _Steps:
    """The steps of all objects from one processed frame to the next.

    Attributes:
        location: (n, P, 2) reliable positions; others are NaN (world units).
    """

    location: FloatArray

    def pattern(self, said: FloatArray) -> IntArray | None:
        """The frame of the original (P,), from 0 on, that each frame is, if the video is a copy at another rate.

        Args:
            said: (P,) when each frame was taken by the video's rate (frames).
        """
        slots, more_nats = _patterns((said - said[0]).tobytes())
        step, (before, after) = np.diff(self.location, axis=1), self._velocities(said)
        before, after = before[:, :-1], after[:, 1:]

        def cost(frames: Any) -> FloatArray:
            return _off_nats(step, frames * before, frames * after)

        by_frames = np.stack([cost(frames) for frames in range(np.diff(slots, axis=1).max() + 1)], 1)
        nats = by_frames[np.arange(step.shape[1]), np.diff(slots, axis=1)].sum(1) + more_nats
        best = slots[int(nats.argmin())]
        gain = cost(np.diff(said)[:, None]).sum() - nats.min()
        return best if gain > MIN_GAIN_NATS else None

    def standstill(self, taken: FloatArray) -> tuple[int, int, float] | None:
        """First and last index of frames that show the same while something should move, and the evidence of it (nats).

        Args:
            taken: (P,) when each frame was taken (frames).
        """
        before, after = self._velocities(taken)
        best, most = (0, 0, 0.0), MIN_STILL_NATS
        for a in range(1, len(taken) - 1):
            moves = np.asarray(np.isfinite(before[:, a]).all(axis=1))
            since, moved = taken - taken[a], self.location - self.location[:, a : a + 1]
            stays = np.cumsum(_nats(moved[:, a:], STEP_NOISE_WORLD))
            ends = np.flatnonzero(since >= MIN_STILL_FRAMES - ROUNDING)
            ends = ends[stays[ends - a] < MOVED_NATS]
            if not moves.any() or not len(ends):
                continue
            # An object of which the velocity afterwards is not known may have come to rest.
            known = moves[:, None, None] & np.isfinite(after[:, ends])
            low = np.where(known, since[ends, None] * before[:, a : a + 1], np.nan)
            gains = _off_nats(moved[:, ends], low, since[ends, None] * after[:, ends]) - stays[ends - a]
            scores = np.where(gains > MIN_STILL_NATS, gains + SAME_NATS * (ends - a), 0.0)
            k = int(scores.argmax())
            if scores[k] > most:
                best, most = (a, int(ends[k]), float(gains[k])), scores[k]
        return best if best[1] else None

    def _velocities(self, taken: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Velocities (n, P, 2) before and after each frame (world units per frame); NaN where they are not known."""
        x, every = self.location, np.arange(len(taken))
        first = np.searchsorted(taken, taken - VELOCITY_FRAMES + ROUNDING, side="right") - 1
        last = np.searchsorted(taken, taken + VELOCITY_FRAMES - ROUNDING)
        before, after = np.full_like(x, np.nan), np.full_like(x, np.nan)
        k = every[first >= 0]
        before[:, k] = (x[:, k] - x[:, first[k]]) / (taken[k] - taken[first[k]])[:, None]
        k = every[last < len(taken)]
        after[:, k] = (x[:, last[k]] - x[:, k]) / (taken[last[k]] - taken[k])[:, None]
        return before, after


def _off_nats(moved: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    """Evidence (K,) against displacements (n, K, 2) between two expected ones, of which one or both may be NaN (nats)."""
    low, high = np.where(np.isnan(low), high, low), np.where(np.isnan(high), low, high)
    along = high - low
    share = ((moved - low) * along).sum(-1) / np.maximum((along**2).sum(-1), TINY)
    off = moved - low - np.clip(share, 0, 1)[..., None] * along
    return _nats(
        off, STEP_NOISE_WORLD + STEP_NOISE_SHARE * np.maximum(*(np.linalg.norm(v, axis=-1) for v in (low, high)))
    )


def _nats(off: FloatArray, noise: FloatArray | float) -> FloatArray:
    """Evidence (K,) against distances (n, K, 2), of all objects together; NaN count for nothing (nats)."""
    return np.asarray(np.nansum(costs((off**2).sum(-1), 1.0, noise), axis=0))


@lru_cache(maxsize=8)
def _patterns(said: bytes) -> tuple[IntArray, FloatArray]:
    """Frames of the original (C, P) that copies at other rates show, and by how many nats (C,) each must be better.

    Args:
        said: (P,) times of the copy's frames, as bytes of 64-bit numbers (frames).
    """
    taken = np.frombuffer(said)
    found: dict[bytes, float] = {}
    for phase in FINE_PHASES:
        found.setdefault(_counted(taken + phase), 0.0)
    for rate, first, second in product(RATES, PHASES, PHASES):
        found.setdefault(_counted(np.floor(taken * rate / FPS + first) * FPS / rate + second), CHAIN_NATS)
    return np.stack([np.frombuffer(slots, np.int64) for slots in found]), np.array(list(found.values()))


def _counted(taken: FloatArray) -> bytes:
    """The frames (P,) that are shown at times, counted from the first one."""
    frames = np.floor(taken + ROUNDING).astype(np.int64)
    return (frames - frames[0]).tobytes()
