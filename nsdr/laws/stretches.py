"""Stretches of free sliding: positions of a track that one law of deceleration explains, on the world's ground or another.

Costs are negative log-likelihoods under Student's t distribution (nats), because a few positions are much worse than the
others.
"""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from nsdr.dynamics.numba_cache import cached_njit
from nsdr.dynamics.sliding import Law
from nsdr.dynamics.stretch import WORLDS_GROUND, Ground, Stretch, fit_stretch, sliding_positions
from nsdr.validation import FloatArray
from nsdr.world.vocabulary import CLEVRER, Shape
from nsdr.world.world import CLEVRER_WORLD, Scales

DEGREES_OF_FREEDOM = 4.0
"""Degrees of freedom of Student's t distribution of positions around a fit."""
CUT_GAIN = 20.0
"""A cut, or another ground, explains positions better than chance if it lowers the cost by more than this (nats)."""
MIN_PART_POSITIONS = 4
"""Smallest number of positions on each side of a cut."""
MIN_SPEED_WORLD_PER_S = 0.15
"""A slower object gives no information about the ground (world units/s in CLEVRER)."""
MAX_EXTRA, FIRST_SHARE = 2.4, 0.1
"""Largest deceleration of another ground in addition to the world's (world units/s² in CLEVRER), and the share of the largest
from which fits start."""
MIN_EXTRA = 0.08
"""Smaller additional decelerations are errors of the fit where an object comes to rest (world units/s² in CLEVRER)."""
SPIN_RELIEF = 0.2
"""By how much the deceleration of a spinning object may be smaller, as friction acts against both motions (world units/s² for
CLEVRER's friction). It is `MIN_EXTRA` at least."""
CLEVRERS_FRICTION = CLEVRER.shapes[0].friction * CLEVRER_WORLD.physics.gravity
"""Deceleration of CLEVRER's cubes and cylinders by friction (world units/s²)."""
MIN_OTHER_GROUND_SECONDS = 0.28
"""Shortest duration of sliding on another ground (s): ten frames of CLEVRER. In less time its effect cannot be distinguished
from a push. Chosen on the training suites of docs/judge.md."""
LEAST_SQUARES: Any = {"x_scale": (0.01, 0.01, 0.05, 0.05, 0.2, 0.1, 0.1), "max_nfev": 100}
"""Options of the fit of another ground: scales of position, velocity, deceleration, its start and its duration; largest number
of evaluations."""


@dataclass(frozen=True, eq=False)
class TrackPositions:
    """The detected positions of an object, to which stretches are fitted.

    Attributes:
        i: id of the object.
        shape: the object's shape.
        law: how it slides.
        scales: of its world.
        frames: (N,) int, frames in which the object was detected.
        location: (N, 2) detected positions (world units).
        weight: (N,) weights of the positions in fits; 1 for reliable ones.
        noise: standard deviation of each coordinate of reliable positions (world units).
        known_ground: whether the ground is known to be the world's.
        best_stretches: results of `best_stretch`, which are computed once.
    """

    i: int
    shape: Shape
    law: Law
    scales: Scales
    frames: NDArray[np.int64]
    location: FloatArray
    weight: FloatArray
    noise: float
    known_ground: bool
    best_stretches: "dict[tuple[int, int], TrackStretch]" = field(default_factory=dict, init=False, repr=False)

    def stretch(self, a: int, b: int) -> "TrackStretch":
        """Fit one stretch on the world's ground to the positions a to b - 1."""
        fit = fit_stretch(self.law, self.frames[a:b], self.location[a:b], self.weight[a:b])
        cost = float(costs(fit.residual**2, fit.weight, self.noise).sum())
        return self._stretch(a, b, fit.motion, fit.residual, cost, WORLDS_GROUND)

    def best_stretch(self, a: int, b: int) -> "TrackStretch":
        """Fit one stretch to the positions a to b - 1, on the world's ground or on the other ground that explains them best."""
        if (a, b) not in self.best_stretches:
            self.best_stretches[a, b] = self._best_stretch(a, b)
        return self.best_stretches[a, b]

    def _best_stretch(self, a: int, b: int) -> "TrackStretch":
        """Compute `best_stretch`."""
        lawful = self.stretch(a, b)
        is_fast = lawful.speed > MIN_SPEED_WORLD_PER_S * self.scales.speed
        tells = self._seconds(a, b)[-1] > MIN_OTHER_GROUND_SECONDS and is_fast
        if self.known_ground or not tells or lawful.cost < CUT_GAIN:
            return lawful
        least, most = MIN_EXTRA * self.scales.gravity, MAX_EXTRA * self.scales.gravity
        relief = max(SPIN_RELIEF * float(self.law["deceleration"]) / CLEVRERS_FRICTION, least)
        lawful = self._on_other_ground(lawful, -relief, least)
        rough = self._on_other_ground(lawful, -most, most)
        gain = lawful.reliable_cost - rough.reliable_cost
        is_lawful = -relief <= rough.ground.extra <= least
        return lawful if is_lawful or gain < CUT_GAIN else replace(rough, gain=gain)

    def _on_other_ground(self, lawful: "TrackStretch", low: float, high: float) -> "TrackStretch":
        """Fit a stretch whose ground has an additional deceleration from `low` to `high` for a while.

        Args:
            lawful: the stretch on the world's ground, from which the fit starts.
            low: smallest additional deceleration (world units/s²).
            high: largest additional deceleration (world units/s²).
        """
        a, b = lawful.a, lawful.b
        seconds, location, weight = self._seconds(a, b), self.location[a:b], self.weight[a:b]
        total = float(seconds[-1])

        def unpacked(values: FloatArray) -> tuple[FloatArray, Ground]:
            """Motion (4,) and ground from the fitted values (7,)."""
            extra, onset, duration = values[4:].tolist()
            return values[:4], Ground(extra, onset, onset + duration)

        def error(values: FloatArray) -> FloatArray:
            """Errors (2 N,) of the positions, whose squares sum to twice the cost."""
            off = location - sliding_positions(self.law, *unpacked(values), seconds)
            squares = (off**2).sum(1)
            share = np.sqrt(2 * costs(squares, weight, self.noise) / np.maximum(squares, 1e-24))
            return np.asarray((off * share[:, None]).ravel())

        shortest = MIN_OTHER_GROUND_SECONDS
        bounds = [-np.inf] * 4 + [low, 0.0, shortest], [np.inf] * 4 + [high, total - shortest, total]
        # If the object comes to rest, its last positions give no information about the ground, so two onsets are tried.
        onsets = 0.0, (total - shortest) / 2
        starts = [[*lawful.motion, high * FIRST_SHARE, onset, total - onset] for onset in onsets]
        fits = [least_squares(error, start, bounds=bounds, **LEAST_SQUARES) for start in starts]
        best = min(fits, key=lambda fit: float(fit.cost))
        motion, ground = unpacked(best.x)
        residual = np.linalg.norm(location - sliding_positions(self.law, motion, ground, seconds), axis=1)
        return self._stretch(a, b, motion, residual, float(best.cost), ground)

    def _stretch(
        self, a: int, b: int, motion: FloatArray, residual: FloatArray, cost: float, ground: Ground
    ) -> "TrackStretch":
        """The stretch of the positions a to b - 1 with a fit."""
        of_positions = self.law, self.frames[a:b], self.weight[a:b]
        return TrackStretch(*of_positions, motion, residual, ground, track=self, a=a, b=b, cost=cost)

    def _seconds(self, a: int, b: int) -> FloatArray:
        """(N,) times of the positions a to b - 1 after the first of them (s)."""
        return np.asarray((self.frames[a:b] - self.frames[a]) * self.frame_seconds)

    @property
    def frame_seconds(self) -> float:
        """Time between two frames (s)."""
        return float(self.law["frame_seconds"])


@dataclass(frozen=True, eq=False, kw_only=True)
class TrackStretch(Stretch):
    """A stretch of a track, and how well it explains the positions.

    Attributes:
        track: all positions of the object.
        a, b: the stretch was fitted to the positions a to b - 1 of the track.
        cost: cost of the fit (nats).
        gain: by how much the cost of the reliable positions is lower than on a lawful ground (nats); 0 if the ground is lawful.
            A lawful ground is the world's, which may slow down a spinning object less.
    """

    track: TrackPositions
    a: int
    b: int
    cost: float
    gain: float = 0.0

    @property
    def shape(self) -> Shape:
        """The object's shape."""
        return self.track.shape

    @property
    def other_ground_frames(self) -> tuple[int, int]:
        """The first frame on the other ground, and the frame after the last."""
        first, last = (self.start + round(s / self.track.frame_seconds) for s in self.ground[1:])
        return first, min(last, self.last) + 1

    @property
    def reliable_cost(self) -> float:
        """Cost of the reliable positions (nats). The others have correlated errors, so many give no more evidence than one."""
        return float(costs(self.residual[self.reliable] ** 2, np.ones(self.reliable.sum()), self.track.noise).sum())

    def parts(self, frame: float) -> "tuple[TrackStretch, TrackStretch] | None":
        """Fits to the positions before and after a frame; None if there are too few on one side."""
        k = self.a + int(np.searchsorted(self.frames, frame))
        if min(k - self.a, self.b - k) < MIN_PART_POSITIONS:
            return None
        fit = self.track.best_stretch if self.gain else self.track.stretch
        return fit(self.a, k), fit(k, self.b)


@cached_njit
def costs(squares, weight, noise):  # type: ignore[no-untyped-def]
    """Negative log-likelihoods (N,) of squared distances (N,) from a fit, up to a constant (nats).

    cost = (ν + 2) / 2 · log(1 + weight · distance² / (ν · noise²)) with ν = `DEGREES_OF_FREEDOM`, for two coordinates
    """
    return np.log1p(weight * squares / (DEGREES_OF_FREEDOM * noise**2)) * ((DEGREES_OF_FREEDOM + 2) / 2)
