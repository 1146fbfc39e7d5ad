"""Where a track is cut into stretches of free sliding, and the changes of motion there.

A stretch (`nsdr.laws.stretches`) is cut in two where that explains its positions better than chance would (a
generalised likelihood ratio), over and over.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from nsdr.dynamics.motion_states import UNRELIABLE_WEIGHT, MotionStates
from nsdr.dynamics.numba_cache import cached_njit
from nsdr.dynamics.sliding import fit_sliding
from nsdr.laws.stretches import CUT_GAIN, MIN_PART_POSITIONS, Positions, TrackStretch, costs
from nsdr.validation import FloatArray
from nsdr.world.camera import HEIGHT_PX, WIDTH_PX
from nsdr.world.physics_constants import FRAME_SECONDS
from nsdr.world.vocabulary import SHAPES

MIN_NOISE_WORLD, FIRST_NOISE_WORLD = 0.004, 0.005
"""Least standard deviation of positions, which is measured in each video; with the second one, stretches are first cut to do so
(world units)."""
MERGE_GAIN = 6.0
"""Stretches between which no contact is are joined again where one on another ground is worse than both by less (nats): chosen
on the training suites of docs/judge.md."""
FIRST_STEP = 8
"""Cuts beside another ground are moved by so much at first, where both sides then fit better (positions)."""
MIN_EVIDENCE = 4.0
"""Less evidence is none (nats)."""
SURE_FRAMES = 8
"""Fewest positions on either side of a cut that cannot be of another object."""
BORDER_PX = 10.0
"""Positions of objects whose box is nearer to the border are not reliable: official proposals are off there (pixels)."""
PLACE_NOISE_WORLD = {"cube": 0.015, "cylinder": 0.006, "sphere": 0.006}
VELOCITY_NOISE = {"cube": 0.06, "cylinder": 0.03, "sphere": 0.03}
"""Standard deviations of a change's place and velocity beside what the positions say (world units, world units/s): cubes turn,
and their outline with them."""
HIDDEN_NOISE_WORLD = 0.04
"""As `PLACE_NOISE_WORLD`, where an object is hidden, if only in part, for more than `JUMP_FRAMES` (world units): of 193 such
changes in lawful videos of `train` one in fifty seems a jump of more than 0.086, the largest of 0.17 (`python
-m benchmarks.violations --lawful PROPOSALS_TRAIN.npz --every 48 --first 5 --jumps`)."""
JUMP_FRAMES = 6
"""After more frames without a reliable position, where an object is tells less of a jump; after more without any position,
nothing where a visible object can have hit it."""
SLIGHT_WORLD, SLIGHT_WORLD_PER_S = 0.015, 0.08
"""Smaller changes of place and velocity are none (world units, world units/s)."""
SEEN_GAP_FRAMES = 3
"""A change is seen as it happens when the reliable positions beside it are so near to each other (frames)."""
MIN_MARGIN_FRAMES, MAX_MARGIN_FRAMES = 0.3, 1.2
"""A change happens at most so long before or after the moment at which it seems to (frames)."""


class MotionChange(NamedTuple):
    """A change of place (world units) or velocity (world units/s), and the evidence of it (nats)."""

    size: float
    nats: float


@dataclass(frozen=True, eq=False)
class Break:
    """A change of an object's motion between two stretches."""

    before: TrackStretch
    after: TrackStretch

    @property
    def i(self) -> int:
        """The object."""
        return self.before.track.i

    @cached_property
    def frame(self) -> float:
        """When both are nearest to each other, between their positions or a frame beside them."""
        low, high = self.before.last - 1, self.after.start + 1
        frames = np.linspace(low, high, 4 * (high - low) + 1)
        return float(
            frames[np.linalg.norm(self.before.position_at(frames) - self.after.position_at(frames), axis=1).argmin()]
        )

    @cached_property
    def seen(self) -> tuple[int, int]:
        """The frames of the nearest reliable positions before and after it; without one, the ends of the two stretches."""
        before, after = (s.frames[s.reliable] for s in (self.before, self.after))
        return int(before[-1] if len(before) else self.before.start), int(after[0] if len(after) else self.after.last)

    @property
    def hidden_frames(self) -> int:
        """Number of frames between the nearest reliable positions."""
        return self.seen[1] - self.seen[0]

    @property
    def missing_frames(self) -> int:
        """Number of frames between the nearest positions, reliable or not."""
        return self.after.start - self.before.last

    @cached_property
    def window(self) -> FloatArray:
        """Frames at which it may happen, half a frame apart: around where both stretches meet, or while it is not seen."""
        low, high, margin = float(self.seen[0]), float(self.seen[1]), MAX_MARGIN_FRAMES
        if self.hidden_frames <= SEEN_GAP_FRAMES:
            error = self.position_variance**0.5 / max(float(np.hypot(*self.change)) * FRAME_SECONDS, 1e-9)
            low, high, margin = self.frame, self.frame, MIN_MARGIN_FRAMES + min(3 * error, MAX_MARGIN_FRAMES)
        low, high = min(low, self.frame) - margin, max(high, self.frame) + margin
        return np.linspace(low, high, 2 + round(2 * (high - low)))

    @property
    def is_sure(self) -> bool:
        """Whether both stretches are long enough to tell."""
        return min(len(self.before), len(self.after)) >= SURE_FRAMES

    @cached_property
    def place(self) -> FloatArray:
        """(2,) where it happens (world units)."""
        return np.asarray(self.before.position_at(np.array([self.frame]))[0])

    @cached_property
    def change(self) -> FloatArray:
        """(2,) change of the velocity (world units/s)."""
        at = np.array([self.frame])
        return np.asarray((self.after.velocity_at(at) - self.before.velocity_at(at))[0])

    @property
    def position_variance(self) -> float:
        """Variance of each coordinate of the difference of the places before and after it (world units²)."""
        at = np.array([self.frame])
        return float(sum(s.position_variance(at, s.track.noise)[0] for s in (self.before, self.after)))

    def jump(self) -> MotionChange:
        """The change of the place."""
        size = float(np.hypot(*(self.after.position_at(np.array([self.frame]))[0] - self.place)))
        noise = HIDDEN_NOISE_WORLD if self.hidden_frames > JUMP_FRAMES else PLACE_NOISE_WORLD[self.before.shape]
        return MotionChange(size, size**2 / (2 * (self.position_variance + noise**2)))

    def kick(self) -> MotionChange:
        """The change of the velocity."""
        size, noise = float(np.hypot(*self.change)), VELOCITY_NOISE[self.before.shape]
        variance = sum(s.velocity_variance(s.track.noise) for s in (self.before, self.after))
        return MotionChange(size, size**2 / (2 * (variance + noise**2)))

    @property
    def is_doubtful(self) -> bool:
        """Whether the positions hardly say that anything changes."""
        return max(self.jump().nats, self.kick().nats) < MIN_EVIDENCE

    @property
    def is_slight(self) -> bool:
        """Whether nothing changes but some positions that are off, as in the frames of a contact."""
        return self.jump().size < SLIGHT_WORLD and self.kick().size < SLIGHT_WORLD_PER_S


def positions_of(states: MotionStates, i: int, noise: float, known_ground: bool) -> Positions:
    """The detected positions of object i.

    Args:
        states: the tracks.
        i: the object.
        noise: standard deviation of reliable positions (world units).
        known_ground: whether the ground is known to be CLEVRER's.
    """
    frames = np.flatnonzero(states.detected[i])
    box = states.box_xyxy_px[i, frames]
    near_border = ((box[:, :2] < BORDER_PX) | (np.array([WIDTH_PX, HEIGHT_PX]) - box[:, 2:] < BORDER_PX)).any(1)
    weight = np.where(near_border, UNRELIABLE_WEIGHT, states.weight[i, frames])
    return Positions(i, states.objects[i].shape, frames, states.location_world[i, frames], weight, noise, known_ground)


def cut(track: Positions) -> list[TrackStretch]:
    """The stretches of an object's track, in order of time."""
    ends = [0, *_cuts(track, 0, len(track.frames)), len(track.frames)]
    return [track.rough_stretch(a, b) for a, b in pairwise(ends)]


def merge(stretches: Sequence[TrackStretch], is_explained: Callable[[Break], bool]) -> list[TrackStretch]:
    """The stretches without the cuts that say nothing.

    Slight cuts are undone, and those that nothing lawful explains where one stretch fits as well. Cuts beside another ground,
    which were made before that was known, are moved to where both sides fit best if nothing lawful explains them.

    Args:
        stretches: of one object, in order of time.
        is_explained: whether something lawful explains a change between two stretches.
    """
    track, ends = stretches[0].track, [stretches[0].a, *(s.b for s in stretches)]
    while len(ends) > 2:
        gains = []
        for a, b, c in zip(ends, ends[1:], ends[2:], strict=False):
            both = Break(track.rough_stretch(a, b), track.rough_stretch(b, c))
            if both.is_slight:
                gains.append(-np.inf)
            elif not is_explained(both):
                gains.append(track.rough_stretch(a, c).cost - both.before.cost - both.after.cost)
            else:
                gains.append(np.inf)
        worst = int(np.argmin(gains))
        if gains[worst] >= MERGE_GAIN:
            break
        del ends[worst + 1]
    for k in range(1, len(ends) - 1):
        a, b, c = ends[k - 1 : k + 2]
        before, after = track.rough_stretch(a, b), track.rough_stretch(b, c)
        if (before.gain or after.gain) and not is_explained(Break(before, after)):
            ends[k] = _best_cut_near(track, a, b, c)
    return [track.rough_stretch(a, b) for a, b in pairwise(ends)]


def _best_cut_near(track: Positions, a: int, b: int, c: int) -> int:
    """The best cut between a and c, or one near b that is better than its neighbours (a pattern search)."""
    step = FIRST_STEP
    while step:
        steps = [m for m in (b, b - step, b + step) if a + MIN_PART_POSITIONS <= m <= c - MIN_PART_POSITIONS]
        best = min(steps, key=lambda m: track.rough_stretch(a, m).cost + track.rough_stretch(m, c).cost)
        if best == b:
            step //= 2
        b = best
    return b


def noise_of(stretches: Iterable[TrackStretch]) -> float:
    """Standard deviation of each coordinate of the reliable positions around the stretches (world units)."""
    every = np.concatenate(
        [np.zeros(0), *(s.residual[s.reliable] for s in stretches if len(s) > 2 * MIN_PART_POSITIONS)]
    )
    # The median distance of a normal distribution in the plane is 1.18 standard deviations.
    return max(float(np.median(every)) / 1.18 if len(every) else FIRST_NOISE_WORLD, MIN_NOISE_WORLD)


@cached_njit
def _best_cut(shape, seconds, location, weight, noise, least):  # type: ignore[no-untyped-def]
    """Index of the first position after the best cut, and the cost of both sides."""
    best, cost = 0, np.inf
    for k in range(least, len(seconds) - least + 1):
        total = 0.0
        for side in range(2):
            part = slice(0, k) if side == 0 else slice(k, len(seconds))
            residual = fit_sliding(shape, seconds[part] - seconds[part][0], location[part], weight[part])[1]
            total += costs(residual**2, weight[part], noise).sum()
        if total < cost:
            best, cost = k, total
    return best, cost


def _cuts(track: Positions, a: int, b: int) -> list[int]:
    """Where to cut the positions a to b - 1, in ascending order."""
    if b - a < 2 * MIN_PART_POSITIONS:
        return []
    seconds, location, weight = track.frames[a:b] * FRAME_SECONDS, track.location[a:b], track.weight[a:b]
    k, cost = _best_cut(SHAPES.index(track.shape), seconds, location, weight, track.noise, MIN_PART_POSITIONS)
    if track.stretch(a, b).cost - cost < CUT_GAIN:
        return []
    return [*_cuts(track, a, a + k), a + k, *_cuts(track, a + k, b)]
