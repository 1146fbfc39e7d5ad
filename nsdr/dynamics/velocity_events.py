"""Collisions from changes of velocity alone: the paper's variant "no events" (NE), for any backend's rollouts."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from nsdr.clevrer.velocity_rule import velocity_collisions
from nsdr.dynamics.base import Dynamics, Explanation
from nsdr.dynamics.motion_states import MotionStates
from nsdr.io.checkpoint import HasWeights
from nsdr.types import Event, Rollout
from nsdr.types.interventions import Intervention
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

    def __init__(self, backend: Dynamics) -> None:
        self.backend = backend

    def to(self, device: str) -> "VelocityEvents":
        """Move the backend's networks to a device."""
        if isinstance(self.backend, HasWeights):
            self.backend.to(device)
        return self

    def save_pretrained(self, folder: str | Path) -> None:
        """Write the backend's weights."""
        if isinstance(self.backend, HasWeights):
            self.backend.save_pretrained(folder)

    def explain(self, states: MotionStates, collisions: Sequence[Event] | None = None) -> Explanation:
        """Explain the motion with collisions where it changes; see `nsdr.dynamics.Dynamics`."""
        seen = Rollout(states.location_world, states.present, ())
        before = collisions_from_motion(seen, states.camera) if collisions is None else tuple(collisions)
        return _VelocityExplanation(self.backend.explain(states, before), before)


class _VelocityExplanation(Explanation):
    """Rollouts of another explanation, with collisions where their motion changes."""

    def __init__(self, motion: Explanation, before: tuple[Event, ...]) -> None:
        super().__init__(motion.objects, motion.n_frames, motion.camera, motion.physics)
        self._motion, self._before = motion, before

    def run(self, changes: Sequence[Intervention], from_frame: int, frames: int) -> Rollout:
        """The other explanation's rollout, and what its motion shows; raises `DataError` as that does."""
        rollout = self._motion.run(changes, from_frame, frames)
        if changes:
            return replace(rollout, collisions=collisions_from_motion(rollout, self.camera), uncertain=None)
        met = {e.objects for e in self._before}
        known = np.arange(rollout.visible.shape[1]) >= self.n_frames - LEAD_FRAMES
        ahead = collisions_from_motion(replace(rollout, visible=rollout.visible & known), self.camera)
        later = [e for e in ahead if e.frame >= self.n_frames and e.objects not in met]
        return replace(rollout, collisions=(*self._before, *later), unseen_scores=None, uncertain=None)


def collisions_from_motion(rollout: Rollout, camera: Camera = CLEVRER_CAMERA) -> tuple[Event, ...]:
    """Collisions of one rollout by the released executor's rule, each pair once, by frame."""
    n, frames = rollout.visible.shape
    grid = grid_from_pixels(camera.pixels(on_ground(rollout.location_world)))
    shown = rollout.visible & np.isfinite(grid).all(-1)
    samples = range(0, frames, SAMPLE_STRIDE_FRAMES)
    paths = [{t: (grid[i, t, 0], grid[i, t, 1]) for t in samples if shown[i, t]} for i in range(n)]
    return tuple(sorted(velocity_collisions(paths, SAMPLE_STRIDE_FRAMES), key=lambda e: e.frame))
