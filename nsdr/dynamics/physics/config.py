"""Settings of the physics backend."""

from dataclasses import dataclass
from typing import Annotated

from msgspec import Meta

from nsdr.validation import Count, NotNegative, Settings, Share

MAX_RUNS = 1000
"""Largest `PhysicsConfig.runs`."""


@dataclass(frozen=True)
class PhysicsConfig(Settings):
    """How a video is explained by fits, and how the fitted scene is simulated on.

    States are as exact as the detections between two collisions allow. Noise levels were set on left-out scenes of `train`;
    `python benchmarks/continued.py` compares them.

    Attributes:
        runs: simulations of each rollout; the first is not perturbed.
        position_noise_world: error of a detection's position (world units). This and the others are scales of Student's t.
        yaw_noise: error of yaws (radians).
        mass_noise: error of log masses of objects that were seen to collide; that of others is
            `LOG_MASS_STD`.
        collision_threshold: share of runs above which a collision counts.
        seed: of the perturbations.
        trials: maximum number of fits beside the first, with other collisions.
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
