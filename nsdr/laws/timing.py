"""The times at which the frames of a video were taken, if they differ from what its frame rate says.

A copy at another frame rate often leaves out frames or repeats them. Then all moving objects jump or pause together, by whole
frames of the original. A video may also stand still while something should move.
"""

from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import product
from typing import Any

import numpy as np

from nsdr.dynamics.motion_states import states_from_tracks
from nsdr.laws.motion import Evidence
from nsdr.laws.stretches import costs
from nsdr.tracking.times import first_of, on_time
from nsdr.types import VideoProposals, VideoTracks
from nsdr.validation import FloatArray, IntArray

STEP_NOISE_WORLD, STEP_NOISE_SHARE = 0.0045, 0.035
"""Standard deviation of each coordinate of a step from one frame to the next: a constant (world units in CLEVRER) plus a share
of the step. Measured on 22 scenes of `train` against the mean velocity of the 6 frames on either side: 0.0046 at 0.015 world
units per frame, 0.0053 at 0.03, 0.007 at 0.08."""
VELOCITY_FRAMES = 6
"""Number of frames on each side of a step from which velocities are computed."""
RATES = (24.0, 24000 / 1001, 30000 / 1001, 30.0, 50.0, 60.0, 20.0, 15.0, 12.5, 12.0, 10.0, 25 / 3, 8.0, 25.0)
"""Possible frame rates of an intermediate copy, but for that of the world's videos (frames per second)."""
PHASES, FINE_PHASES = (tuple((np.arange(n) + 0.5) / n) for n in (25, 100))
"""Possible times of the first frame of a copy within a frame of its original (frames): for copies of copies, and for direct
copies."""
MIN_GAIN_NATS = 10.0
"""A video counts as a copy at another rate if this explains the steps better by at least this (nats). Of 22 lawful scenes of
`train` at 25 frames per second, none gains more than 3; at 24 per second, with one frame in 25 missing, none gains less than
20."""
CHAIN_NATS = 5.0
"""A copy of a copy must explain the steps better than a direct copy by at least this (nats)."""
MIN_STILL_FRAMES = 4.0
"""Shortest duration of a standstill (frames of CLEVRER; in other worlds as long). Shorter ones are repeated frames."""
MIN_STILL_NATS = 10.0
"""Weaker evidence of a standstill is ignored (nats). Of 145 lawful scenes of `train`, three have such evidence, of 5 to 7."""
SAME_NATS = 2.0
"""Bonus for each frame when the start and end of a standstill are chosen (nats)."""
MOVED_NATS = 20.0
"""Evidence of motion that rules out a standstill (nats)."""
MAX_STANDSTILLS = 4
"""Largest number of standstills that are searched for in a video."""
ROUNDING, TINY = 1e-6, 1e-12
"""Rounding error of times (frames), and smallest squared distance that is divided by (world units²)."""


@dataclass(frozen=True, eq=False)
class Timing:
    """The times at which the P processed frames of a video were taken.

    A slot is a frame of a video at the rate of the world's videos, in CLEVRER 25 frames per second.

    Attributes:
        n_frames: number of frames of the video.
        shown: (P,) int, frame numbers of the processed frames.
        slot: (P,) int, the slot of each processed frame, in ascending order; repeated frames have the same slot.
        late: (P,) delay of each processed frame relative to its slot (frames).
        evidence: evidence of standstills.
        notes: what a user should know about the timing.
    """

    n_frames: int
    shown: IntArray
    slot: IntArray
    late: FloatArray
    evidence: tuple[Evidence, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def slots(self) -> IntArray:
        """The slots that are shown, in ascending order."""
        return self.slot[self._first]

    @property
    def _own_frames(self) -> int:
        """Number of slots."""
        return int(self.slot[-1]) + self.n_frames - int(self.shown[-1])

    @property
    def _first(self) -> IntArray:
        """Indices of the first processed frame in each slot."""
        return np.unique(self.slot, return_index=True)[1]

    def tracks(self, tracks: VideoTracks) -> VideoTracks:
        """Tracks with slots as frames. Positions of delayed frames are interpolated linearly."""
        slot = np.full(self.n_frames, -1)
        slot[self.shown] = self.slot
        late = np.zeros(self._own_frames)
        late[self.slot[self._first]] = self.late[self._first]
        moved = tuple(on_time(first_of(t, slot[t.frame_index]), late) for t in tracks.tracks)
        return replace(tracks, n_frames=self._own_frames, tracks=moved)

    def proposals(self, proposals: VideoProposals) -> VideoProposals:
        """Proposals with slots as frames; those in repeated frames are left out."""
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
            processed=self.slots,
            **columns,
        )

    def as_shown(self, e: Evidence) -> Evidence:
        """Evidence with frames of the video in place of slots."""
        frame, end = self._shown(e.frame), self._shown(e.end)
        is_time = e.unit == "frames" and e.end > e.frame
        amount = e.amount * (end - frame) / (e.end - e.frame) if is_time else e.amount
        return e._replace(frame=frame, end=end, amount=amount)

    def _shown(self, slot: int) -> int:
        """The first processed frame from a slot on, or the end of the video."""
        k = int(np.searchsorted(self.slot, slot))
        return int(self.shown[k]) if k < len(self.slot) else self.n_frames


def timing_of(tracks: VideoTracks, processed: IntArray, late: FloatArray) -> Timing:
    """Find the times at which the frames of a video were taken, from its frame rate and the common steps of its objects.

    Args:
        tracks: tracks of the video.
        processed: (P,) int, frames that were processed.
        late: (F,) delay of each frame, by the frame rate of the video, relative to a video of the world (frames).
    """
    said, slot = processed + late[processed], processed
    pattern: IntArray | None = None
    stills: list[Evidence] = []
    states = states_from_tracks(tracks)
    world = tracks.world
    reliable = np.where(states.reliable[..., None], states.location_world, np.nan)[:, processed]
    scales = world.scales
    steps = _Steps(reliable, world.timeline.fps, STEP_NOISE_WORLD * scales.size, MIN_STILL_FRAMES * scales.rate)
    every, order = tuple(range(len(tracks.tracks))), np.arange(len(processed))
    for _ in range(MAX_STANDSTILLS):
        pattern = steps.pattern(said)
        still = steps.standstill(said if pattern is None else pattern.astype(float))
        if still is None:
            break
        a, b, nats = still
        first, end = int(processed[a]), int(processed[b]) + 1
        stills.append(Evidence("standstill", every, first, end, end - first, "frames", nats))
        # No time passes during a standstill.
        said, slot = (np.where(order < b, np.minimum(t, t[a]), t - t[b] + t[a]) for t in (said, slot))
    else:  # the last pattern did not take the last standstill into account
        pattern = steps.pattern(said)
    if pattern is None:
        return Timing(tracks.n_frames, processed, slot, said - slot, tuple(stills))
    again = int((np.diff(pattern) == 0).sum()) if not stills else 0
    notes = copy_notes(int(pattern[-1]) + 1, len(np.unique(pattern)), again, world.timeline.fps)
    return Timing(tracks.n_frames, processed, pattern, np.zeros(len(pattern)), tuple(stills), notes)


def copy_notes(taken: int, shown: int, again: int, fps: int) -> tuple[str, ...]:
    """Notes on a copy at another frame rate.

    Args:
        taken: number of frames of the original.
        shown: number of them that the copy shows.
        again: number of frames that the copy repeats.
        fps: frame rate of the original.
    """
    parts = []
    if shown < taken:
        parts.append(f"{taken - shown} of {taken} frames are missing")
    if again:
        parts.append(f"{again} are shown again")
    how = f" ({', '.join(parts)})" if parts else ""
    return (f"copied from {fps} frames a second to another rate{how}; each frame is judged at its own time",)


@dataclass(frozen=True, eq=False)
class _Steps:
    """The steps of all n objects from one processed frame to the next.

    Attributes:
        location: (n, P, 2) reliable positions (world units); NaN for all others.
        fps: frame rate of the world's videos.
        noise: standard deviation of each coordinate of a short step (world units).
        min_still: shortest duration of a standstill (frames).
    """

    location: FloatArray
    fps: int
    noise: float
    min_still: float

    def pattern(self, said: FloatArray) -> IntArray | None:
        """Find the frames of the original that the processed frames show, if the video is a copy at another rate.

        Args:
            said: (P,) times of the frames by the frame rate of the video (frames).

        Returns:
            (P,) int, frames of the original, counted from the first one; None if the video is not such a copy.
        """
        slots, more_nats = _patterns((said - said[0]).tobytes(), self.fps)
        step, (before, after) = np.diff(self.location, axis=1), self._velocities(said)
        before, after = before[:, :-1], after[:, 1:]

        def cost(frames: Any) -> FloatArray:
            """Evidence (P - 1,) against steps over a number of frames."""
            return _off_nats(step, frames * before, frames * after, self.noise)

        by_frames = np.stack([cost(frames) for frames in range(np.diff(slots, axis=1).max() + 1)], 1)
        nats = by_frames[np.arange(step.shape[1]), np.diff(slots, axis=1)].sum(1) + more_nats
        best = slots[int(nats.argmin())]
        gain = cost(np.diff(said)[:, None]).sum() - nats.min()
        return best if gain > MIN_GAIN_NATS else None

    def standstill(self, taken: FloatArray) -> tuple[int, int, float] | None:
        """Find the strongest standstill: frames that do not change although something should move.

        Args:
            taken: (P,) times at which the frames were taken (frames).

        Returns:
            Indices of the first and last of the frames, and the evidence (nats); None if there is no standstill.
        """
        before, after = self._velocities(taken)
        best, most = (0, 0, 0.0), MIN_STILL_NATS
        for a in range(1, len(taken) - 1):
            moves = np.asarray(np.isfinite(before[:, a]).all(axis=1))
            since, moved = taken - taken[a], self.location - self.location[:, a : a + 1]
            stays = np.cumsum(_nats(moved[:, a:], self.noise))
            ends = np.flatnonzero(since >= self.min_still - ROUNDING)
            ends = ends[stays[ends - a] < MOVED_NATS]
            if not moves.any() or not len(ends):
                continue
            # An object whose velocity afterwards is not known may have come to rest.
            known = moves[:, None, None] & np.isfinite(after[:, ends])
            low = np.where(known, since[ends, None] * before[:, a : a + 1], np.nan)
            high = since[ends, None] * after[:, ends]
            gains = _off_nats(moved[:, ends], low, high, self.noise) - stays[ends - a]
            scores = np.where(gains > MIN_STILL_NATS, gains + SAME_NATS * (ends - a), 0.0)
            k = int(scores.argmax())
            if scores[k] > most:
                best, most = (a, int(ends[k]), float(gains[k])), scores[k]
        return best if best[1] else None

    def _velocities(self, taken: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Velocities (n, P, 2) before and after each frame (world units/frame); NaN where they are not known."""
        x, every = self.location, np.arange(len(taken))
        first = np.searchsorted(taken, taken - VELOCITY_FRAMES + ROUNDING, side="right") - 1
        last = np.searchsorted(taken, taken + VELOCITY_FRAMES - ROUNDING)
        before, after = np.full_like(x, np.nan), np.full_like(x, np.nan)
        k = every[first >= 0]
        before[:, k] = (x[:, k] - x[:, first[k]]) / (taken[k] - taken[first[k]])[:, None]
        k = every[last < len(taken)]
        after[:, k] = (x[:, last[k]] - x[:, k]) / (taken[last[k]] - taken[k])[:, None]
        return before, after


def _off_nats(moved: FloatArray, low: FloatArray, high: FloatArray, noise: float) -> FloatArray:
    """Evidence (K,) against displacements (n, K, 2) (nats).

    The expected displacement is any on the line from `low` to `high` (n, K, 2). One or both of these may be NaN. `noise` is the
    standard deviation of each coordinate of a short step (world units).
    """
    low, high = np.where(np.isnan(low), high, low), np.where(np.isnan(high), low, high)
    along = high - low
    share = ((moved - low) * along).sum(-1) / np.maximum((along**2).sum(-1), TINY)
    off = moved - low - np.clip(share, 0, 1)[..., None] * along
    return _nats(off, noise + STEP_NOISE_SHARE * np.maximum(*(np.linalg.norm(v, axis=-1) for v in (low, high))))


def _nats(off: FloatArray, noise: FloatArray | float) -> FloatArray:
    """Evidence (K,) of all objects together against deviations (n, K, 2) of this noise (nats). NaN values are ignored."""
    return np.asarray(np.nansum(costs((off**2).sum(-1), 1.0, noise), axis=0))


@lru_cache(maxsize=8)
def _patterns(said: bytes, fps: int) -> tuple[IntArray, FloatArray]:
    """Frames (C, P) of the original that C possible copies at other rates show, and the penalty (C,) of each (nats).

    Args:
        said: (P,) times of the frames of the copy (frames), as the bytes of 64-bit floats.
        fps: frame rate of the original.
    """
    taken = np.frombuffer(said)
    found: dict[bytes, float] = {}
    for phase in FINE_PHASES:
        found.setdefault(_counted(taken + phase), 0.0)
    rates = [rate for rate in RATES if rate != fps]
    for rate, first, second in product(rates, PHASES, PHASES):
        found.setdefault(_counted(np.floor(taken * rate / fps + first) * fps / rate + second), CHAIN_NATS)
    return np.stack([np.frombuffer(slots, np.int64) for slots in found]), np.array(list(found.values()))


def _counted(taken: FloatArray) -> bytes:
    """The frames (P,) of the original at times (P,), relative to the first of them, as the bytes of 64-bit integers."""
    frames = np.floor(taken + ROUNDING).astype(np.int64)
    return (frames - frames[0]).tobytes()
