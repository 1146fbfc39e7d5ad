"""What the training tasks of the dynamics networks share: the configuration, the tracks and the collision loss."""

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional as F

from nsdr.dynamics.metrics import collision_scores, rollout_errors
from nsdr.dynamics.motion_states import MotionStates
from nsdr.dynamics.propnet.data import MotionDataset, read_motion_dataset
from nsdr.dynamics.propnet.patch_model import PatchPropNetConfig
from nsdr.dynamics.propnet.patch_predictor import PatchPropNetPredictor
from nsdr.dynamics.propnet.state_model import PropNetConfig
from nsdr.dynamics.propnet.state_predictor import PropNetPredictor
from nsdr.errors import DataError
from nsdr.io.checkpoint import start_from
from nsdr.training.loop import LoopConfig, LossTerm, Task, held_out
from nsdr.types import Event
from nsdr.validation import Count, NotNegative, PositiveCount, Settings, expect

HELD_OUT_EVERY = 40
"""Scenes whose index is divisible by this number are kept out of training, for evaluation: the index alone decides, so that no
training sees what another one, with other scenes or another `limit`, holds out."""
NEAR_COLLISION_SHARE = 0.5
"""Share of each batch whose present is drawn close to a collision; the others are drawn uniformly."""
FIRST_PRESENT_FRAME = 4
"""First frame that is drawn as a window's present."""
ROLLOUT_SCENES = 30
"""Number of held-out scenes whose rollouts are measured."""


@dataclass(frozen=True)
class DynamicsTraining(Settings):
    """Training of the dynamics predictor on tracks of real proposals, or on videos for the network on images.

    Attributes:
        proposals: file of compact proposals of the training scenes (NPZ); not for "propnet_images".
        truth: file of ground-truth blocks of the same scenes (gzipped JSON); not for "propnet_images".
        run_dir: folder of the run; an interrupted run is resumed.
        output: folder of the finished checkpoint; "" for `run_dir/checkpoint`.
        initial: folder of a checkpoint to start from; "" starts from random weights.
        mean_with_initial: whether the finished checkpoint holds the mean of the weights of `initial` and the trained weights.
        limit: maximum number of scenes; 0 for all.
        data: for "propnet_images", the folder of a data set with `videos/`, `derender_proposals/` and `annotations/` of
            `train`, such as `nsdr generate dataset` makes.
        rollout_steps: number of consecutive predictions, each from the last ones, that a loss covers.
        noise_world: standard deviation of the noise added to observed positions (world units); for the network on patches,
            50 times this value is the noise added to boxes (px).
        evaluation_scenes: maximum number of held-out scenes (those whose index is divisible by 40) to evaluate on.
        network: "propnet" (on states), "propnet_patches" (the paper's network on patches of masks) or "propnet_images" (on
            patches of images and masks).
        model: the network on states.
        patches: the networks on patches.
        loop: the optimisation.
    """

    proposals: str = ""
    truth: str = ""
    run_dir: str = ""
    output: str = ""
    initial: str = ""
    mean_with_initial: bool = False
    limit: Count = 0
    data: str = ""
    rollout_steps: PositiveCount = 5
    noise_world: NotNegative = 0.003
    evaluation_scenes: PositiveCount = 100
    network: Literal["propnet", "propnet_patches", "propnet_images"] = "propnet"
    model: PropNetConfig = field(default_factory=PropNetConfig)
    patches: PatchPropNetConfig = field(default_factory=PatchPropNetConfig)
    loop: LoopConfig = field(default_factory=LoopConfig)

    def __post_init__(self) -> None:
        super().__post_init__()
        on_images = self.network == "propnet_images"
        for name in ("data", "run_dir") if on_images else ("proposals", "truth", "run_dir"):
            expect(bool(getattr(self, name).strip()), name, "a path", repr(getattr(self, name)))
        if self.mean_with_initial and not self.initial:
            raise DataError("mean_with_initial: needs a checkpoint to start from; give --initial FOLDER")
        useless = ("proposals", "truth") if on_images else ("data",)
        given = [name for name in useless if getattr(self, name)]
        if given:
            raise DataError(f"{', '.join(given)}: does nothing with network {self.network!r}; leave it out")


class TrackTask(Task):
    """Base of the dynamics tasks: a network, the tracks to train it on, and held-out scenes.

    Args:
        config: the training.

    Attributes:
        model: what is trained; starts from `config.initial` where that is given.
        world: the world that the scenes are of.
    """

    def __init__(self, config: DynamicsTraining) -> None:
        self.config = config
        data = self.read()
        self.world = data.world
        stride = (config.model if config.network == "propnet" else config.patches).stride_frames
        most = f"{data.last_frame // stride} or less, steps of {stride} frames in videos of {data.last_frame + 1}"
        expect(config.rollout_steps * stride <= data.last_frame, "rollout_steps", most, config.rollout_steps)
        torch.manual_seed(config.loop.seed)
        self.model = self.network()
        if config.initial:
            start_from(self.model, config.initial, "dynamics")
        is_held_out = held_out(data.scene, HELD_OUT_EVERY, config.data or config.proposals)
        self.data: MotionDataset = data.subset(~is_held_out)
        self.held_out: MotionDataset = data.subset(np.flatnonzero(is_held_out)[: config.evaluation_scenes])
        self.object_count = self.data.exists.sum(1)
        self.collisions = np.argwhere(np.triu(self.data.collision_frame, 1) > 0)

    @abstractmethod
    def network(self) -> nn.Module:
        """The network, with random weights."""

    def read(self) -> MotionDataset:
        """The scenes to train and evaluate on; kept in the run's folder, so that a resumed run need not make them again."""
        c = self.config
        return read_motion_dataset(c.proposals, c.truth, f"{c.run_dir}/motion.npz", c.limit or None)

    def states(self, index: int) -> tuple[MotionStates, list[Event]]:
        """A held-out scene and its true collisions."""
        return self.held_out.states(index)

    def draw_windows(
        self, size: int, rng: np.random.Generator, frames_before: int, frames_after: int, objects: int = 0
    ) -> tuple[NDArray[Any], NDArray[Any]]:
        """Scene indices (size,) and present frames (size,) of random windows.

        In `NEAR_COLLISION_SHARE` of them, a collision is drawn and the present is at most `frames_before` frames before it or
        `frames_after` frames after it, perhaps outside the video; in the others, scene and present are uniform. With
        `objects`, only scenes with this number of objects are drawn.
        """
        is_drawn = self.object_count == objects if objects else np.ones(len(self.data), bool)
        pool, collisions = np.flatnonzero(is_drawn), self.collisions[is_drawn[self.collisions[:, 0]]]
        scenes = pool[rng.integers(len(pool), size=size)]
        frames = rng.integers(FIRST_PRESENT_FRAME, self.data.last_frame, size=size)
        if not len(collisions):
            return scenes, frames
        near = rng.random(size) < NEAR_COLLISION_SHARE
        picked = collisions[rng.integers(len(collisions), size=size)]
        collision_frames = self.data.collision_frame[picked[:, 0], picked[:, 1], picked[:, 2]]
        shifted = collision_frames + rng.integers(-frames_before, frames_after + 1, size=size)
        return np.where(near, picked[:, 0], scenes), np.where(near, shifted, frames)

    def targets(self, scenes: NDArray[Any], frames: NDArray[Any], n: int) -> dict[str, Tensor]:
        """What windows of scenes (B,) with present frames (B,) have beside their motion, of the first n objects.

        Returns:
            static: (B, n, `feature_count`) float32, one-hot shape and material.
            exists: (B, n) bool, objects that are present.
            until: (B, n, n) int64, frames from the present to the pair's collision, negative after it.
        """
        d = self.data
        until = (d.collision_frame[scenes] - frames[:, None, None]).astype(np.int64)
        return {
            "static": torch.from_numpy(d.static[scenes, :n]),
            "exists": torch.from_numpy((d.exists[scenes] & d.present[scenes, :, frames])[:, :n]),
            "until": torch.from_numpy(until[:, :n, :n]),
        }

    def measure(self, predictor: PropNetPredictor | PatchPropNetPredictor) -> dict[str, float]:
        """Scores of observed collisions, and errors of rollouts, on the held-out scenes."""
        scenes = [self.states(i) for i in range(len(self.held_out))]
        scores = collision_scores([(predictor.observed_collisions(states), events) for states, events in scenes])
        return scores | rollout_errors(predictor, [states for states, _ in scenes[:ROLLOUT_SCENES]])


def pair_loss(logits: Tensor, target: Tensor, exists: Tensor) -> LossTerm:
    """Binary cross-entropy of pairs, summed over pairs, with the number of scenes.

    Args:
        logits: (B, N, N), symmetric; the entries above the diagonal count.
        target: (B, N, N) bool.
        exists: (B, N) bool; pairs with an object that does not exist are left out.
    """
    valid = (exists[:, :, None] & exists[:, None]).triu(1)
    loss = F.binary_cross_entropy_with_logits(logits, target.float(), reduction="none")
    return LossTerm((loss * valid).sum(), len(logits))


def joined(terms: Sequence[LossTerm]) -> LossTerm:
    """One term over the items of several."""
    totals, counts = zip(*terms, strict=True)
    return LossTerm(torch.stack(totals).sum(), sum(counts))
