"""Train the dynamics predictor: `nsdr train dynamics --config propnet --run-dir runs/dynamics`.

Here is the task of the network on states, the default; those of the paper's networks are in `patch_dynamics`.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, cast

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional as F

from nsdr.dynamics.motion_states import extrapolate
from nsdr.dynamics.propnet.state_model import PropNet
from nsdr.dynamics.propnet.state_predictor import PropNetPredictor
from nsdr.io.worlds import stored_world
from nsdr.training.loop import LossTerm, train_part
from nsdr.training.patch_dynamics import ImagePropNetTask, PatchPropNetTask
from nsdr.training.run_folder import parse_training
from nsdr.training.track_task import FIRST_PRESENT_FRAME, DynamicsTraining, TrackTask, joined, pair_loss

FORWARD_FRAMES_BEFORE_COLLISION = 14
"""Near a collision, the forward network's present is at most this many frames before it, and never after."""
OBSERVER_FRAMES_AROUND_COLLISION = 7
"""Near a collision, the observer's present is at most this many frames before or after it."""
OBSERVED_TOLERANCE_FRAMES = 2
"""The observer should report a collision that is at most this many frames from its present."""
PREDICTED_RANGE_FRAMES = (-2, 1)
"""The forward network should report a collision whose frame, minus the frame that a step predicts, is in this closed range."""
SMOOTH_L1_BETA = 0.2
"""Position error at which the motion loss changes from quadratic to linear (in units of `PropNet.length_world`)."""


class _Window(NamedTuple):
    """What is drawn for one window: scene, present frame, noise (N, K, 2), yaw (radians) and mirroring (-1 or 1)."""

    scene: Any
    frame: Any
    noise: Any
    yaw: Any
    mirror: Any


class PropNetTask(TrackTask):
    """Motion and collision losses of the forward network over several steps, and collision loss of the observer.

    Scenes are rotated and mirrored at random: the network's inputs are relative, so the world has no preferred direction.
    """

    def __init__(self, config: DynamicsTraining) -> None:
        super().__init__(config)
        self.margin = max(config.model.past_steps, config.model.side_steps) * config.model.stride_frames
        self.locations = extrapolate(self.data.location_world, self.margin).astype(np.float32)

    def network(self) -> PropNet:
        """The network, with random weights."""
        return PropNet(self.config.model, self.world)

    def draw(self, count: int, rng: np.random.Generator, step: int) -> list[tuple[_Window, _Window]]:
        """A window of the forward network and one of the observer for each example."""
        c = self.config.model
        scenes, frames = self.draw_windows(count, rng, FORWARD_FRAMES_BEFORE_COLLISION, 0)
        frames = np.clip(frames, FIRST_PRESENT_FRAME, self.data.last_frame - 1)
        forward = self._disturbed(scenes, frames, c.past_steps + self.config.rollout_steps, rng)
        around = OBSERVER_FRAMES_AROUND_COLLISION
        scenes, frames = self.draw_windows(count, rng, around, around)
        observer = self._disturbed(scenes, np.clip(frames, 0, self.data.last_frame), 2 * c.side_steps + 1, rng)
        return list(zip(forward, observer, strict=True))

    def _disturbed(
        self, scenes: NDArray[Any], frames: NDArray[Any], samples: int, rng: np.random.Generator
    ) -> list[_Window]:
        count, objects = len(scenes), self.locations.shape[1]
        noise = rng.normal(size=(count, objects, samples, 2)) * self.config.noise_world
        yaw, mirror = rng.uniform(0, 2 * np.pi, count), rng.choice([-1.0, 1.0], count)
        return [_Window(*choices) for choices in zip(scenes, frames, noise, yaw, mirror, strict=True)]

    def collate(self, examples: Sequence[tuple[_Window, _Window]]) -> dict[str, dict[str, Tensor]]:
        """Windows of B examples for the forward network and the observer, both as `_windows` makes them: (B, N, ...)."""
        c = self.config.model
        past = np.arange(-c.past_steps + 1, self.config.rollout_steps + 1) * c.stride_frames
        whole = np.arange(-c.side_steps, c.side_steps + 1) * c.stride_frames
        forward, observer = (_Window(*map(np.stack, zip(*part, strict=True))) for part in zip(*examples, strict=True))
        return {"forward": self._windows(forward, past), "observer": self._windows(observer, whole)}

    def _windows(self, drawn: _Window, offsets: NDArray[Any]) -> dict[str, Tensor]:
        """Windows of K samples at `offsets` (frames) from the present frames.

        Returns:
            location: (B, N, K, 2) float32, noisy, rotated and mirrored (world units); outside the video extrapolated.
            reliable: (B, N, K) bool, False outside the video.
            static, exists, until: see `targets`.
        """
        scenes, frames, noise, yaw, mirror = drawn
        index, rows = frames[:, None] + offsets, scenes[:, None]
        extended = np.clip(index + self.margin, 0, self.locations.shape[2] - 1)
        location = self.locations[rows, :, extended].transpose(0, 2, 1, 3)  # (B, N, K, 2)
        rotation = np.stack([np.cos(yaw), -np.sin(yaw) * mirror, np.sin(yaw), np.cos(yaw) * mirror], 1)
        location = np.einsum("bnki,bji->bnkj", location + noise, rotation.reshape(-1, 2, 2)).astype(np.float32)
        last = self.data.last_frame
        is_inside = (index >= 0) & (index <= last)
        reliable = self.data.reliable[rows, :, np.clip(index, 0, last)].transpose(0, 2, 1) & is_inside[:, None]
        motion = {"location": torch.from_numpy(location), "reliable": torch.from_numpy(reliable)}
        return motion | self.targets(scenes, frames, location.shape[1])

    def losses(self, model: nn.Module, batch: Mapping[str, Mapping[str, Tensor]]) -> dict[str, LossTerm]:
        """`motion` and `collision` of the forward network on windows (B, N, ...), and `observed`, the observer's collisions."""
        network, observer = cast(PropNet, model), batch["observer"]
        motion, collision = self._forward_losses(network, batch["forward"])
        logits = network.observe(*(observer[k] for k in ("location", "reliable", "static", "exists")))
        collides = observer["until"].abs() <= OBSERVED_TOLERANCE_FRAMES
        return {"motion": motion, "collision": collision, "observed": pair_loss(logits, collides, observer["exists"])}

    def _forward_losses(self, network: PropNet, windows: Mapping[str, Tensor]) -> tuple[LossTerm, LossTerm]:
        """Motion and collision loss of `rollout_steps` steps, each predicted from the predictions before."""
        past, stride = self.config.model.past_steps, self.config.model.stride_frames
        window, reliable = windows["location"][:, :, :past], windows["reliable"][:, :, :past]
        exists = windows["exists"]
        earliest, latest = PREDICTED_RANGE_FRAMES
        motion, collision = [], []
        for step in range(1, self.config.rollout_steps + 1):
            positions, logits = network.predict(window, reliable, windows["static"], exists)
            target = windows["location"][:, :, past - 1 + step] / network.length_world
            predicted = positions / network.length_world
            error = F.smooth_l1_loss(predicted, target, beta=SMOOTH_L1_BETA, reduction="none").sum(-1)
            weight = (windows["reliable"][:, :, past - 1 + step] & exists).float()
            motion.append(LossTerm((error * weight).sum(), weight.sum()))
            until = windows["until"] - stride * step
            collision.append(pair_loss(logits, (until >= earliest) & (until <= latest), exists))
            window = torch.cat([window[:, :, 1:], positions[:, :, None]], 2)
            reliable = torch.cat([reliable[:, :, 1:], torch.ones_like(reliable[:, :, :1])], 2)
        return joined(motion), joined(collision)

    def evaluate(self, model: nn.Module) -> dict[str, float]:
        """Scores of observed collisions, and errors of rollouts, on the held-out scenes."""
        return self.measure(PropNetPredictor(cast(PropNet, model)))


def main(argv: Sequence[str] | None = None) -> str:
    """Train from command-line arguments; returns the folder of the finished checkpoint."""
    config = parse_training(DynamicsTraining, argv, "dynamics")
    mean_with = config.initial if config.mean_with_initial else ""
    kinds: dict[str, type[TrackTask]] = {
        "propnet": PropNetTask,
        "propnet_patches": PatchPropNetTask,
        "propnet_images": ImagePropNetTask,
    }
    task = kinds[config.network](config)
    details = {"network": config.network, **stored_world(task.world)}
    if config.network == "propnet":
        return train_part("dynamics", task, config, config.model, details, mean_with=mean_with)
    inputs = {"scenes": [len(task.data), len(task.held_out)]}
    return train_part("dynamics", task, config, config.patches, details, inputs, mean_with)
