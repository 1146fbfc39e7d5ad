"""Train the collision network: `nsdr train collisions --config collisions --run-dir runs/collisions`."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple, cast

import numpy as np
import torch
from torch import Tensor, nn

from nsdr.dynamics.collisions.features import (
    MotionArrays,
    NetworkInputs,
    arrays_from_states,
    near_pairs,
    network_inputs,
)
from nsdr.dynamics.collisions.network import (
    STEP_FRAMES,
    CollisionNetwork,
    CollisionNetworkConfig,
    TrackCollisionDetector,
)
from nsdr.dynamics.metrics import collision_scores
from nsdr.dynamics.propnet.data import MotionDataset, read_motion_dataset
from nsdr.io.worlds import stored_world
from nsdr.training.loop import LoopConfig, LossTerm, Task, held_out, train_part
from nsdr.training.run_folder import parse_training
from nsdr.validation import Count, NotNegative, PathName, PositiveCount, Settings, Share

HELD_OUT_EVERY = 5
"""Scenes whose index is divisible by this number are kept out of training: for evaluation, and to weigh the network's evidence
against that of the fit (`benchmarks.collisions`)."""
HIDDEN_FRAMES = (6, 50)
"""Range of the lengths of made-up gaps and errors in tracks (frames)."""
NEAR_COLLISION_SHARE = 0.6
"""Share of these that are drawn around a collision."""
BIAS_WORLD = 0.03
"""Standard deviation of made-up errors of positions at their largest (world units in CLEVRER)."""


@dataclass(frozen=True)
class CollisionTraining(Settings):
    """Training of the collision network on tracks of real proposals.

    Attributes:
        proposals: compact proposals of the training scenes (NPZ).
        truth: ground-truth blocks of the same scenes (gzipped JSON).
        run_dir: folder of the run; an interrupted run is resumed.
        output: folder of the finished checkpoint; "" for `run_dir/checkpoint`.
        limit: maximum number of scenes; 0 for all.
        noise_world: standard deviation of the noise added to positions (world units).
        gap_share: share of the scenes in which an object's detections are taken away for a while.
        bias_share: share of the scenes in which an object's positions get an error for a while.
        evaluation_scenes: maximum number of held-out scenes to evaluate on.
        model: the network.
        loop: the optimisation.
    """

    proposals: PathName
    truth: PathName
    run_dir: PathName
    output: str = ""
    limit: Count = 0
    noise_world: NotNegative = 0.002
    gap_share: Share = 0.4
    bias_share: Share = 0.25
    evaluation_scenes: PositiveCount = 600
    model: CollisionNetworkConfig = field(default_factory=CollisionNetworkConfig)
    loop: LoopConfig = field(default_factory=LoopConfig)


class _Example(NamedTuple):
    """What is drawn for one scene: its index, mirroring, and the seed of its noise."""

    scene: int
    mirror: bool
    seed: int


class CollisionTask(Task):
    """Cross-entropy of each pair's step of collision, or of none."""

    def __init__(self, config: CollisionTraining) -> None:
        self.config = config
        kept = f"{config.run_dir}/motion.npz"
        data = read_motion_dataset(config.proposals, config.truth, kept, config.limit or None)
        self.world = data.world
        torch.manual_seed(config.loop.seed)
        self.model: nn.Module = CollisionNetwork(config.model, self.world)
        is_held_out = held_out(data.scene, HELD_OUT_EVERY, config.proposals)
        self.data: MotionDataset = data.subset(~is_held_out)
        self.held_out: MotionDataset = data.subset(np.flatnonzero(is_held_out)[: config.evaluation_scenes])
        self.arrays = [arrays_from_states(self.data.states(i)[0]) for i in range(len(self.data))]

    def draw(self, count: int, rng: np.random.Generator, step: int) -> list[_Example]:
        """Random scenes, half of them mirrored."""
        scenes, mirrored = rng.integers(len(self.data), size=count), rng.random(count) < 0.5
        seeds = rng.integers(2**31, size=count)
        return [_Example(*x) for x in zip(scenes.tolist(), mirrored.tolist(), seeds.tolist(), strict=True)]

    def collate(self, examples: Sequence[_Example]) -> dict[str, Any]:
        """Inputs of all objects and near pairs of B scenes.

        Returns:
            inputs: `NetworkInputs`.
            frame: (P,) float32, each pair's frame of collision, negative for none.
            scenes: B.
        """
        disturbed = [self._disturbed(e) for e in examples]
        pairs, frames, first = [], [], 0
        for example, arrays in zip(examples, disturbed, strict=True):
            near = near_pairs(arrays.location_world, arrays.radius, self.world.scales)
            frames.append(self.data.collision_frame[example.scene][near[:, 0], near[:, 1]])
            pairs.append(near + first)
            first += len(arrays.location_world)
        joined = MotionArrays(
            *(np.concatenate([getattr(a, name) for a in disturbed]) for name in MotionArrays.__dataclass_fields__)
        )
        inputs = network_inputs(joined, np.concatenate(pairs), self.world.scales)
        frame = torch.from_numpy(np.concatenate(frames).astype(np.float32))
        return {"inputs": inputs, "frame": frame, "scenes": len(examples)}

    def _disturbed(self, example: _Example) -> MotionArrays:
        """A scene's arrays, mirrored, with noise, and perhaps with a gap or an error in one object's track."""
        c, rng, a = self.config, np.random.default_rng(example.seed), self.arrays[example.scene]
        location = a.location_world + c.noise_world * rng.normal(size=a.location_world.shape)
        detected, reliable, hidden, box = (x.copy() for x in (a.detected, a.reliable, a.hidden, a.box_px))
        if rng.random() < c.gap_share and (stretch := self._stretch(example.scene, rng)):
            i, frames = stretch
            detected[i, frames] = reliable[i, frames] = False
            hidden[i, frames] = False
            seen, every = np.flatnonzero(detected[i]), np.arange(detected.shape[1])
            for column in (*location[i].T, *box[i].T):
                column[frames] = np.interp(every, seen, column[seen])[frames]
        if rng.random() < c.bias_share and (stretch := self._stretch(example.scene, rng)):
            i, frames = stretch
            reliable[i, frames] = False
            hidden[i, frames, rng.integers(4)] = detected[i, frames]
            length = frames.stop - frames.start
            rise = np.sin(np.pi * (np.arange(length) + 0.5) / length)
            location[i, frames] += BIAS_WORLD * self.world.scales.size * rise[:, None] * rng.normal(size=2)
        if example.mirror:
            location = location * (1, -1)
            hidden, box = hidden[..., [2, 1, 0, 3]], box * (-1, 1, 1, 1)  # only differences of columns are used
        return MotionArrays(location, detected, reliable, a.present, hidden, box, a.size, a.static, a.radius)

    def _stretch(self, scene: int, rng: np.random.Generator) -> tuple[int, slice] | None:
        """An object and frames within its track, often around one of its collisions; None where they would reach its ends."""
        present, frames = self.arrays[scene].present, self.data.collision_frame[scene]
        length = int(rng.integers(*HIDDEN_FRAMES))
        collisions = np.argwhere(frames >= 0)
        if len(collisions) and rng.random() < NEAR_COLLISION_SHARE:
            i, j = collisions[rng.integers(len(collisions))].tolist()
            start = int(frames[i, j]) - int(rng.integers(length))
        else:
            i, start = int(rng.integers(len(present))), int(rng.integers(present.shape[1]))
        known = np.flatnonzero(present[i])
        if start < known[0] + 2 or start + length > known[-1] - 2:
            return None
        return i, slice(start, start + length)

    def losses(self, model: nn.Module, batch: Mapping[str, Any]) -> dict[str, LossTerm]:
        """`collision`: cross-entropy summed over pairs, for each scene."""
        logits = cast(CollisionNetwork, model)(NetworkInputs(*batch["inputs"]))
        return {"collision": LossTerm(step_loss(logits, batch["frame"]), batch["scenes"])}

    def evaluate(self, model: nn.Module) -> dict[str, float]:
        """Scores of collisions more probable than not, on the held-out scenes."""
        detector = TrackCollisionDetector(cast(CollisionNetwork, model).eval())
        found = []
        for i in range(len(self.held_out)):
            states, true = self.held_out.states(i)
            found.append(([event for event, p in detector.collision_candidates(states) if p > 0.5], true))
        missing = sum(len({e.objects for e in true} - {e.objects for e in some}) for some, true in found)
        extra = sum(len({e.objects for e in some} - {e.objects for e in true}) for some, true in found)
        return {**collision_scores(found), "missing_pairs": missing, "extra_pairs": extra}


def step_loss(logits: Tensor, frame: Tensor) -> Tensor:
    """Sum of the pairs' cross-entropies.

    Args:
        logits: (P, S) of steps of `STEP_FRAMES` frames, against 0 for no collision.
        frame: (P,) of each pair's collision, negative for none; between two steps it counts for both, in shares.
    """
    steps = logits.shape[1]
    apart = (frame[:, None] / STEP_FRAMES - torch.arange(steps, device=logits.device)).abs()
    target = (1 - apart).clamp(min=0) * (frame >= 0)[:, None]
    target = target / target.sum(1, keepdim=True).clamp(min=1e-6)
    none = torch.zeros_like(logits[:, :1])
    return (torch.cat([none, logits], 1).logsumexp(1) - (target * logits).sum(1)).sum()


def main(argv: Sequence[str] | None = None) -> str:
    """Train from command-line arguments; returns the folder of the finished checkpoint."""
    config = parse_training(CollisionTraining, argv, "collisions")
    task = CollisionTask(config)
    return train_part("collisions", task, config, config.model, stored_world(task.world))
