"""Motion and masses of a scene's objects as numbers, as far as its source knows them."""

from dataclasses import dataclass

import numpy as np

from nsdr.types.checks import ArrayHolder, FloatArray, check, check_values, store_array

__all__ = ["ObjectPhysics"]


@dataclass(frozen=True, eq=False, repr=False)
class ObjectPhysics(ArrayHolder):
    """Velocities and relative masses of n objects, with their errors. Seconds are of simulated time: a frame is 0.028 s.

    Attributes:
        velocity_world_per_s: (n, n_frames, 2) float, on the ground: towards the camera, and to the right of the image (world
            units/s); NaN where it is not known.
        velocity_error_world_per_s: standard deviation of each component (world units/s); 0 for true velocities.
        log_mass: (n,) float, natural logarithms of the masses, of which only ratios matter; None where they are not known.
        log_mass_covariance: (n, n) float, of the errors of `log_mass`; zeros for true masses; None without `log_mass`.
    """

    velocity_world_per_s: FloatArray
    velocity_error_world_per_s: float
    log_mass: FloatArray | None = None
    log_mass_covariance: FloatArray | None = None

    def __post_init__(self) -> None:
        store_array(self, "velocity_world_per_s", (None, None, 2), "f")
        check_values("ObjectPhysics", "velocity_world_per_s", self.velocity_world_per_s, -np.inf, np.inf, nan=True)
        error = self.velocity_error_world_per_s
        check(
            0 <= error < np.inf, f"ObjectPhysics.velocity_error_world_per_s: expected a number from 0 on, got {error}"
        )
        both = (self.log_mass is None) == (self.log_mass_covariance is None)
        check(both, "ObjectPhysics: expected log_mass and log_mass_covariance, or neither")
        if self.log_mass is None or self.log_mass_covariance is None:
            return
        n = len(self.velocity_world_per_s)
        store_array(self, "log_mass", (n,), "f")
        store_array(self, "log_mass_covariance", (n, n), "f")
        check_values("ObjectPhysics", "log_mass", self.log_mass, -np.inf, np.inf)
        check_values("ObjectPhysics", "log_mass_covariance", self.log_mass_covariance, -np.inf, np.inf)
        lowest = float(np.diagonal(self.log_mass_covariance).min(initial=0.0))
        check(lowest >= 0, f"ObjectPhysics.log_mass_covariance: expected variances from 0 on, got {lowest}")

    @property
    def n_frames(self) -> int:
        """Frames of the velocities."""
        return int(self.velocity_world_per_s.shape[1])
