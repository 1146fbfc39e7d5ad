"""Collisions from changes of velocity alone: the paper's variant "no events" (NE), for any backend's rollouts."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from nsdr.clevrer.files.velocity_rule import velocity_collisions as grid_collisions
from nsdr.dynamics.base import DynamicsBackend, VideoPixels, reads_images
from nsdr.dynamics.motion_states import states_from_tracks
from nsdr.errors import DataError
from nsdr.types import DynamicsPrediction, Event, Rollout, VideoTracks
from nsdr.validation import Count, NotNegative, PositiveCount, Settings, one_of
from nsdr.world.camera import CLEVRER_CAMERA, Camera, grid_from_pixels
from nsdr.world.physics_constants import OBJECT_RADIUS_WORLD

__all__ = ["VelocityConfig", "VelocityEvents", "velocity_collisions"]

FloatArray = NDArray[np.floating[Any]]
RULES = ("paper", "tuned")
NEAR_FRAMES = 2
"""Frames around a change of velocity in which the partner must be near and change its own velocity."""
LEAD_FRAMES = 20
"""Last frames of the video that the search for collisions after it starts from."""
CHANGED_WORLD = 0.1
"""A partner whose velocity changes as well may be this much farther away (world units) than one whose velocity does not."""


@dataclass(frozen=True)
class VelocityConfig(Settings):
    """How collisions are detected from motion. The tuned rule was set on tracks of left-out scenes of `train`.

    Attributes:
        rule: "paper" is the released executor's, on samples in the image; "tuned" works on the ground plane at every frame.
        stride_frames: "paper": frames between samples.
        span_frames: "tuned": velocities are means over this many frames before and after (frames).
        min_change: "tuned": smallest change of velocity that counts (world units per frame).
        partner_share: "tuned": share of `min_change` that the other object must change by.
        reach_world: "tuned": largest gap between the two objects, taken as circles (world units).
        pause_frames: "tuned": changes of one object closer in time than this are one change (frames).
    """

    rule: Annotated[str, one_of(RULES)] = "tuned"
    stride_frames: PositiveCount = 5
    span_frames: PositiveCount = 5
    min_change: NotNegative = 0.012
    partner_share: NotNegative = 0.5
    reach_world: NotNegative = 0.18
    pause_frames: Count = 6


class VelocityEvents:
    """A backend whose collisions are all detected from motion: the video's from the tracks, the others from its rollouts.

    Args:
        backend: predicts motion, given the video's collisions as far as the rule detects them.
        config: the rule.

    Raises:
        DataError: an unknown rule.
    """

    def __init__(self, backend: DynamicsBackend, config: VelocityConfig | None = None) -> None:
        self.backend = backend
        self.config = config or VelocityConfig()
        if self.config.rule not in RULES:
            raise DataError(f"rule is {self.config.rule!r}; expected one of {', '.join(RULES)}")

    def to(self, device: str) -> "VelocityEvents":
        """Move the backend's networks to a device."""
        if hasattr(self.backend, "to"):
            self.backend.to(device)
        return self

    @property
    def reads_images(self) -> bool:
        """Whether the backend does."""
        return reads_images(self.backend)

    def predict(
        self, tracks: VideoTracks, observed: Sequence[Event] | None = None, pixels: VideoPixels | None = None
    ) -> DynamicsPrediction:
        """Motion with collisions where it changes; see `DynamicsBackend`."""
        states = states_from_tracks(tracks)
        seen = Rollout(states.location_world, states.present, ())
        before = velocity_collisions(seen, self.config, tracks.camera) if observed is None else tuple(observed)
        if reads_images(self.backend):
            prediction = self.backend.predict(tracks, before, pixels)
        else:
            prediction = self.backend.predict(tracks, before)
        met = {e.objects for e in before}
        ahead = velocity_collisions(
            _from(prediction.observed, tracks.n_frames - LEAD_FRAMES), self.config, tracks.camera
        )
        later = [e for e in ahead if e.frame >= tracks.n_frames and e.objects not in met]
        counterfactual = {
            k: replace(without, collisions=velocity_collisions(without, self.config, tracks.camera), uncertain=None)
            for k, without in prediction.counterfactual.items()
        }
        rollout = replace(prediction.observed, collisions=(*before, *later), unseen_scores=None, uncertain=None)
        return replace(prediction, observed=rollout, counterfactual=counterfactual)


def _from(rollout: Rollout, frame: int) -> Rollout:
    """The rollout with nothing known before a frame."""
    known = np.arange(rollout.visible.shape[1]) >= frame
    location = np.where(known[:, None], rollout.location_world, np.nan)
    return replace(rollout, location_world=location, visible=rollout.visible & known)


def velocity_collisions(rollout: Rollout, config: VelocityConfig, camera: Camera = CLEVRER_CAMERA) -> tuple[Event, ...]:
    """Collisions of one rollout, each pair once, by frame."""
    found = _in_image(rollout, config, camera) if config.rule == "paper" else _on_ground(rollout, config)
    return tuple(sorted(found, key=lambda e: e.frame))


def _in_image(rollout: Rollout, config: VelocityConfig, camera: Camera) -> list[Event]:
    n, frames = rollout.visible.shape
    height = np.full((n, frames, 1), OBJECT_RADIUS_WORLD)
    grid = grid_from_pixels(camera.pixels(np.concatenate([rollout.location_world, height], -1)))
    shown = rollout.visible & np.isfinite(grid).all(-1)
    samples = range(0, frames, config.stride_frames)
    paths = [{t: (grid[i, t, 0], grid[i, t, 1]) for t in samples if shown[i, t]} for i in range(n)]
    return grid_collisions(paths, config.stride_frames)


def _on_ground(rollout: Rollout, config: VelocityConfig) -> list[Event]:
    """A pair collides where one object's velocity changes most while the other is near and changes its own."""
    position, span = rollout.location_world, config.span_frames
    n, frames = rollout.visible.shape
    if frames <= 2 * span:
        return []
    step = (position[:, span:] - position[:, :-span]) / span
    change = np.zeros((n, frames))
    change[:, span : frames - span] = np.nan_to_num(np.linalg.norm(step[:, span:] - step[:, :-span], axis=-1))
    found: dict[tuple[int, ...], tuple[float, int]] = {}
    for i in range(n):
        taken = np.zeros(frames, bool)
        for t in np.argsort(-change[i]).tolist():
            if change[i, t] <= config.min_change:
                break
            if taken[max(t - config.pause_frames, 0) : t + config.pause_frames].any():
                continue
            taken[t] = True
            near = slice(max(t - NEAR_FRAMES, 0), t + NEAR_FRAMES + 1)
            gap = np.linalg.norm(position[:, near] - position[i, near], axis=-1)
            gap = np.where(np.isfinite(gap), gap, np.inf).min(1) - 2 * OBJECT_RADIUS_WORLD
            share = change[:, near].max(1) / config.min_change
            far = (gap >= config.reach_world) | (share < config.partner_share) | (np.arange(n) == i)
            far_off = np.where(far, np.inf, gap - CHANGED_WORLD * np.minimum(share, 1))
            j = int(far_off.argmin())
            if np.isfinite(far_off[j]):
                pair = tuple(sorted((i, j)))
                found[pair] = max(found.get(pair, (0.0, 0)), (float(change[i, t]), t))
    return [Event("collision", frame, pair) for pair, (_, frame) in found.items()]
