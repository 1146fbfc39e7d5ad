"""Collisions from changes of velocity alone: the paper's variant "no events" (NE), for any backend's rollouts."""

from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from nsdr.clevrer.camera import OBJECT_RADIUS_WORLD, grid_from_pixels, pixels_from_world
from nsdr.errors import DataError
from nsdr.symbolic.official import velocity_collisions as grid_collisions
from nsdr.types import DynamicsPrediction, Event, Rollout, VideoTracks

__all__ = ["VelocityConfig", "VelocityEvents", "velocity_collisions"]

FloatArray = NDArray[np.floating[Any]]
RULES = ("paper", "tuned")


@dataclass(frozen=True)
class VelocityConfig:
    """How collisions are read from motion.

    Attributes:
        rule: "paper" is the released code's, on samples in the picture; "tuned" works on the ground at every frame.
        stride_frames: "paper": frames between samples.
        span_frames: "tuned": velocities are means over so many frames before and after.
        least_change: "tuned": of velocity, world units a frame.
        reach_world: "tuned": largest gap of the two objects' outlines, taken as circles.
        pause_frames: "tuned": changes of one object so near to each other are one.
    """

    rule: str = "tuned"
    stride_frames: int = 5
    span_frames: int = 5
    least_change: float = 0.006
    reach_world: float = 0.12
    pause_frames: int = 8


class _Predicts(Protocol):
    def predict(self, tracks: VideoTracks) -> DynamicsPrediction:
        """As of `DynamicsPredictor`."""


class VelocityEvents:
    """A backend whose collisions are all replaced by those read from its motion.

    Args:
        backend: predicts motion.
        config: the rule.

    Raises:
        DataError: an unknown rule.
    """

    def __init__(self, backend: _Predicts, config: VelocityConfig | None = None) -> None:
        self.backend = backend
        self.config = config or VelocityConfig()
        if self.config.rule not in RULES:
            raise DataError(f"rule is {self.config.rule!r}; expected one of {', '.join(RULES)}")

    def predict(self, tracks: VideoTracks) -> DynamicsPrediction:
        """The backend's motion with collisions of its own kinks."""
        prediction = self.backend.predict(tracks)

        def replaced(rollout: Rollout) -> Rollout:
            return replace(rollout, collisions=velocity_collisions(rollout, self.config), unseen_scores=None)

        counterfactual = {k: replaced(r) for k, r in prediction.counterfactual.items()}
        return replace(prediction, observed=replaced(prediction.observed), counterfactual=counterfactual)


def velocity_collisions(rollout: Rollout, config: VelocityConfig) -> tuple[Event, ...]:
    """Collisions of one course, each pair once, by frame."""
    found = _in_picture(rollout, config) if config.rule == "paper" else _on_ground(rollout, config)
    return tuple(sorted(found, key=lambda e: e.frame))


def _in_picture(rollout: Rollout, config: VelocityConfig) -> list[Event]:
    n, frames = rollout.visible.shape
    height = np.full((n, frames, 1), OBJECT_RADIUS_WORLD)
    grid = grid_from_pixels(pixels_from_world(np.concatenate([rollout.location_world, height], -1)))
    shown = rollout.visible & np.isfinite(grid).all(-1)
    samples = range(0, frames, config.stride_frames)
    return grid_collisions([{t: (grid[i, t, 0], grid[i, t, 1]) for t in samples if shown[i, t]} for i in range(n)])


def _on_ground(rollout: Rollout, config: VelocityConfig) -> list[Event]:
    place, span = rollout.location_world, config.span_frames
    n, frames = rollout.visible.shape
    step = np.diff(place, axis=1)
    mean = uniform_filter1d(step, span, axis=1, origin=span // 2) if frames > 2 * span + 1 else step
    found: dict[tuple[int, int], int] = {}
    if frames <= 2 * span + 1:
        return []
    change = np.full((n, frames), np.nan)
    # mean[t] covers the `span` steps up to t: before and after a frame.
    change[:, span : frames - span] = np.linalg.norm(
        mean[:, 2 * span - 1 :] - mean[:, span - 1 : frames - 1 - span], axis=-1
    )[:, : frames - 2 * span]
    for i in range(n):
        order = np.argsort(-np.nan_to_num(change[i]))
        taken = np.zeros(frames, bool)
        for t in order.tolist():
            if not change[i, t] > config.least_change:
                break
            if taken[max(t - config.pause_frames, 0) : t + config.pause_frames].any():
                continue
            taken[t] = True
            near = slice(max(t - 2, 0), t + 3)
            with np.errstate(invalid="ignore"):
                gap = np.linalg.norm(place[:, near] - place[i, near], axis=-1)
            gap = np.where(np.isfinite(gap), gap, np.inf).min(1) - 2 * OBJECT_RADIUS_WORLD
            gap[i] = np.inf
            j = int(gap.argmin())
            if gap[j] < config.reach_world:
                pair = (min(i, j), max(i, j))
                found[pair] = min(found.get(pair, t), t)
    return [Event("collision", frame, pair) for pair, frame in found.items()]
