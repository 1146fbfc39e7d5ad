"""Stretches of free sliding: positions of a track that one law of deceleration explains, on CLEVRER's ground or another one.

Costs are negative log likelihoods of Student's t distribution, in nats: few positions are much worse than the others.
"""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from nsdr.dynamics.numba_cache import cached_njit
from nsdr.dynamics.stretch import CLEVRERS_GROUND, Ground, Stretch, fit_stretch, sliding_positions
from nsdr.validation import FloatArray
from nsdr.world.physics_constants import FRAME_SECONDS

DEGREES_OF_FREEDOM = 4.0
"""Of the distribution of positions."""
CUT_GAIN = 20.0
"""A cut, or another ground, explains positions better than chance if it gains more (nats)."""
MIN_PART_POSITIONS = 4
"""Fewest positions on either side of a cut."""
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


@dataclass(frozen=True, eq=False)
class Positions:
    """The detected positions of an object, and its stretches.

    Attributes:
        i: the object.
        shape: "cube", "sphere" or "cylinder".
        frames: (N,) in which it was detected.
        location: (N, 2) (world units).
        weight: (N,) 1 for reliable positions.
        noise: standard deviation of reliable positions (world units).
        known_ground: whether the ground is known to be CLEVRER's.
        rough: stretches of `rough_stretch`.
    """

    i: int
    shape: str
    frames: NDArray[np.int64]
    location: FloatArray
    weight: FloatArray
    noise: float
    known_ground: bool
    rough: "dict[tuple[int, int], TrackStretch]" = field(default_factory=dict, init=False, repr=False)

    def stretch(self, a: int, b: int) -> "TrackStretch":
        """The positions a to b - 1 as one stretch on CLEVRER's ground."""
        fit = fit_stretch(self.shape, self.frames[a:b], self.location[a:b], self.weight[a:b])
        cost = float(costs(fit.residual**2, fit.weight, self.noise).sum())
        return self._stretch(a, b, fit.motion, fit.residual, cost, CLEVRERS_GROUND)

    def rough_stretch(self, a: int, b: int) -> "TrackStretch":
        """The same with another ground for a while, whichever explains it best."""
        if (a, b) not in self.rough:
            self.rough[a, b] = self._rough_stretch(a, b)
        return self.rough[a, b]

    def _rough_stretch(self, a: int, b: int) -> "TrackStretch":
        lawful = self.stretch(a, b)
        tells = self._seconds(a, b)[-1] > MIN_ROUGH_SECONDS and lawful.speed > MIN_SPEED_WORLD_PER_S
        if self.known_ground or not tells or lawful.cost < CUT_GAIN:
            return lawful
        lawful = self._on_other_ground(lawful, -SPIN_RELIEF[lawful.shape], MIN_EXTRA)
        rough = self._on_other_ground(lawful, -MAX_EXTRA, MAX_EXTRA)
        gain = lawful.reliable_cost - rough.reliable_cost
        is_lawful = -SPIN_RELIEF[lawful.shape] <= rough.ground.extra <= MIN_EXTRA
        return lawful if is_lawful or gain < CUT_GAIN else replace(rough, gain=gain)

    def _on_other_ground(self, lawful: "TrackStretch", low: float, high: float) -> "TrackStretch":
        """The same with a ground that slows down by `low` to `high` more for a while."""
        a, b = lawful.a, lawful.b
        seconds, location, weight = self._seconds(a, b), self.location[a:b], self.weight[a:b]
        total = float(seconds[-1])

        def unpacked(values: FloatArray) -> tuple[FloatArray, Ground]:
            extra, onset, duration = values[4:].tolist()
            return values[:4], Ground(extra, onset, onset + duration)

        def error(values: FloatArray) -> FloatArray:
            """Whose squares are twice the cost."""
            off = location - sliding_positions(self.shape, *unpacked(values), seconds)
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
        residual = np.linalg.norm(location - sliding_positions(self.shape, motion, ground, seconds), axis=1)
        return self._stretch(a, b, motion, residual, float(best.cost), ground)

    def _stretch(
        self, a: int, b: int, motion: FloatArray, residual: FloatArray, cost: float, ground: Ground
    ) -> "TrackStretch":
        of_positions = self.shape, self.frames[a:b], self.weight[a:b]
        return TrackStretch(*of_positions, motion, residual, ground, track=self, a=a, b=b, cost=cost)

    def _seconds(self, a: int, b: int) -> FloatArray:
        return np.asarray((self.frames[a:b] - self.frames[a]) * FRAME_SECONDS)


@dataclass(frozen=True, eq=False, kw_only=True)
class TrackStretch(Stretch):
    """A stretch of a track, and how well it explains the positions.

    Attributes:
        track: the object's positions.
        a, b: the stretch is of the positions a to b - 1.
        cost: of the fit (nats).
        gain: how much better its ground explains the reliable positions than a lawful one, which slows down less what spins
            (nats); 0 where the ground is lawful.
    """

    track: Positions
    a: int
    b: int
    cost: float
    gain: float = 0.0

    @property
    def rough_frames(self) -> tuple[int, int]:
        """The first frame on another ground, and the one after the last."""
        first, last = (self.start + round(s / FRAME_SECONDS) for s in self.ground[1:])
        return first, min(last, self.last) + 1

    @property
    def reliable_cost(self) -> float:
        """Cost of the reliable positions alone: errors of the others are alike, so that many of them say no more than one."""
        return float(costs(self.residual[self.reliable] ** 2, np.ones(self.reliable.sum()), self.track.noise).sum())

    def parts(self, frame: float) -> "tuple[TrackStretch, TrackStretch] | None":
        """The stretches before and after a frame; None where one has too few positions."""
        k = self.a + int(np.searchsorted(self.frames, frame))
        if min(k - self.a, self.b - k) < MIN_PART_POSITIONS:
            return None
        fit = self.track.rough_stretch if self.gain else self.track.stretch
        return fit(self.a, k), fit(k, self.b)


@cached_njit
def costs(squares, weight, noise):  # type: ignore[no-untyped-def]
    """Negative log likelihoods (N,) of squared distances (N,) from a fit, up to a constant."""
    return np.log1p(weight * squares / (DEGREES_OF_FREEDOM * noise**2)) * ((DEGREES_OF_FREEDOM + 2) / 2)
