"""Train the dynamics predictor: `nsdr train dynamics --config configs/dynamics/state.yaml --run_dir runs/dynamics`."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional as F

from nsdr.dynamics.metrics import collision_scores, rollout_errors
from nsdr.dynamics.motion_states import extrapolate
from nsdr.dynamics.propnet.data import MotionDataset, read_motion_dataset
from nsdr.dynamics.propnet.patch_model import PatchModelConfig
from nsdr.dynamics.propnet.patch_predictor import PatchPredictor
from nsdr.dynamics.propnet.state_model import LENGTH_WORLD, StateModel, StateModelConfig
from nsdr.dynamics.propnet.state_predictor import StatePredictor
from nsdr.errors import DataError
from nsdr.io.checkpoint import load_checkpoint, save_checkpoint
from nsdr.io.configuration import described, parse_config, resolved
from nsdr.training.loop import LoopConfig, Task, train

__all__ = ["DynamicsTraining", "TrackTask", "main", "pair_loss"]


@dataclass(frozen=True)
class DynamicsTraining:
    """Training of the dynamics predictor on tracks of real proposals.

    Attributes:
        proposals: compact proposals of the training scenes (NPZ).
        truth: their ground-truth blocks (gzipped JSON).
        run_dir: where the run lives; an interrupted one goes on.
        output: folder of the finished checkpoint; "" for `run_dir/checkpoint`.
        initial: folder of a checkpoint to start from; "" starts from random weights.
        limit: use at most this many scenes; 0 for all.
        simulated: folder of simulated scenes (`nsdr generate dataset --renderer none`) to train on, too; "" for none.
        rollout_steps: predictions in a row that the network is trained on.
        noise_world: standard deviation of noise added to the observed positions (the patch network takes 50 px for a unit).
        evaluation_scenes: measured scenes (every 40th scene is kept out of training).
        network: "state" or "paper".
        model: sizes of the networks on states.
        patches: sizes of the paper's network.
        loop: the optimisation.
    """

    proposals: str
    truth: str
    run_dir: str
    output: str = ""
    initial: str = ""
    limit: int = 0
    simulated: str = ""
    rollout_steps: int = 5
    noise_world: float = 0.003
    evaluation_scenes: int = 100
    network: str = "state"
    model: StateModelConfig = field(default_factory=StateModelConfig)
    patches: PatchModelConfig = field(default_factory=PatchModelConfig)
    loop: LoopConfig = field(default_factory=LoopConfig)


class TrackTask(Task):
    """Real tracks, and scenes that are kept out of training."""

    def __init__(self, config: DynamicsTraining, network: nn.Module) -> None:
        self.config = config
        if config.initial:
            network.load_state_dict(load_checkpoint(config.initial, "dynamics")[0])
        self.model: nn.Module = network
        cache = f"{config.run_dir}/motion.npz"
        data = read_motion_dataset(
            config.proposals, config.truth, cache, config.limit or None, config.simulated or None
        )
        held_out = (np.arange(len(data)) % 40 == 0) & (data.scene >= 0)
        self.data: MotionDataset = data.part(~held_out)
        self.held_out: MotionDataset = data.part(np.flatnonzero(held_out)[: config.evaluation_scenes])
        n = self.data.collision_frame.shape[1]
        upper = self.data.collision_frame * np.triu(np.ones((n, n), int), 1)
        self.collisions = np.argwhere((upper > 0)[:, :, :])

    def pick(self, size: int, rng: np.random.Generator, before: int, after: int) -> tuple[NDArray[Any], NDArray[Any]]:
        """Scenes and times, about half of them close to a collision, the others anywhere."""
        scenes = rng.integers(len(self.data), size=size)
        times = rng.integers(4, 127, size=size)
        near = rng.random(size) < 0.5
        picked = self.collisions[rng.integers(len(self.collisions), size=size)]
        frames = self.data.collision_frame[picked[:, 0], picked[:, 1], picked[:, 2]]
        shifted = frames + rng.integers(-before, after + 1, size=size)
        return np.where(near, picked[:, 0], scenes), np.where(near, shifted, times)

    def measure(self, predictor: StatePredictor | PatchPredictor) -> dict[str, float]:
        """Collisions and rollouts of the left-out scenes."""
        scenes = [self.held_out.states(i) for i in range(len(self.held_out))]
        scores = collision_scores([(predictor.observed_collisions(states), events) for states, events in scenes])
        return scores | rollout_errors(predictor, [states for states, _ in scenes[:30]])


class StateModelTask(TrackTask):
    """Multi-step motion and collision losses of the forward network, collision loss of the observer."""

    def __init__(self, config: DynamicsTraining) -> None:
        torch.manual_seed(config.loop.seed)
        self.network = StateModel(config.model)
        super().__init__(config, self.network)
        self.margin = max(config.model.past_steps, config.model.side_steps) * config.model.stride_frames
        self.locations = extrapolate(self.data.location_world, self.margin).astype(np.float32)

    def batch(self, size: int, rng: np.random.Generator) -> dict[str, dict[str, Tensor]]:
        c = self.config.model
        stride = c.stride_frames
        past = np.arange(-c.past_steps + 1, self.config.rollout_steps + 1) * stride
        whole = np.arange(-c.side_steps, c.side_steps + 1) * stride
        scenes, times = self.pick(size, rng, before=14, after=0)
        forward = self._windows(scenes, np.clip(times, 4, 126), past, rng)
        scenes, times = self.pick(size, rng, before=7, after=7)
        return {"forward": forward, "observer": self._windows(scenes, np.clip(times, 0, 127), whole, rng)}

    def _windows(
        self, scenes: NDArray[Any], times: NDArray[Any], offsets: NDArray[Any], rng: np.random.Generator
    ) -> dict[str, Tensor]:
        data = self.data
        index = times[:, None] + offsets
        inside = (index >= 0) & (index < 128)
        clipped = np.clip(index, 0, 127)
        rows = scenes[:, None]
        shown = np.clip(index + self.margin, 0, self.locations.shape[2] - 1)
        location = self.locations[rows, :, shown].transpose(0, 2, 1, 3)  # (B, N, K, 2)
        noisy = location + rng.normal(size=location.shape) * self.config.noise_world
        angle = rng.uniform(0, 2 * np.pi, len(scenes))
        mirror = rng.choice([-1.0, 1.0], len(scenes))
        turn = np.stack([np.cos(angle), -np.sin(angle) * mirror, np.sin(angle), np.cos(angle) * mirror], 1)
        location = np.einsum("bnki,bji->bnkj", noisy, turn.reshape(-1, 2, 2)).astype(np.float32)
        reliable = data.reliable[rows, :, clipped].transpose(0, 2, 1) & inside[:, None]
        present = data.present[scenes, :, times]
        return {
            "location": torch.from_numpy(location),
            "reliable": torch.from_numpy(reliable),
            "static": torch.from_numpy(data.static[scenes]),
            "exists": torch.from_numpy(data.exists[scenes] & present),
            "until": torch.from_numpy((data.collision_frame[scenes] - times[:, None, None]).astype(np.int64)),
        }

    def losses(self, model: nn.Module, batch: Mapping[str, Mapping[str, Tensor]]) -> dict[str, Tensor]:
        device = next(model.parameters()).device
        forward, observer = ({k: v.to(device) for k, v in part.items()} for part in batch.values())
        motion, collision = self._forward_losses(forward)
        logits = self.network.observe(*(observer[k] for k in ("location", "reliable", "static", "exists")))
        seen = pair_loss(logits, observer["until"].abs() <= 2, observer["exists"])
        return {"motion": motion, "collision": collision, "observed": seen}

    def _forward_losses(self, b: Mapping[str, Tensor]) -> tuple[Tensor, Tensor]:
        """Predict several steps, each from the last predictions."""
        past, stride = self.config.model.past_steps, self.config.model.stride_frames
        window, reliable = b["location"][:, :, :past], b["reliable"][:, :, :past]
        motion, collision = [], []
        weight_sum = torch.zeros((), device=window.device)
        for step in range(1, self.config.rollout_steps + 1):
            positions, logits = self.network.predict(window, reliable, b["static"], b["exists"])
            target = b["location"][:, :, past - 1 + step]
            weight = (b["reliable"][:, :, past - 1 + step] & b["exists"]).float()
            error = F.smooth_l1_loss(positions / LENGTH_WORLD, target / LENGTH_WORLD, beta=0.2, reduction="none").sum(
                -1
            )
            motion.append((error * weight).sum())
            weight_sum = weight_sum + weight.sum()
            until = b["until"] - stride * step
            collision.append(pair_loss(logits, (until >= -2) & (until <= 1), b["exists"]))
            window = torch.cat([window[:, :, 1:], positions[:, :, None]], 2)
            reliable = torch.cat([reliable[:, :, 1:], torch.ones_like(reliable[:, :, :1])], 2)
        return torch.stack(motion).sum() / weight_sum.clamp(min=1), torch.stack(collision).mean()

    def evaluate(self, model: nn.Module) -> dict[str, float]:
        return self.measure(StatePredictor(self.network.eval()))


def pair_loss(logits: Tensor, target: Tensor, exists: Tensor) -> Tensor:
    """Cross-entropy of logits (B, N, N) over pairs of existing objects (B, N), summed over pairs, a mean over scenes."""
    n = logits.shape[1]
    upper = torch.triu(torch.ones(n, n, dtype=torch.bool, device=logits.device), 1)
    valid = exists[:, :, None] & exists[:, None] & upper
    loss = F.binary_cross_entropy_with_logits(logits, target.float(), reduction="none")
    return (loss * valid).sum() / len(logits)


def main(argv: Sequence[str] | None = None) -> str:
    """Train from command-line arguments; returns the folder of the finished checkpoint."""
    config = parse_config(DynamicsTraining, argv, "nsdr train dynamics")
    if config.network not in ("state", "paper"):
        raise DataError(f"network is {config.network!r}; expected state or paper")
    from nsdr.training.patch_dynamics import PatchModelTask  # it builds on this module

    task = StateModelTask(config) if config.network == "state" else PatchModelTask(config)
    metrics = train(task, config.loop, config.run_dir, resolved(config))
    output = config.output or f"{config.run_dir}/checkpoint"
    details = {"network": config.network, "metrics": metrics, "training": described(config)}
    model = config.model if config.network == "state" else config.patches
    save_checkpoint(output, "dynamics", task.model.state_dict(), model, details, half=True)
    return output
