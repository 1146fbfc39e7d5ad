"""Settings of the physics backend."""

from dataclasses import dataclass
from typing import Annotated

from msgspec import Meta

from nsdr.validation import Count, NotNegative, Settings, Share

__all__ = ["PhysicsConfig"]

MAX_RUNS = 10_000
"""Largest `PhysicsConfig.runs`."""


@dataclass(frozen=True)
class PhysicsConfig(Settings):
    """How a video is explained by fits, and how the fitted scene is simulated on.

    Noise levels were set on left-out scenes of `train`; `python benchmarks/continued.py` compares them. Perturbations drawn
    from the posterior of the fit were tried in place of fixed ones: on cut videos they are better calibrated, but they decide
    fewer counterfactuals of simulated scenes rightly.

    Attributes:
        runs: simulations of each rollout; the first is not perturbed.
        position_noise_world: standard deviation of perturbed positions (world units).
        velocity_noise_world_per_s: standard deviation of perturbed velocities (world units/s).
        yaw_noise: standard deviation of perturbed yaws (radians).
        mass_noise: standard deviation of perturbed log masses of objects that were seen to collide; that of others is
            `LOG_MASS_STD`.
        collision_threshold: share of runs above which a collision counts.
        seed: of the perturbations.
        trials: maximum number of fits beside the first, with other collisions.
        restarts: maximum number of restarts of each fit, for each window of frames.
    """

    runs: Annotated[int, Meta(ge=1, le=MAX_RUNS)] = 30
    position_noise_world: NotNegative = 0.004
    velocity_noise_world_per_s: NotNegative = 0.015
    yaw_noise: NotNegative = 0.1
    mass_noise: NotNegative = 0.08
    collision_threshold: Share = 0.5
    seed: Count = 0
    trials: Count = 8
    restarts: Count = 6
