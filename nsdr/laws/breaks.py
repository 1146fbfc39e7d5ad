"""The cuts of a track into stretches of free sliding, and the changes of motion at the cuts.

A stretch (`nsdr.laws.stretches`) is cut in two if this explains its positions better than chance would, by a generalised
likelihood ratio. This is repeated for both parts.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from nsdr.dynamics.motion_states import UNRELIABLE_WEIGHT, MotionStates
from nsdr.dynamics.numba_cache import cached_njit
from nsdr.dynamics.sliding import fit_sliding, law_of
from nsdr.laws.stretches import CUT_GAIN, MIN_PART_POSITIONS, TrackPositions, TrackStretch, costs
from nsdr.validation import FloatArray
from nsdr.world.world import Scales

MIN_NOISE_WORLD, FIRST_NOISE_WORLD = 0.004, 0.005
"""Smallest standard deviation of positions, which is measured in each video, and the one with which stretches are first cut to
measure it (world units in CLEVRER)."""
MERGE_GAIN = 6.0
"""Two stretches without a contact between them are merged if a single stretch costs at most this much more (nats). Chosen on
the training suites of docs/judge.md."""
FIRST_STEP = 8
"""First step of the search that moves a cut beside another ground to where both sides fit better (number of positions)."""
MIN_EVIDENCE = 4.0
"""Weaker evidence is ignored (nats)."""
SURE_FRAMES = 8
"""Smallest number of positions of a stretch that shows that they are not those of another object."""
BORDER_PX = 10.0
"""The position of an object whose box is nearer to the image border is unreliable: official proposals are inexact there
(pixels of CLEVRER's images)."""
JUMP_NOISE_WORLD = {"box": 0.015, "cylinder": 0.006, "sphere": 0.006}
KICK_NOISE_WORLD_PER_S = {"box": 0.06, "cylinder": 0.03, "sphere": 0.03}
"""Standard deviations of a change of position and of velocity in addition to the errors of the fits (world units, world
units/s in CLEVRER). Those of boxes are larger, because boxes turn and their outlines change."""
HIDDEN_NOISE_WORLD = 0.04
"""Standard deviation in place of `JUMP_NOISE_WORLD` if an object is at least partly hidden for more than `JUMP_FRAMES` frames
(world units in CLEVRER). Of 193 such changes in lawful videos of `train`, one in fifty looks like a jump of more than 0.086,
the largest like one of 0.17 (`python -m benchmarks.violations --lawful PROPOSALS_TRAIN.npz --every 48 --first 5 --jumps`)."""
JUMP_FRAMES = 6
"""After more frames without a reliable position, the position is weaker evidence of a jump (`HIDDEN_NOISE_WORLD`). After more
frames without any position, it is no evidence if a visible object can have hit the object."""
SLIGHT_WORLD, SLIGHT_WORLD_PER_S = 0.015, 0.08
"""Smaller changes of position and velocity are ignored (world units, world units/s in CLEVRER)."""
SEEN_GAP_FRAMES = 3
"""A change is observed directly if the reliable positions before and after it are at most this far apart (frames)."""
MIN_MARGIN_FRAMES, MAX_MARGIN_FRAMES = 0.3, 1.2
"""Limits of the error of the frame in which a change seems to happen (frames)."""


class MotionChange(NamedTuple):
    """The size of a change of position (world units) or velocity (world units/s), and the evidence for it (nats)."""

    size: float
    nats: float


@dataclass(frozen=True, eq=False)
class Break:
    """A change of the motion of an object between two stretches."""

    before: TrackStretch
    after: TrackStretch

    @property
    def i(self) -> int:
        """Id of the object."""
        return self.before.track.i

    @cached_property
    def frame(self) -> float:
        """The time at which both stretches are nearest to each other, between their positions or a frame beside (frames)."""
        low, high = self.before.last - 1, self.after.start + 1
        frames = np.linspace(low, high, 4 * (high - low) + 1)
        return float(
            frames[np.linalg.norm(self.before.position_at(frames) - self.after.position_at(frames), axis=1).argmin()]
        )

    @cached_property
    def seen(self) -> tuple[int, int]:
        """Frames of the nearest reliable positions before and after the change, or the outer ends of stretches without any."""
        before, after = (s.frames[s.reliable] for s in (self.before, self.after))
        return int(before[-1] if len(before) else self.before.start), int(after[0] if len(after) else self.after.last)

    @property
    def hidden_frames(self) -> int:
        """Number of frames between the nearest reliable positions before and after the change."""
        return self.seen[1] - self.seen[0]

    @property
    def missing_frames(self) -> int:
        """Number of frames between the nearest positions before and after the change, reliable or not."""
        return self.after.start - self.before.last

    @cached_property
    def window(self) -> FloatArray:
        """Times at which the change may happen, half a frame apart: around `frame`, or while it is not seen (frames)."""
        low, high, margin = float(self.seen[0]), float(self.seen[1]), MAX_MARGIN_FRAMES
        if self.hidden_frames <= SEEN_GAP_FRAMES:
            error = self.position_variance**0.5 / max(
                float(np.hypot(*self.change)) * self.before.track.frame_seconds, 1e-9
            )
            low, high, margin = self.frame, self.frame, MIN_MARGIN_FRAMES + min(3 * error, MAX_MARGIN_FRAMES)
        low, high = min(low, self.frame) - margin, max(high, self.frame) + margin
        return np.linspace(low, high, 2 + round(2 * (high - low)))

    @cached_property
    def position(self) -> FloatArray:
        """(2,) position of the object at the change, by the stretch before it (world units)."""
        return np.asarray(self.before.position_at(np.array([self.frame]))[0])

    @cached_property
    def change(self) -> FloatArray:
        """(2,) velocity after minus velocity before (world units/s)."""
        at = np.array([self.frame])
        return np.asarray((self.after.velocity_at(at) - self.before.velocity_at(at))[0])

    @property
    def position_variance(self) -> float:
        """Variance of each coordinate of the difference between the positions by both stretches (world units²)."""
        at = np.array([self.frame])
        return float(sum(s.position_variance(at, s.track.noise)[0] for s in (self.before, self.after)))

    def jump(self) -> MotionChange:
        """The change of the position.

        nats = size² / (2 (variance + noise²))
        """
        size = float(np.hypot(*(self.after.position_at(np.array([self.frame]))[0] - self.position)))
        is_hidden = self.hidden_frames > JUMP_FRAMES
        noise = HIDDEN_NOISE_WORLD if is_hidden else JUMP_NOISE_WORLD[self.before.shape.solid]
        noise *= self._scales.size
        return MotionChange(size, size**2 / (2 * (self.position_variance + noise**2)))

    def kick(self) -> MotionChange:
        """The change of the velocity.

        nats = size² / (2 (variance + noise²))
        """
        size, noise = float(np.hypot(*self.change)), kick_noise(self.before)
        variance = sum(s.velocity_variance(s.track.noise) for s in (self.before, self.after))
        return MotionChange(size, size**2 / (2 * (variance + noise**2)))

    @property
    def is_change(self) -> bool:
        """Whether there is evidence that the motion changes."""
        return max(self.jump().nats, self.kick().nats) >= MIN_EVIDENCE

    @property
    def may_be_change(self) -> bool:
        """Whether the motion changes, or one side has too few positions to tell."""
        return self.is_change or min(len(self.before), len(self.after)) < SURE_FRAMES

    @property
    def is_slight(self) -> bool:
        """Whether the change is so small that a few inexact positions explain it, as in the frames of a contact."""
        scales = self._scales
        slow = SLIGHT_WORLD_PER_S * scales.speed
        return self.jump().size < SLIGHT_WORLD * scales.size and self.kick().size < slow

    @property
    def _scales(self) -> Scales:
        return self.before.track.scales


def kick_noise(stretch: TrackStretch) -> float:
    """Standard deviation of a change of the velocity of an object, in addition to errors of the fits (world units/s)."""
    return KICK_NOISE_WORLD_PER_S[stretch.shape.solid] * stretch.track.scales.speed


def positions_of(states: MotionStates, i: int, noise: float, known_ground: bool) -> TrackPositions:
    """Collect the detected positions of an object.

    Args:
        states: motion states of the objects.
        i: id of the object.
        noise: standard deviation of each coordinate of reliable positions (world units).
        known_ground: whether the ground is known to be the world's.
    """
    frames = np.flatnonzero(states.detected[i])
    box = states.box_xyxy_px[i, frames]
    world, size_px = states.world, np.array([states.camera.width, states.camera.height])
    border = BORDER_PX * world.scales.px
    near_border = ((box[:, :2] < border) | (size_px - box[:, 2:] < border)).any(1)
    weight = np.where(near_border, UNRELIABLE_WEIGHT, states.weight[i, frames])
    o, location = states.objects[i], states.location_world[i, frames]
    of_object = world.vocabulary.shape(o.shape), law_of(o, world), world.scales
    return TrackPositions(i, *of_object, frames, location, weight, noise, known_ground)


def cut(track: TrackPositions) -> list[TrackStretch]:
    """Cut the track of an object into stretches, in order of time."""
    ends = [0, *_cuts(track, 0, len(track.frames)), len(track.frames)]
    return [track.best_stretch(a, b) for a, b in pairwise(ends)]


def merge(stretches: Sequence[TrackStretch], is_explained: Callable[[Break], bool]) -> list[TrackStretch]:
    """Remove unnecessary cuts, and move cuts beside another ground.

    A cut is removed if the change is slight, or if nothing lawful explains it and a single stretch fits about as well. A cut
    beside another ground was made before that ground was known. If nothing lawful explains it, it is moved to where both sides
    fit best.

    Args:
        stretches: stretches of one object, in order of time.
        is_explained: a function that says whether something lawful explains a change.
    """
    track, ends = stretches[0].track, [stretches[0].a, *(s.b for s in stretches)]
    while len(ends) > 2:
        gains = []
        for a, b, c in zip(ends, ends[1:], ends[2:], strict=False):
            both = Break(track.best_stretch(a, b), track.best_stretch(b, c))
            if both.is_slight:
                gains.append(-np.inf)
            elif not is_explained(both):
                gains.append(track.best_stretch(a, c).cost - both.before.cost - both.after.cost)
            else:
                gains.append(np.inf)
        worst = int(np.argmin(gains))
        if gains[worst] >= MERGE_GAIN:
            break
        del ends[worst + 1]
    for k in range(1, len(ends) - 1):
        a, b, c = ends[k - 1 : k + 2]
        before, after = track.best_stretch(a, b), track.best_stretch(b, c)
        if (before.gain or after.gain) and not is_explained(Break(before, after)):
            ends[k] = _best_cut_near(track, a, b, c)
    return [track.best_stretch(a, b) for a, b in pairwise(ends)]


def _best_cut_near(track: TrackPositions, a: int, b: int, c: int) -> int:
    """The index of a cut near b, between a and c, that is better than its neighbours, by pattern search."""
    step = FIRST_STEP
    while step:
        steps = [m for m in (b, b - step, b + step) if a + MIN_PART_POSITIONS <= m <= c - MIN_PART_POSITIONS]
        best = min(steps, key=lambda m: track.best_stretch(a, m).cost + track.best_stretch(m, c).cost)
        if best == b:
            step //= 2
        b = best
    return b


def noise_of(stretches: Iterable[TrackStretch], scales: Scales) -> float:
    """Standard deviation of each coordinate of reliable positions from their stretches (world units)."""
    every = np.concatenate(
        [np.zeros(0), *(s.residual[s.reliable] for s in stretches if len(s) > 2 * MIN_PART_POSITIONS)]
    )
    # The median distance from the mean of a normal distribution in the plane is 1.18 standard deviations.
    first, least = FIRST_NOISE_WORLD * scales.size, MIN_NOISE_WORLD * scales.size
    return max(float(np.median(every)) / 1.18 if len(every) else first, least)


@cached_njit
def _best_cut(law, seconds, location, weight, noise, least):  # type: ignore[no-untyped-def]
    """The index of the first position after the best cut, and the cost of both sides (nats).

    `least` is the smallest number of positions on each side; the other arguments are those of `fit_sliding` and `costs`.
    """
    best, cost = 0, np.inf
    for k in range(least, len(seconds) - least + 1):
        total = 0.0
        for side in range(2):
            part = slice(0, k) if side == 0 else slice(k, len(seconds))
            residual = fit_sliding(law, seconds[part] - seconds[part][0], location[part], weight[part])[1]
            total += costs(residual**2, weight[part], noise).sum()
        if total < cost:
            best, cost = k, total
    return best, cost


def _cuts(track: TrackPositions, a: int, b: int) -> list[int]:
    """Indices at which the positions a to b - 1 are cut, in ascending order."""
    if b - a < 2 * MIN_PART_POSITIONS:
        return []
    seconds, location, weight = track.frames[a:b] * track.frame_seconds, track.location[a:b], track.weight[a:b]
    k, cost = _best_cut(track.law, seconds, location, weight, track.noise, MIN_PART_POSITIONS)
    if track.stretch(a, b).cost - cost < CUT_GAIN:
        return []
    return [*_cuts(track, a, a + k), a + k, *_cuts(track, a + k, b)]
