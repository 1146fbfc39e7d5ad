"""Collisions from changes of velocity alone: the paper's variant "no events" (NE), for any backend's rollouts."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from nsdr.clevrer.velocity_rule import velocity_collisions as grid_collisions
from nsdr.dynamics.base import VideoPixels
from nsdr.dynamics.motion_states import states_from_tracks
from nsdr.types import DynamicsPrediction, Event, Rollout, VideoTracks
from nsdr.world.camera import CLEVRER_CAMERA, Camera, grid_from_pixels, on_ground

SAMPLE_STRIDE_FRAMES = 5
"""Frames between the samples that the rule reads, as in the released files."""
LEAD_FRAMES = 20
"""Last frames of the video that the search for collisions after it starts from."""


class VelocityEvents:
    """A backend whose collisions are all detected from motion: the video's from the tracks, the others from its rollouts.

    Args:
        backend: predicts motion, given the video's collisions as far as they are detected.
    """

    def __init__(self, backend: Any) -> None:
        self.backend = backend

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
        before = velocity_collisions(seen, tracks.camera) if observed is None else tuple(observed)
        prediction = self.backend.predict(tracks, before, *([pixels] if self.reads_images else []))
        met = {e.objects for e in before}
        rollout = prediction.observed
        known = np.arange(rollout.visible.shape[1]) >= tracks.n_frames - LEAD_FRAMES
        end = replace(rollout, visible=rollout.visible & known)
        ahead = velocity_collisions(end, tracks.camera)
        later = [e for e in ahead if e.frame >= tracks.n_frames and e.objects not in met]
        counterfactual = {
            k: replace(without, collisions=velocity_collisions(without, tracks.camera), uncertain=None)
            for k, without in prediction.counterfactual.items()
        }
        rollout = replace(rollout, collisions=(*before, *later), unseen_scores=None, uncertain=None)
        return replace(prediction, observed=rollout, counterfactual=counterfactual)


def velocity_collisions(rollout: Rollout, camera: Camera = CLEVRER_CAMERA) -> tuple[Event, ...]:
    """Collisions of one rollout by the released executor's rule, each pair once, by frame."""
    n, frames = rollout.visible.shape
    grid = grid_from_pixels(camera.pixels(on_ground(rollout.location_world)))
    shown = rollout.visible & np.isfinite(grid).all(-1)
    samples = range(0, frames, SAMPLE_STRIDE_FRAMES)
    paths = [{t: (grid[i, t, 0], grid[i, t, 1]) for t in samples if shown[i, t]} for i in range(n)]
    return tuple(sorted(grid_collisions(paths, SAMPLE_STRIDE_FRAMES), key=lambda e: e.frame))
