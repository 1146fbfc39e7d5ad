"""Tracks as stretches of free sliding, cut where the motion changes.

Between two changes an object slides freely (`nsdr.dynamics.sliding`). A stretch is cut in two where that explains its positions
so much better that chance does not (a generalised likelihood ratio), over and over. Costs are negative log likelihoods of
Student's t distribution, in nats: few positions are much worse than the others.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from nsdr.dynamics.motion_states import UNRELIABLE_WEIGHT, MotionStates
from nsdr.dynamics.numba_cache import cached_njit
from nsdr.dynamics.sliding import fit_one, slide_roughly
from nsdr.validation import FloatArray
from nsdr.world.camera import HEIGHT_PX, WIDTH_PX
from nsdr.world.physics_constants import FRAME_SECONDS
from nsdr.world.vocabulary import SHAPES

__all__ = [
    "CUT_GAIN",
    "MIN_EVIDENCE",
    "SURE_FRAMES",
    "VELOCITY_NOISE",
    "Break",
    "ObjectStretches",
    "Stretch",
    "noise_of",
]

DEGREES_OF_FREEDOM = 4.0
"""Of the distribution of positions."""
MIN_NOISE_WORLD, FIRST_NOISE_WORLD = 0.004, 0.005
"""Least standard deviation of positions, which is measured in each video; with the second one, stretches are first cut to do so
(world units)."""
CUT_GAIN, MERGE_GAIN = 20.0, 6.0
"""Stretches are cut where that gains more than the first, and joined again where one stretch on another ground is worse than
both by less than the second (nats)."""
MIN_EVIDENCE = 4.0
"""Less evidence is none (nats)."""
MIN_FRAMES, SURE_FRAMES = 4, 8
"""Fewest positions on either side of a cut, and of one that cannot be of another object."""
BORDER_PX = 10.0
"""Positions of objects whose box is nearer to the border are not reliable: official proposals are off there (pixels)."""
HIDDEN_SHARE = 0.02
"""Of the weight of positions that are not reliable: how much they say of a stretch's errors, as theirs are alike."""
PLACE_NOISE_WORLD = {"cube": 0.015, "cylinder": 0.006, "sphere": 0.006}
VELOCITY_NOISE = {"cube": 0.06, "cylinder": 0.03, "sphere": 0.03}
"""Standard deviations of a change's place and velocity beside what the positions say (world units, world units/s): cubes turn,
and their outline with them."""
SLIGHT_WORLD, SLIGHT_WORLD_PER_S = 0.015, 0.08
"""Smaller changes of place and velocity are none (world units, world units/s)."""
SEEN_GAP_FRAMES = 3
"""A change is seen as it happens when the reliable positions beside it are so near to each other (frames)."""
MIN_MARGIN_FRAMES, MAX_MARGIN_FRAMES = 0.3, 1.2
"""A change happens at most so long before or after the moment at which it seems to (frames)."""
MIN_SPEED_WORLD_PER_S = 0.15
"""Slower objects tell nothing of the ground (world units/s)."""
MAX_EXTRA, FIRST_SHARE = 2.4, 0.1
"""Largest deceleration of other grounds beyond CLEVRER's (world units/s²), and its share from which fits start."""
MIN_EXTRA = 0.08
"""Smaller differences of the deceleration are those of the fit, where an object comes to rest (world units/s²)."""
SPIN_RELIEF = {"cube": 0.2, "cylinder": 0.2, "sphere": MIN_EXTRA}
"""So much less slows down an object that spins, as friction acts against both motions (world units/s²)."""
MIN_ROUGH_SECONDS = 10 * FRAME_SECONDS
"""It lasts at least so long (s)."""
LEAST_SQUARES: Any = {"x_scale": (0.01, 0.01, 0.05, 0.05, 0.2, 0.1, 0.1), "max_nfev": 100}
"""How far the fitted values change: position, velocity, deceleration, when it starts and how long it lasts; and most steps."""


class Ground(NamedTuple):
    """On which an object slides.

    Attributes:
        extra: how much more than CLEVRER's it slows the object down for a while (world units/s²).
        onset: when it starts to, after the first position (s).
        end: when it ceases to (s).
    """

    extra: float
    onset: float
    end: float


CLEVRERS = Ground(0.0, 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class _Track:
    """An object's positions: attributes as of `Stretch`."""

    i: int
    shape: int
    frames: NDArray[np.int64]
    location: FloatArray
    weight: FloatArray
    noise: float
    is_clevrers: bool
    rough: "dict[tuple[int, int], Stretch]" = field(default_factory=dict)

    def stretch(self, a: int, b: int) -> "Stretch":
        """The positions a to b - 1 as one stretch on CLEVRER's ground."""
        # Referred to the first frame, as what rests for long must not have moved before.
        seconds, weight = self._seconds(a, b), self.weight[a:b]
        motion, residual = fit_one(self.shape, seconds, self.location[a:b], weight)
        return Stretch(self, a, b, motion, residual, float(_costs(residual**2, weight, self.noise).sum()), CLEVRERS)

    def rough_stretch(self, a: int, b: int) -> "Stretch":
        """The same with another ground for a while, whichever explains it best."""
        if (a, b) not in self.rough:
            self.rough[a, b] = self._rough_stretch(a, b)
        return self.rough[a, b]

    def _rough_stretch(self, a: int, b: int) -> "Stretch":
        lawful = self.stretch(a, b)
        tells = self._seconds(a, b)[-1] > MIN_ROUGH_SECONDS and lawful.speed > MIN_SPEED_WORLD_PER_S
        if self.is_clevrers or not tells or lawful.cost < CUT_GAIN:
            return lawful
        lawful = self._on_other_ground(lawful, -SPIN_RELIEF[lawful.shape], MIN_EXTRA)
        rough = self._on_other_ground(lawful, -MAX_EXTRA, MAX_EXTRA)
        gain = lawful.reliable_cost - rough.reliable_cost
        return replace(rough, gain=gain) if gain > CUT_GAIN else lawful

    def _on_other_ground(self, lawful: "Stretch", low: float, high: float) -> "Stretch":
        """The same with a ground that slows down by `low` to `high` more for a while."""
        a, b = lawful.a, lawful.b
        seconds, location, weight = self._seconds(a, b), self.location[a:b], self.weight[a:b]
        total = float(seconds[-1])

        def unpacked(values: FloatArray) -> tuple[FloatArray, Ground]:
            extra, onset, duration = values[4:].tolist()
            return values[:4], Ground(extra, onset, onset + duration)

        def error(values: FloatArray) -> FloatArray:
            """Whose squares are twice the cost."""
            off = location - _place(self.shape, *unpacked(values), seconds)
            squares = (off**2).sum(1)
            share = np.sqrt(2 * _costs(squares, weight, self.noise) / np.maximum(squares, 1e-24))
            return np.asarray((off * share[:, None]).ravel())

        bounds = [-np.inf] * 4 + [low, 0.0, MIN_ROUGH_SECONDS], [np.inf] * 4 + [high, total, total]
        # What rests in the end tells nothing of the ground there.
        onsets = 0.0, (total - MIN_ROUGH_SECONDS) / 2
        starts = [[*lawful.motion, high * FIRST_SHARE, onset, total - onset] for onset in onsets]
        fits = [least_squares(error, start, bounds=bounds, **LEAST_SQUARES) for start in starts]
        best = min(fits, key=lambda fit: float(fit.cost))
        motion, ground = unpacked(best.x)
        residual = np.linalg.norm(location - _place(self.shape, motion, ground, seconds), axis=1)
        return Stretch(self, a, b, motion, residual, float(best.cost), ground)

    def _seconds(self, a: int, b: int) -> FloatArray:
        return np.asarray((self.frames[a:b] - self.frames[a]) * FRAME_SECONDS)


@dataclass(frozen=True, eq=False)
class Stretch:
    """An object's free sliding between two changes.

    Attributes:
        track: its positions.
        a, b: the stretch is of the positions a to b - 1.
        motion: (4,) fitted position and velocity at the first frame (world units, world units/s).
        residual: (b - a,) distances of the positions from the fit (world units).
        cost: of the fit (nats).
        ground: on which it slides.
        gain: how much better that explains the reliable positions than CLEVRER's ground does (nats).
    """

    track: _Track
    a: int
    b: int
    motion: FloatArray
    residual: FloatArray
    cost: float
    ground: Ground
    gain: float = 0.0

    def __len__(self) -> int:
        return self.b - self.a

    @property
    def shape(self) -> str:
        return SHAPES[self.track.shape]

    @property
    def frames(self) -> NDArray[np.int64]:
        return self.track.frames[self.a : self.b]

    @property
    def reliable(self) -> NDArray[np.bool_]:
        """(b - a,), which positions are."""
        return self.track.weight[self.a : self.b] == 1

    @cached_property
    def start(self) -> int:
        return int(self.frames[0])

    @cached_property
    def last(self) -> int:
        return int(self.frames[-1])

    @property
    def rough_frames(self) -> tuple[int, int]:
        """First and last of those on another ground, counted as in slices."""
        first = self.start + round(self.ground.onset / FRAME_SECONDS)
        return first, min(max(self.start + round(self.ground.end / FRAME_SECONDS), first), self.last) + 1

    @cached_property
    def speed(self) -> float:
        """At the first frame (world units/s)."""
        return float(np.hypot(*self.motion[2:]))

    @property
    def reliable_cost(self) -> float:
        """Of the positions that are reliable: errors of the others are alike, so that many of them say no more than one."""
        return float(_costs(self.residual[self.reliable] ** 2, np.ones(self.reliable.sum()), self.track.noise).sum())

    def parts(self, frame: float) -> "tuple[Stretch, Stretch] | None":
        """Those before and after a frame; None where one has too few positions."""
        k = self.a + int(np.searchsorted(self.frames, frame))
        if min(k - self.a, self.b - k) < MIN_FRAMES:
            return None
        fit = self.track.rough_stretch if self.gain else self.track.stretch
        return fit(self.a, k), fit(k, self.b)

    def place(self, frames: FloatArray) -> FloatArray:
        """(F, 2) positions at frames (F,), in ascending order."""
        return _place(self.track.shape, self.motion, self.ground, (frames - self.start) * FRAME_SECONDS)

    def velocity(self, frame: float) -> FloatArray:
        """(2,) at a frame."""
        seconds = np.array([(frame - self.start) * FRAME_SECONDS])
        speed = slide_roughly(self.track.shape, self.speed, seconds, *self.ground)[1][0]
        return np.asarray(speed * self.motion[2:] / max(self.speed, 1e-9))

    @cached_property
    def _errors(self) -> tuple[float, float, float]:
        """Variance of the place at a middle frame, that frame, and variance of the velocity."""
        weight = np.where(self.reliable, 1.0, HIDDEN_SHARE * self.track.weight[self.a : self.b])
        middle = float(weight @ self.frames / weight.sum())
        spread = float(weight @ ((self.frames - middle) * FRAME_SECONDS) ** 2)
        return self.track.noise**2 / float(weight.sum()), middle, self.track.noise**2 / max(spread, 1e-9)

    def place_variance(self, frames: FloatArray) -> FloatArray:
        """(F,) of each coordinate at frames (F,)."""
        place, middle, velocity = self._errors
        return place + velocity * ((frames - middle) * FRAME_SECONDS) ** 2

    @property
    def velocity_variance(self) -> float:
        """Of each coordinate."""
        return self._errors[2]


class Change(NamedTuple):
    """A change of place (world units) or velocity (world units/s), and the evidence of it (nats)."""

    size: float
    nats: float


@dataclass(frozen=True, eq=False)
class Break:
    """A change of an object's motion between two stretches."""

    before: Stretch
    after: Stretch

    @property
    def i(self) -> int:
        """The object."""
        return self.before.track.i

    @cached_property
    def frame(self) -> float:
        """When both are nearest to each other, between their positions or a frame beside them."""
        low, high = self.before.last - 1, self.after.start + 1
        frames = np.linspace(low, high, 4 * (high - low) + 1)
        return float(frames[np.linalg.norm(self.before.place(frames) - self.after.place(frames), axis=1).argmin()])

    @cached_property
    def seen(self) -> tuple[int, int]:
        """The frames of the nearest reliable positions before and after it."""
        before, after = (s.frames[s.reliable] for s in (self.before, self.after))
        return int(before[-1] if len(before) else self.before.start), int(after[0] if len(after) else self.after.last)

    @property
    def hidden_frames(self) -> int:
        """Between these."""
        return self.seen[1] - self.seen[0]

    @cached_property
    def window(self) -> FloatArray:
        """Frames at which it may happen, half a frame apart: around where both stretches meet, or while it is not seen."""
        low, high, margin = float(self.seen[0]), float(self.seen[1]), MAX_MARGIN_FRAMES
        if self.hidden_frames <= SEEN_GAP_FRAMES:
            error = self._place_variance**0.5 / max(float(np.hypot(*self.change)) * FRAME_SECONDS, 1e-9)
            low, high, margin = self.frame, self.frame, MIN_MARGIN_FRAMES + min(3 * error, MAX_MARGIN_FRAMES)
        low, high = min(low, self.frame) - margin, max(high, self.frame) + margin
        return np.linspace(low, high, 2 + round(2 * (high - low)))

    @property
    def is_sure(self) -> bool:
        """Whether both stretches are long enough to tell."""
        return min(len(self.before), len(self.after)) >= SURE_FRAMES

    @cached_property
    def place(self) -> FloatArray:
        """(2,), where it happens (world units)."""
        return np.asarray(self.before.place(np.array([self.frame]))[0])

    @cached_property
    def change(self) -> FloatArray:
        """(2,), of the velocity (world units/s)."""
        return self.after.velocity(self.frame) - self.before.velocity(self.frame)

    @property
    def _place_variance(self) -> float:
        at = np.array([self.frame])
        return float(self.before.place_variance(at)[0] + self.after.place_variance(at)[0])

    def jump(self) -> Change:
        """Of the place."""
        size = float(np.hypot(*(self.after.place(np.array([self.frame]))[0] - self.place)))
        return Change(size, size**2 / (2 * (self._place_variance + PLACE_NOISE_WORLD[self.before.shape] ** 2)))

    def kick(self) -> Change:
        """Of the velocity."""
        size, noise = float(np.hypot(*self.change)), VELOCITY_NOISE[self.before.shape]
        return Change(size, size**2 / (2 * (self.before.velocity_variance + self.after.velocity_variance + noise**2)))

    @property
    def is_doubtful(self) -> bool:
        """Whether the positions hardly say that anything changes."""
        return max(self.jump().nats, self.kick().nats) < MIN_EVIDENCE

    @property
    def is_slight(self) -> bool:
        """Whether nothing changes but some positions that are off, as in the frames of a contact."""
        return self.jump().size < SLIGHT_WORLD and self.kick().size < SLIGHT_WORLD_PER_S


class ObjectStretches:
    """An object's motion, cut into stretches.

    Args:
        states: the tracks.
        i: the object.
        noise: standard deviation of reliable positions (world units).
        is_clevrers: whether the ground is CLEVRER's for sure.
    """

    def __init__(
        self, states: MotionStates, i: int, noise: float = FIRST_NOISE_WORLD, is_clevrers: bool = True
    ) -> None:
        frames = np.flatnonzero(states.detected[i])
        box = states.box_xyxy_px[i, frames]
        near_border = ((box[:, :2] < BORDER_PX) | (np.array([WIDTH_PX, HEIGHT_PX]) - box[:, 2:] < BORDER_PX)).any(1)
        weight = np.where(near_border, UNRELIABLE_WEIGHT, states.weight[i, frames])
        shape = SHAPES.index(states.objects[i].shape)
        self._track = _Track(i, shape, frames, states.location_world[i, frames], weight, noise, is_clevrers)
        self._ends = [0, *_cuts(self._track, 0, len(frames)), len(frames)]

    def stretches(self) -> list[Stretch]:
        """In order of time."""
        return [self._track.rough_stretch(a, b) for a, b in pairwise(self._ends)]

    def merge(self, is_explained: Callable[[Break], bool]) -> None:
        """Undo slight cuts, and those that no contact explains where one stretch on another ground explains the positions."""
        p = self._track
        while len(self._ends) > 2:
            gains = []
            for a, b, c in zip(self._ends, self._ends[1:], self._ends[2:], strict=False):
                both = Break(p.rough_stretch(a, b), p.rough_stretch(b, c))
                if both.is_slight:
                    gains.append(-np.inf)
                elif not is_explained(both):
                    gains.append(p.rough_stretch(a, c).cost - both.before.cost - both.after.cost)
                else:
                    gains.append(np.inf)
            worst = int(np.argmin(gains))
            if gains[worst] >= MERGE_GAIN:
                break
            del self._ends[worst + 1]


def noise_of(stretches: Iterable[Stretch]) -> float:
    """Standard deviation of each coordinate of the reliable positions around the stretches (world units)."""
    every = np.concatenate([np.zeros(0), *(s.residual[s.reliable] for s in stretches if len(s) > 2 * MIN_FRAMES)])
    # The median distance of a normal distribution in the plane is 1.18 standard deviations.
    return max(float(np.median(every)) / 1.18 if len(every) else FIRST_NOISE_WORLD, MIN_NOISE_WORLD)


def _place(shape: int, motion: FloatArray, ground: Ground, seconds: FloatArray) -> FloatArray:
    """(N, 2) positions at seconds (N,), in ascending order, from position and velocity (4,) at second 0."""
    speed = float(np.hypot(motion[2], motion[3]))
    distance = slide_roughly(shape, speed, seconds, *ground)[0]
    return np.asarray(motion[:2] + distance[:, None] * motion[2:4] / max(speed, 1e-9))


@cached_njit
def _costs(squares, weight, noise):  # type: ignore[no-untyped-def]
    """Negative log likelihoods (N,) of squared distances (N,) from a fit, up to a constant."""
    return np.log1p(weight * squares / (DEGREES_OF_FREEDOM * noise**2)) * ((DEGREES_OF_FREEDOM + 2) / 2)


@cached_njit
def _best_cut(shape, seconds, location, weight, noise, least):  # type: ignore[no-untyped-def]
    """Index of the first position after the best cut, and the cost of both sides."""
    best, cost = 0, np.inf
    for k in range(least, len(seconds) - least + 1):
        total = 0.0
        for side in range(2):
            part = slice(0, k) if side == 0 else slice(k, len(seconds))
            residual = fit_one(shape, seconds[part] - seconds[part][0], location[part], weight[part])[1]
            total += _costs(residual**2, weight[part], noise).sum()
        if total < cost:
            best, cost = k, total
    return best, cost


def _cuts(track: _Track, a: int, b: int) -> list[int]:
    """Where to cut the positions a to b - 1, in ascending order."""
    if b - a < 2 * MIN_FRAMES:
        return []
    seconds, location, weight = track.frames[a:b] * FRAME_SECONDS, track.location[a:b], track.weight[a:b]
    k, cost = _best_cut(track.shape, seconds, location, weight, track.noise, MIN_FRAMES)
    if track.stretch(a, b).cost - cost < CUT_GAIN:
        return []
    return [*_cuts(track, a, a + k), a + k, *_cuts(track, a + k, b)]
