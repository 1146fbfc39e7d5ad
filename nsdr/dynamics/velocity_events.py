"""Collisions from changes of velocity alone: the paper's variant "no events" (NE), for any backend's rollouts."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nsdr.clevrer.velocity_rule import velocity_collisions as grid_collisions
from nsdr.dynamics.base import VideoPixels
from nsdr.dynamics.motion_states import states_from_tracks
from nsdr.errors import DataError
from nsdr.types import DynamicsPrediction, Event, Rollout, VideoTracks
from nsdr.world.camera import CLEVRER_CAMERA, Camera, grid_from_pixels, on_ground
from nsdr.world.physics_constants import OBJECT_RADIUS_WORLD

__all__ = ["VelocityEvents", "velocity_collisions"]

FloatArray = NDArray[np.floating[Any]]
RULES = ("tuned", "paper")
SAMPLE_STRIDE_FRAMES = 5
"""Frames between the samples of the paper's rule, those of the released files."""
SPAN_FRAMES = 5
"""Velocities of the tuned rule are means over this many frames before and after (frames). Like the next four, set on tracks
of left-out scenes of `train`."""
MIN_CHANGE = 0.012
"""Smallest change of velocity that counts (world units per frame)."""
PARTNER_SHARE = 0.5
"""Share of `MIN_CHANGE` that the other object must change by."""
REACH_WORLD = 0.18
"""Largest gap between the two objects, taken as circles (world units)."""
PAUSE_FRAMES = 6
"""Changes of one object closer in time than this are one change (frames)."""
NEAR_FRAMES = 2
"""Frames around a change of velocity in which the partner must be near and change its own velocity."""
LEAD_FRAMES = 20
"""Last frames of the video that the search for collisions after it starts from."""
CHANGED_WORLD = 0.1
"""A partner whose velocity changes as well may be this much farther away (world units) than one whose velocity does not."""


class VelocityEvents:
    """A backend whose collisions are all detected from motion: the video's from the tracks, the others from its rollouts.

    Args:
        backend: predicts motion, given the video's collisions as far as the rule detects them.
        rule: "tuned" works on the ground plane at every frame; "paper" is the released executor's, on samples in the image.
    """

    def __init__(self, backend: Any, rule: str = "tuned") -> None:
        self.backend = backend
        self.rule = rule
        if rule not in RULES:
            raise DataError(f"rule: expected one of {', '.join(RULES)}, got {rule!r:.60}")

    def to(self, device: str) -> "VelocityEvents":
        """Move the backend's networks to a device."""
        if hasattr(self.backend, "to"):
            self.backend.to(device)
        return self

    @property
    def reads_images(self) -> bool:
        """Whether the backend does."""
        return bool(getattr(self.backend, "reads_images", False))

    def predict(
        self, tracks: VideoTracks, observed: Sequence[Event] | None = None, pixels: VideoPixels | None = None
    ) -> DynamicsPrediction:
        """Motion with collisions where it changes; see `DynamicsBackend`."""
        states = states_from_tracks(tracks)
        seen = Rollout(states.location_world, states.present, ())
        before = velocity_collisions(seen, self.rule, tracks.camera) if observed is None else tuple(observed)
        prediction = self.backend.predict(tracks, before, *([pixels] if self.reads_images else []))
        met = {e.objects for e in before}
        rollout = prediction.observed
        known = np.arange(rollout.visible.shape[1]) >= tracks.n_frames - LEAD_FRAMES
        location = np.where(known[:, None], rollout.location_world, np.nan)
        end = replace(rollout, location_world=location, visible=rollout.visible & known)
        ahead = velocity_collisions(end, self.rule, tracks.camera)
        later = [e for e in ahead if e.frame >= tracks.n_frames and e.objects not in met]
        counterfactual = {
            k: replace(without, collisions=velocity_collisions(without, self.rule, tracks.camera), uncertain=None)
            for k, without in prediction.counterfactual.items()
        }
        rollout = replace(rollout, collisions=(*before, *later), unseen_scores=None, uncertain=None)
        return replace(prediction, observed=rollout, counterfactual=counterfactual)


def velocity_collisions(rollout: Rollout, rule: str = "tuned", camera: Camera = CLEVRER_CAMERA) -> tuple[Event, ...]:
    """Collisions of one rollout, each pair once, by frame."""
    found = _in_image(rollout, camera) if rule == "paper" else _on_ground(rollout)
    return tuple(sorted(found, key=lambda e: e.frame))


def _in_image(rollout: Rollout, camera: Camera) -> list[Event]:
    n, frames = rollout.visible.shape
    grid = grid_from_pixels(camera.pixels(on_ground(rollout.location_world)))
    shown = rollout.visible & np.isfinite(grid).all(-1)
    samples = range(0, frames, SAMPLE_STRIDE_FRAMES)
    paths = [{t: (grid[i, t, 0], grid[i, t, 1]) for t in samples if shown[i, t]} for i in range(n)]
    return grid_collisions(paths, SAMPLE_STRIDE_FRAMES)


def _on_ground(rollout: Rollout) -> list[Event]:
    """A pair collides where one object's velocity changes most while the other is near and changes its own."""
    position, span = rollout.location_world, SPAN_FRAMES
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
            if change[i, t] <= MIN_CHANGE:
                break
            if taken[max(t - PAUSE_FRAMES, 0) : t + PAUSE_FRAMES].any():
                continue
            taken[t] = True
            near = slice(max(t - NEAR_FRAMES, 0), t + NEAR_FRAMES + 1)
            gap = np.linalg.norm(position[:, near] - position[i, near], axis=-1)
            gap = np.where(np.isfinite(gap), gap, np.inf).min(1) - 2 * OBJECT_RADIUS_WORLD
            share = change[:, near].max(1) / MIN_CHANGE
            far = (gap >= REACH_WORLD) | (share < PARTNER_SHARE) | (np.arange(n) == i)
            far_off = np.where(far, np.inf, gap - CHANGED_WORLD * np.minimum(share, 1))
            j = int(far_off.argmin())
            if np.isfinite(far_off[j]):
                pair = tuple(sorted((i, j)))
                found[pair] = max(found.get(pair, (0.0, 0)), (float(change[i, t]), t))
    return [Event("collision", frame, pair) for pair, (_, frame) in found.items()]
