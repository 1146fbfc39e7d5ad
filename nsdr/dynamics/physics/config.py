"""Settings of the physics backend."""

from dataclasses import dataclass
from typing import Annotated

from msgspec import Meta

from nsdr.validation import Count, NotNegative, Settings, Share

MAX_RUNS = 1000
"""Largest `PhysicsConfig.runs`."""


@dataclass(frozen=True)
class PhysicsConfig(Settings):
    """Settings of the fit to a video and of the simulation that continues it.

    The errors of states follow from the detections between two collisions. Noise levels were set on left-out scenes of `train`;
    `python -m benchmarks.dynamics … --cut` compares them.

    Attributes:
        runs: number of simulations of each rollout; the first is not perturbed.
        position_noise_world: error of the position of a detection (world units). All errors are scales of Student's t.
        yaw_noise: error of yaws (radians).
        mass_noise: error of the log masses of objects that were seen to collide; other log masses have the error
            `Physics.log_mass_std` of their world.
        collision_threshold: probability above which a collision counts.
        seed: seed of the perturbations.
        trials: maximum number of fits with other collisions, in addition to the first fit.
        restarts: maximum number of restarts of each fit, for each window of frames.
    """

    runs: Annotated[int, Meta(ge=1, le=MAX_RUNS)] = 90
    position_noise_world: NotNegative = 0.005
    yaw_noise: NotNegative = 0.2
    mass_noise: NotNegative = 0.08
    collision_threshold: Share = 0.5
    seed: Count = 0
    trials: Count = 8
    restarts: Count = 6
