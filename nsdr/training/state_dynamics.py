"""Training task of the dynamics network on states (`network: state`)."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional as F

from nsdr.dynamics.motion_states import extrapolate
from nsdr.dynamics.propnet.state_model import LENGTH_WORLD, StateModel
from nsdr.dynamics.propnet.state_predictor import StatePredictor
from nsdr.training.track_task import FIRST_PRESENT_FRAME, LAST_FRAME, DynamicsTraining, TrackTask, pair_loss

__all__ = ["StateModelTask"]

FORWARD_FRAMES_BEFORE_COLLISION = 14
"""Near a collision, the forward network's present is at most this many frames before it, and never after."""
OBSERVER_FRAMES_AROUND_COLLISION = 7
"""Near a collision, the observer's present is at most this many frames before or after it."""
OBSERVED_TOLERANCE_FRAMES = 2
"""The observer should report a collision that is at most this many frames from its present."""
PREDICTED_RANGE_FRAMES = (-2, 1)
"""The forward network should report a collision whose frame, minus the frame that a step predicts, is in this closed range."""
SMOOTH_L1_BETA = 0.2
"""Position error at which the motion loss changes from quadratic to linear (in units of `LENGTH_WORLD`)."""


class StateModelTask(TrackTask):
    """Motion and collision losses of the forward network over several steps, and collision loss of the observer.

    Scenes are rotated and mirrored at random: the network's inputs are relative, so the world has no preferred direction.
    """

    def __init__(self, config: DynamicsTraining) -> None:
        torch.manual_seed(config.loop.seed)
        self.network = StateModel(config.model)
        super().__init__(config, self.network)
        self.margin = max(config.model.past_steps, config.model.side_steps) * config.model.stride_frames
        self.locations = extrapolate(self.data.location_world, self.margin).astype(np.float32)

    def batch(self, size: int, rng: np.random.Generator) -> dict[str, dict[str, Tensor]]:
        """Windows of B = `size` scenes for the forward network and the observer, both as `_windows` makes them: (B, N, ...)."""
        c = self.config.model
        past = np.arange(-c.past_steps + 1, self.config.rollout_steps + 1) * c.stride_frames
        whole = np.arange(-c.side_steps, c.side_steps + 1) * c.stride_frames
        scenes, frames = self.draw_windows(size, rng, FORWARD_FRAMES_BEFORE_COLLISION, 0)
        forward = self._windows(scenes, np.clip(frames, FIRST_PRESENT_FRAME, LAST_FRAME - 1), past, rng)
        around = OBSERVER_FRAMES_AROUND_COLLISION
        scenes, frames = self.draw_windows(size, rng, around, around)
        return {"forward": forward, "observer": self._windows(scenes, np.clip(frames, 0, LAST_FRAME), whole, rng)}

    def _windows(
        self, scenes: NDArray[Any], frames: NDArray[Any], offsets: NDArray[Any], rng: np.random.Generator
    ) -> dict[str, Tensor]:
        """Windows of K samples at `offsets` (frames) from the present frames (B,) of scenes (B,).

        Returns:
            location: (B, N, K, 2) float32, noisy, rotated and mirrored (world units); outside the video extrapolated.
            reliable: (B, N, K) bool, False outside the video.
            static: (B, N, 5) float32, one-hot shape and material.
            exists: (B, N) bool, objects that are present.
            until: (B, N, N) int64, frames from the present to the pair's collision, negative after it.
        """
        data = self.data
        index = frames[:, None] + offsets
        inside = (index >= 0) & (index <= LAST_FRAME)
        clipped = np.clip(index, 0, LAST_FRAME)
        rows = scenes[:, None]
        extended = np.clip(index + self.margin, 0, self.locations.shape[2] - 1)
        location = self.locations[rows, :, extended].transpose(0, 2, 1, 3)  # (B, N, K, 2)
        noisy = location + rng.normal(size=location.shape) * self.config.noise_world
        yaw = rng.uniform(0, 2 * np.pi, len(scenes))
        mirror = rng.choice([-1.0, 1.0], len(scenes))
        rotation = np.stack([np.cos(yaw), -np.sin(yaw) * mirror, np.sin(yaw), np.cos(yaw) * mirror], 1)
        location = np.einsum("bnki,bji->bnkj", noisy, rotation.reshape(-1, 2, 2)).astype(np.float32)
        reliable = data.reliable[rows, :, clipped].transpose(0, 2, 1) & inside[:, None]
        present = data.present[scenes, :, frames]
        return {
            "location": torch.from_numpy(location),
            "reliable": torch.from_numpy(reliable),
            "static": torch.from_numpy(data.static[scenes]),
            "exists": torch.from_numpy(data.exists[scenes] & present),
            "until": torch.from_numpy((data.collision_frame[scenes] - frames[:, None, None]).astype(np.int64)),
        }

    def losses(self, model: nn.Module, batch: Mapping[str, Mapping[str, Tensor]]) -> dict[str, Tensor]:
        """Scalar losses of a batch (B, N, ...).

        Returns:
            `motion` and `collision` of the forward network, and `observed`, the collision loss of the observer.
        """
        device = next(model.parameters()).device
        forward, observer = ({k: v.to(device) for k, v in part.items()} for part in batch.values())
        motion, collision = self._forward_losses(forward)
        logits = self.network.observe(*(observer[k] for k in ("location", "reliable", "static", "exists")))
        collides = observer["until"].abs() <= OBSERVED_TOLERANCE_FRAMES
        return {"motion": motion, "collision": collision, "observed": pair_loss(logits, collides, observer["exists"])}

    def _forward_losses(self, windows: Mapping[str, Tensor]) -> tuple[Tensor, Tensor]:
        """Motion and collision loss of `rollout_steps` steps, each predicted from the predictions before."""
        past, stride = self.config.model.past_steps, self.config.model.stride_frames
        window, reliable = windows["location"][:, :, :past], windows["reliable"][:, :, :past]
        exists = windows["exists"]
        earliest, latest = PREDICTED_RANGE_FRAMES
        motion, collision = [], []
        weight_sum = torch.zeros((), device=window.device)
        for step in range(1, self.config.rollout_steps + 1):
            positions, logits = self.network.predict(window, reliable, windows["static"], exists)
            predicted, target = positions / LENGTH_WORLD, windows["location"][:, :, past - 1 + step] / LENGTH_WORLD
            error = F.smooth_l1_loss(predicted, target, beta=SMOOTH_L1_BETA, reduction="none").sum(-1)
            weight = (windows["reliable"][:, :, past - 1 + step] & exists).float()
            motion.append((error * weight).sum())
            weight_sum = weight_sum + weight.sum()
            until = windows["until"] - stride * step
            collision.append(pair_loss(logits, (until >= earliest) & (until <= latest), exists))
            window = torch.cat([window[:, :, 1:], positions[:, :, None]], 2)
            reliable = torch.cat([reliable[:, :, 1:], torch.ones_like(reliable[:, :, :1])], 2)
        return torch.stack(motion).sum() / weight_sum.clamp(min=1), torch.stack(collision).mean()

    def evaluate(self, model: nn.Module) -> dict[str, float]:
        """Scores of observed collisions, and errors of rollouts, on the held-out scenes."""
        return self.measure(StatePredictor(self.network.eval()))
