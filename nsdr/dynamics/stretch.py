"""A stretch of free sliding: the motion fitted to the positions of an object between two changes of motion, and its errors."""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from nsdr.dynamics.sliding import Law, fit_sliding, slide_on_ground
from nsdr.validation import BoolArray, FloatArray

UNRELIABLE_SHARE = 0.02
"""The weight of unreliable positions is multiplied by this when the errors of a stretch are estimated: their errors are
correlated, so many of them give little more information than one."""


class Ground(NamedTuple):
    """The ground on which an object slides.

    Attributes:
        extra: deceleration from `onset` to `end` in addition to the world's (world units/s²).
        onset: start of the additional deceleration after the first position (s).
        end: end of the additional deceleration after the first position (s).
    """

    extra: float
    onset: float
    end: float


WORLDS_GROUND = Ground(0.0, 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class Stretch:
    """Free sliding fitted to positions of one object.

    Attributes:
        law: how the object slides.
        frames: (N,) int, frames of the positions in ascending order.
        weight: (N,) float, weight of each position in the fit; 1 for reliable ones.
        motion: (4,) fitted position and velocity in the first of the frames (world units, world units/s).
        residual: (N,) distance of each position from the fit (world units).
        ground: ground on which the object slides.
        at_rest: whether the object is known to be at rest, so that its velocity has no error.
    """

    law: Law
    frames: NDArray[np.int64]
    weight: FloatArray
    motion: FloatArray
    residual: FloatArray
    ground: Ground = WORLDS_GROUND
    at_rest: bool = False

    def __len__(self) -> int:
        return len(self.frames)

    @cached_property
    def _frame_seconds(self) -> float:
        return float(self.law["frame_seconds"])

    @cached_property
    def start(self) -> int:
        """The first frame of the stretch."""
        return int(self.frames[0])

    @cached_property
    def last(self) -> int:
        """The last frame of the stretch."""
        return int(self.frames[-1])

    @cached_property
    def speed(self) -> float:
        """Speed in the first frame (world units/s)."""
        return float(np.hypot(*self.motion[2:]))

    @property
    def reliable(self) -> BoolArray:
        """(N,) bool, whether each position is reliable."""
        return np.asarray(self.weight == 1)

    @property
    def median_residual(self) -> float:
        """Weighted median of the residuals (world units)."""
        order = np.argsort(self.residual)
        share = np.cumsum(self.weight[order]) / max(float(self.weight.sum()), 1e-9)
        return float(self.residual[order[min(int(np.searchsorted(share, 0.5)), len(order) - 1)]])

    def position_at(self, frames: FloatArray) -> FloatArray:
        """(F, 2) positions at frames (F,) in ascending order (world units)."""
        return sliding_positions(self.law, self.motion, self.ground, (frames - self.start) * self._frame_seconds)

    def velocity_at(self, frames: FloatArray) -> FloatArray:
        """(F, 2) velocities at frames (F,) in ascending order (world units/s)."""
        seconds = (np.asarray(frames, float) - self.start) * self._frame_seconds
        speeds = slide_on_ground(self.law, self.speed, seconds, *self.ground)[1]
        return np.asarray(speeds[:, None] * self.motion[2:] / max(self.speed, 1e-9))

    @cached_property
    def _spread(self) -> tuple[float, float, float]:
        """Sum of the weights, weighted mean frame, and weighted sum of squared times from the mean frame (s²)."""
        weight = np.where(self.reliable, 1.0, UNRELIABLE_SHARE * self.weight)
        middle = float(weight @ self.frames / weight.sum())
        return float(weight.sum()), middle, float(weight @ ((self.frames - middle) * self._frame_seconds) ** 2)

    @property
    def middle_frame(self) -> float:
        """The weighted mean frame, at which the errors of position and velocity are independent."""
        return self._spread[1]

    def middle_variance(self, noise_world: float) -> float:
        """Variance of each coordinate of the position at the middle frame (world units²).

        Args:
            noise_world: standard deviation of each coordinate of a reliable position (world units).
        """
        return noise_world**2 / self._spread[0]

    def velocity_variance(self, noise_world: float) -> float:
        """Variance of each component of the velocity ((world units/s)²); `noise_world` as in `middle_variance`."""
        return 0.0 if self.at_rest else noise_world**2 / max(self._spread[2], 1e-9)

    def position_variance(self, frames: FloatArray, noise_world: float) -> FloatArray:
        """(F,) variance of each coordinate of the positions at frames (F,), as on a least-squares line (world units²).

        variance(t) = middle_variance + velocity_variance · (t - middle)²; `noise_world` as in `middle_variance`.
        """
        since_middle = (frames - self.middle_frame) * self._frame_seconds
        return self.middle_variance(noise_world) + self.velocity_variance(noise_world) * since_middle**2


def fit_stretch(law: Law, frames: NDArray[np.int64], location_world: FloatArray, weight: FloatArray) -> Stretch:
    """Fit free sliding on the world's ground robustly.

    Args:
        law: how the object slides.
        frames: (N,) frames of the positions in ascending order.
        location_world: (N, 2) measured positions (world units).
        weight: (N,) weight of each position, 0-1.
    """
    # The motion is that of the first frame: the motion before a rest does not follow from a later state.
    seconds = np.asarray((frames - frames[0]) * float(law["frame_seconds"]))
    location, weight = np.ascontiguousarray(location_world, float), np.ascontiguousarray(weight, float)
    motion, residual = fit_sliding(law, seconds, location, weight)
    return Stretch(law, frames, weight, motion, residual)


def sliding_positions(law: Law, motion: FloatArray, ground: Ground, seconds: FloatArray) -> FloatArray:
    """(N, 2) positions of a sliding object (world units).

    Args:
        law: how the object slides.
        motion: (4,) position and velocity at second 0 (world units, world units/s).
        ground: ground on which the object slides.
        seconds: (N,) times in ascending order.
    """
    speed = float(np.hypot(motion[2], motion[3]))
    distance = slide_on_ground(law, speed, np.asarray(seconds, float), *ground)[0]
    return np.asarray(motion[:2] + distance[:, None] * motion[2:4] / max(speed, 1e-9))
