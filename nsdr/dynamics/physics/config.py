"""Settings of the physics backend."""

from dataclasses import dataclass

from nsdr.io.validation import COUNT, NOT_NEGATIVE, SHARE, check_ranges
from nsdr.world.physics_constants import LOG_MASS_STD

__all__ = ["PhysicsConfig"]

MAX_RUNS = 10_000
"""Largest `PhysicsConfig.runs`."""


@dataclass(frozen=True)
class PhysicsConfig:
    """How a video is explained by fits, and how the fitted scene is simulated on.

    Noise levels were set on left-out scenes of `train`; `python benchmarks/continued.py` compares them. Perturbations drawn
    from the posterior of the fit were tried in place of fixed ones: on cut videos they are better calibrated, but they decide
    fewer counterfactuals of simulated scenes rightly.

    Attributes:
        runs: simulations of each rollout; the first is not perturbed.
        position_noise_world: standard deviation of perturbed positions (world units).
        velocity_noise_world_per_s: standard deviation of perturbed velocities (world units/s).
        yaw_noise: standard deviation of perturbed yaws (radians).
        mass_noise: standard deviation of perturbed log masses of objects that were seen to collide.
        unmet_mass_noise: the same for objects that were not; CLEVRER's masses are uniform in 0.7-1.3.
        collision_threshold: share of runs above which a collision counts.
        seed: of the perturbations.
        trials: maximum number of fits beside the first, with other collisions.
        restarts: maximum number of restarts of each fit, for each window of frames.
    """

    runs: int = 30
    position_noise_world: float = 0.004
    velocity_noise_world_per_s: float = 0.015
    yaw_noise: float = 0.1
    mass_noise: float = 0.08
    unmet_mass_noise: float = LOG_MASS_STD
    collision_threshold: float = 0.5
    seed: int = 0
    trials: int = 8
    restarts: int = 6

    def __post_init__(self) -> None:
        check_ranges(self, runs=(1, MAX_RUNS), collision_threshold=SHARE, seed=COUNT, trials=COUNT, restarts=COUNT)
        noise = ("position_noise_world", "velocity_noise_world_per_s", "yaw_noise", "mass_noise", "unmet_mass_noise")
        check_ranges(self, **dict.fromkeys(noise, NOT_NEGATIVE))
