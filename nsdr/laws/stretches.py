"""Stretches of free sliding: positions of a track that one law of deceleration explains, on CLEVRER's ground or another one.

Costs are negative log likelihoods of Student's t distribution, in nats: few positions are much worse than the others.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from nsdr.dynamics.numba_cache import cached_njit
from nsdr.dynamics.sliding import fit_one, slide_roughly
from nsdr.validation import FloatArray
from nsdr.world.physics_constants import FRAME_SECONDS
from nsdr.world.vocabulary import SHAPES

DEGREES_OF_FREEDOM = 4.0
"""Of the distribution of positions."""
CUT_GAIN = 20.0
"""A cut, or another ground, explains positions better than chance if it gains more (nats)."""
MIN_FRAMES = 4
"""Fewest positions on either side of a cut."""
HIDDEN_SHARE = 0.02
"""Of the weight of positions that are not reliable: how much they say of a stretch's errors, as theirs are alike."""
MIN_SPEED_WORLD_PER_S = 0.15
"""Slower objects tell nothing of the ground (world units/s)."""
MAX_EXTRA, FIRST_SHARE = 2.4, 0.1
"""Largest deceleration of other grounds beyond CLEVRER's (world units/s²); fits start from this share of their largest."""
MIN_EXTRA = 0.08
"""Smaller differences of the deceleration are those of the fit, where an object comes to rest (world units/s²)."""
SPIN_RELIEF = {"cube": 0.2, "cylinder": 0.2, "sphere": MIN_EXTRA}
"""So much less slows down an object that spins, as friction acts against both motions (world units/s²)."""
MIN_ROUGH_SECONDS = 10 * FRAME_SECONDS
"""Another ground lasts at least so long: in less time it can hardly be told from a push (s). Chosen on the training
suites of docs/judge.md."""
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
class Positions:
    """Those of an object, and its stretches.

    Attributes:
        i: the object.
        shape: index into `nsdr.world.vocabulary.SHAPES`.
        frames: (N,) in which it was detected.
        location: (N, 2) (world units).
        weight: (N,) 1 for reliable positions.
        noise: standard deviation of reliable positions (world units).
        known_ground: whether the ground is known to be CLEVRER's.
        rough: stretches of `rough_stretch`.
    """

    i: int
    shape: int
    frames: NDArray[np.int64]
    location: FloatArray
    weight: FloatArray
    noise: float
    known_ground: bool
    rough: "dict[tuple[int, int], Stretch]" = field(default_factory=dict, init=False, repr=False)

    def stretch(self, a: int, b: int) -> "Stretch":
        """The positions a to b - 1 as one stretch on CLEVRER's ground."""
        # Referred to the first frame, as what rests for long must not have moved before.
        seconds, weight = self._seconds(a, b), self.weight[a:b]
        motion, residual = fit_one(self.shape, seconds, self.location[a:b], weight)
        return Stretch(self, a, b, motion, residual, float(costs(residual**2, weight, self.noise).sum()), CLEVRERS)

    def rough_stretch(self, a: int, b: int) -> "Stretch":
        """The same with another ground for a while, whichever explains it best."""
        if (a, b) not in self.rough:
            self.rough[a, b] = self._rough_stretch(a, b)
        return self.rough[a, b]

    def _rough_stretch(self, a: int, b: int) -> "Stretch":
        lawful = self.stretch(a, b)
        tells = self._seconds(a, b)[-1] > MIN_ROUGH_SECONDS and lawful.speed > MIN_SPEED_WORLD_PER_S
        if self.known_ground or not tells or lawful.cost < CUT_GAIN:
            return lawful
        lawful = self._on_other_ground(lawful, -SPIN_RELIEF[lawful.shape], MIN_EXTRA)
        rough = self._on_other_ground(lawful, -MAX_EXTRA, MAX_EXTRA)
        gain = lawful.reliable_cost - rough.reliable_cost
        is_lawful = -SPIN_RELIEF[lawful.shape] <= rough.ground.extra <= MIN_EXTRA
        return lawful if is_lawful or gain < CUT_GAIN else replace(rough, gain=gain)

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
            share = np.sqrt(2 * costs(squares, weight, self.noise) / np.maximum(squares, 1e-24))
            return np.asarray((off * share[:, None]).ravel())

        bounds = [-np.inf] * 4 + [low, 0.0, MIN_ROUGH_SECONDS], [np.inf] * 4 + [high, total - MIN_ROUGH_SECONDS, total]
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
        gain: how much better that explains the reliable positions than a lawful ground, which slows down less what spins
            (nats); 0 where the ground is lawful.
    """

    track: Positions
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
        first, last = (self.start + round(s / FRAME_SECONDS) for s in self.ground[1:])
        return first, min(last, self.last) + 1

    @cached_property
    def speed(self) -> float:
        """At the first frame (world units/s)."""
        return float(np.hypot(*self.motion[2:]))

    @property
    def reliable_cost(self) -> float:
        """Of the positions that are reliable: errors of the others are alike, so that many of them say no more than one."""
        return float(costs(self.residual[self.reliable] ** 2, np.ones(self.reliable.sum()), self.track.noise).sum())

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


def _place(shape: int, motion: FloatArray, ground: Ground, seconds: FloatArray) -> FloatArray:
    """(N, 2) positions at seconds (N,), in ascending order, from position and velocity (4,) at second 0."""
    speed = float(np.hypot(motion[2], motion[3]))
    distance = slide_roughly(shape, speed, seconds, *ground)[0]
    return np.asarray(motion[:2] + distance[:, None] * motion[2:4] / max(speed, 1e-9))


@cached_njit
def costs(squares, weight, noise):  # type: ignore[no-untyped-def]
    """Negative log likelihoods (N,) of squared distances (N,) from a fit, up to a constant."""
    return np.log1p(weight * squares / (DEGREES_OF_FREEDOM * noise**2)) * ((DEGREES_OF_FREEDOM + 2) / 2)
