"""Collisions detected from changes of velocity alone in the rollouts of any backend: the paper's variant "no events" (NE)."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from nsdr.clevrer.velocity_rule import velocity_collisions
from nsdr.dynamics.base import Dynamics, Explanation, only_removal
from nsdr.dynamics.motion_states import MotionStates
from nsdr.io.checkpoint import HasWeights
from nsdr.io.description import described
from nsdr.types import Event, Rollout
from nsdr.types.interventions import Intervention
from nsdr.world.camera import Camera, grid_from_pixels, on_ground
from nsdr.world.world import check_as_clevrer

SAMPLE_STRIDE_FRAMES = 5
"""Frames between two samples that the velocity rule reads, as in the released files."""
LEAD_FRAMES = 20
"""The search for collisions after the video starts this many frames before its end, to know the velocities there."""


class VelocityEvents:
    """A backend whose collisions are all detected from motion: those of the video from tracks, all others from rollouts.

    Args:
        backend: backend that predicts motion, given the collisions detected in the video.
    """

    __repr__ = described

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
        """Explain the motion, with collisions where velocities change; see `nsdr.dynamics.Dynamics`.

        Raises:
            DataError: tracks of a world other than CLEVRER's, for which the thresholds of the rule were set.
        """
        check_as_clevrer(states.world, "the velocity rule of the released executor")
        seen = Rollout(states.location_world, states.present, ())
        before = collisions_from_motion(seen, states.camera) if collisions is None else tuple(collisions)
        return _VelocityExplanation(self.backend.explain(states, before), before)


class _VelocityExplanation(Explanation):
    """The rollouts of another explanation, with collisions where velocities change in them."""

    def __init__(self, motion: Explanation, before: tuple[Event, ...]) -> None:
        super().__init__(motion.objects, motion.n_frames, motion.world, motion.physics)
        self._motion, self._before = motion, before

    def run(self, changes: Sequence[Intervention], from_frame: int, frames: int) -> Rollout:
        """The rollout of the other explanation, with collisions detected from its motion.

        Raises:
            DataError: a change other than the removal of one object from frame 0.
        """
        only_removal(changes, from_frame, "collisions from velocities")
        rollout = self._motion.run(changes, from_frame, frames)
        if changes:
            return replace(rollout, collisions=collisions_from_motion(rollout, self.camera), uncertain=None)
        met = {e.objects for e in self._before}
        known = np.arange(rollout.visible.shape[1]) >= self.n_frames - LEAD_FRAMES
        ahead = collisions_from_motion(replace(rollout, visible=rollout.visible & known), self.camera)
        later = [e for e in ahead if e.frame >= self.n_frames and e.objects not in met]
        return replace(rollout, collisions=(*self._before, *later), predicted_scores=None, uncertain=None)


def collisions_from_motion(rollout: Rollout, camera: Camera) -> tuple[Event, ...]:
    """Collisions in a rollout by the velocity rule of the released executor, at most one for each pair, in order of frames."""
    n, frames = rollout.visible.shape
    grid = grid_from_pixels(camera.pixels(on_ground(rollout.location_world)))
    shown = rollout.visible & np.isfinite(grid).all(-1)
    samples = range(0, frames, SAMPLE_STRIDE_FRAMES)
    paths = [{t: (grid[i, t, 0], grid[i, t, 1]) for t in samples if shown[i, t]} for i in range(n)]
    return tuple(sorted(velocity_collisions(paths, SAMPLE_STRIDE_FRAMES), key=lambda e: e.frame))
