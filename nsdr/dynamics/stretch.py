"""A stretch of free sliding: the motion fitted to an object's positions between two changes, and how exactly it is known."""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from nsdr.dynamics.sliding import fit_one, slide_roughly
from nsdr.validation import BoolArray, FloatArray
from nsdr.world.physics_constants import FRAME_SECONDS
from nsdr.world.vocabulary import SHAPES

HIDDEN_SHARE = 0.02
"""How much of the weight of unreliable positions counts for the errors of a stretch: their own errors are alike, so many of
them say little more than one."""


class Ground(NamedTuple):
    """The ground on which an object slides.

    Attributes:
        extra: how much more than CLEVRER's ground it slows the object down for a while (world units/s²).
        onset: when it starts to, after the first position (s).
        end: when it ceases to (s).
    """

    extra: float
    onset: float
    end: float


CLEVRERS_GROUND = Ground(0.0, 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class Stretch:
    """Free sliding that was fitted to positions of an object.

    Attributes:
        shape: "cube", "sphere" or "cylinder".
        frames: (N,) int, frames of the positions, ascending.
        weight: (N,) float, weight of each position in the fit; 1 for reliable ones.
        motion: (4,) fitted position and velocity at the first of the frames (world units, world units/s).
        residual: (N,) distances of the positions from the fit (world units).
        ground: the ground on which the object slides.
        at_rest: whether the object is known to rest, so that its velocity has no error.
    """

    shape: str
    frames: NDArray[np.int64]
    weight: FloatArray
    motion: FloatArray
    residual: FloatArray
    ground: Ground = CLEVRERS_GROUND
    at_rest: bool = False

    def __len__(self) -> int:
        return len(self.frames)

    @cached_property
    def start(self) -> int:
        """The first frame."""
        return int(self.frames[0])

    @cached_property
    def last(self) -> int:
        """The last frame."""
        return int(self.frames[-1])

    @cached_property
    def speed(self) -> float:
        """Speed at the first frame (world units/s)."""
        return float(np.hypot(*self.motion[2:]))

    @property
    def reliable(self) -> BoolArray:
        """(N,) whether each position is reliable."""
        return np.asarray(self.weight == 1)

    @property
    def median_residual(self) -> float:
        """Weighted median of the residuals (world units)."""
        order = np.argsort(self.residual)
        share = np.cumsum(self.weight[order]) / max(float(self.weight.sum()), 1e-9)
        return float(self.residual[order[min(int(np.searchsorted(share, 0.5)), len(order) - 1)]])

    def place(self, frames: FloatArray) -> FloatArray:
        """(F, 2) positions at frames (F,) in ascending order (world units)."""
        return place(self.shape, self.motion, self.ground, (frames - self.start) * FRAME_SECONDS)

    def velocity(self, frames: FloatArray) -> FloatArray:
        """(F, 2) velocities at frames (F,) in ascending order (world units/s)."""
        seconds = (np.asarray(frames, float) - self.start) * FRAME_SECONDS
        speeds = slide_roughly(SHAPES.index(self.shape), self.speed, seconds, *self.ground)[1]
        return np.asarray(speeds[:, None] * self.motion[2:] / max(self.speed, 1e-9))

    @cached_property
    def _spread(self) -> tuple[float, float, float]:
        """Total weight of the positions, their weighted mean frame, and the weighted sum of squares about it (s²)."""
        weight = np.where(self.reliable, 1.0, HIDDEN_SHARE * self.weight)
        middle = float(weight @ self.frames / weight.sum())
        return float(weight.sum()), middle, float(weight @ ((self.frames - middle) * FRAME_SECONDS) ** 2)

    @property
    def middle_frame(self) -> float:
        """The frame at which errors of place and velocity are independent."""
        return self._spread[1]

    def middle_variance(self, noise_world: float) -> float:
        """Variance of each coordinate of the place at the middle frame, if positions have this standard deviation."""
        return noise_world**2 / self._spread[0]

    def velocity_variance(self, noise_world: float) -> float:
        """Variance of each component of the velocity."""
        return 0.0 if self.at_rest else noise_world**2 / max(self._spread[2], 1e-9)

    def place_variance(self, frames: FloatArray, noise_world: float) -> FloatArray:
        """(F,) variances of each coordinate of the places at frames (F,): those of a least-squares line."""
        since_middle = (frames - self.middle_frame) * FRAME_SECONDS
        return self.middle_variance(noise_world) + self.velocity_variance(noise_world) * since_middle**2


def fit_stretch(shape: str, frames: NDArray[np.int64], location_world: FloatArray, weight: FloatArray) -> Stretch:
    """Free sliding on CLEVRER's ground, fitted robustly.

    Args:
        shape: "cube", "sphere" or "cylinder".
        frames: (N,) ascending frames.
        location_world: (N, 2) measured positions (world units).
        weight: (N,) weight of each position, 0-1.
    """
    # The motion is that of the first frame, since what rests for long must not have moved before.
    seconds = np.asarray((frames - frames[0]) * FRAME_SECONDS)
    location, weight = np.ascontiguousarray(location_world, float), np.ascontiguousarray(weight, float)
    motion, residual = fit_one(SHAPES.index(shape), seconds, location, weight)
    return Stretch(shape, frames, weight, motion, residual)


def place(shape: str, motion: FloatArray, ground: Ground, seconds: FloatArray) -> FloatArray:
    """(N, 2) positions at seconds (N,) in ascending order, with position and velocity (4,) at second 0."""
    speed = float(np.hypot(motion[2], motion[3]))
    distance = slide_roughly(SHAPES.index(shape), speed, np.asarray(seconds, float), *ground)[0]
    return np.asarray(motion[:2] + distance[:, None] * motion[2:4] / max(speed, 1e-9))
