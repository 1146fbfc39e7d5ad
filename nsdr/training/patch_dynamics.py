"""Training tasks of PropNet on patches: of masks (`network: propnet_patches`), and of images (`propnet_images`)."""

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, ClassVar, NamedTuple, cast

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from nsdr.dynamics.motion_states import MotionStates
from nsdr.dynamics.propnet.data import MotionDataset, read_image_dataset
from nsdr.dynamics.propnet.patch_model import STEP_SCALE, ImagePropNet, PatchPropNet, box_scale
from nsdr.dynamics.propnet.patch_predictor import ImagePropNetPredictor, PatchPropNetPredictor
from nsdr.dynamics.propnet.patches import MAX_VALUE, patch_boxes
from nsdr.training.loop import LossTerm
from nsdr.training.track_task import DynamicsTraining, TrackTask, joined, pair_loss
from nsdr.types import Event

NOISE_PX_PER_WORLD = 50.0
"""Noise of boxes for a noise of one world unit in `DynamicsTraining.noise_world` (px per world unit)."""
STEPS_AROUND_COLLISION = 2
"""Near a collision, the present is at most this many steps of `stride_frames` before or after it."""
DRAWN_FROM = 60 / 128
"""Share of a video's frames after which the patches of held-out scenes are drawn and compared."""
DRAWN_STEPS = (1, 5)
"""Steps after which drawn patches are compared."""


class _Window(NamedTuple):
    """What is drawn for one window: scene, present frame, noise (N, K, 4) in units of `box_scale` and mirroring (-1 or 1)."""

    scene: Any
    frame: Any
    noise: Any
    mirror: Any


class PatchPropNetTask(TrackTask):
    """Squared error of the boxes one step later, and cross-entropy of the collisions within each step.

    A batch holds scenes with the same number of objects, mirrored at random: the camera looks along the world's x axis.

    Attributes:
        predicted: what the network reads and predicts, and the name of its loss.
        box_weights: weights of the squared errors of column, row, width and height.
    """

    predicted: ClassVar[Mapping[str, str]] = {"boxes": "motion"}
    box_weights: ClassVar[Sequence[float]] = (1.0, 1.0, 1.0, 1.0)

    def __init__(self, config: DynamicsTraining) -> None:
        super().__init__(config)
        self.margin = (config.patches.window - 1) * config.patches.stride_frames
        d = self.data
        self.boxes = _boxes(d, self.margin)

    def network(self) -> nn.Module:
        """The network, with random weights."""
        return PatchPropNet(self.config.patches, self.world)

    def draw(self, count: int, rng: np.random.Generator, step: int) -> list[_Window]:
        """Windows of scenes that have the same number of objects, as that of a random window."""
        c, steps = self.config.patches, self.config.rollout_steps
        near = STEPS_AROUND_COLLISION * c.stride_frames
        objects = int(self.object_count[self.draw_windows(1, rng, near, near)[0][0]])
        scenes, frames = self.draw_windows(count, rng, near, near, objects)
        frames = np.clip(frames, 0, self.data.last_frame - c.stride_frames * steps)
        noise_px = self.config.noise_world * NOISE_PX_PER_WORLD
        noise = rng.normal(size=(count, objects, c.window + steps, 4)) * noise_px / np.array(box_scale(self.world))
        mirror = rng.choice([-1.0, 1.0], count)
        return [_Window(*choices) for choices in zip(scenes, frames, noise, mirror, strict=True)]

    def collate(self, examples: Sequence[_Window]) -> dict[str, Tensor]:
        """Windows of B scenes with N objects each; K = window + rollout_steps samples.

        Returns:
            boxes: (B, N, K, 4) float32, noisy, in units of `box_scale`.
            reliable: (B, N, K) bool.
            static, exists, until: see `targets`.
        """
        scenes, frames, noise, mirror = map(np.stack, zip(*examples, strict=True))
        n = noise.shape[1]
        index = frames[:, None] + self._offsets()
        boxes = self.boxes[scenes[:, None], :n, index + self.margin].transpose(0, 2, 1, 3) + noise.astype(np.float32)
        boxes[..., 0] *= mirror[:, None, None]
        reliable = self.data.reliable[scenes[:, None], :n, np.maximum(index, 0)].transpose(0, 2, 1)
        motion = {"boxes": torch.from_numpy(np.ascontiguousarray(boxes)), "reliable": torch.from_numpy(reliable)}
        return motion | self.targets(scenes, frames, n)

    def _offsets(self) -> NDArray[np.int_]:
        """(K,) frames of a window's samples, from its present."""
        c = self.config.patches
        return np.arange(-c.window + 1, self.config.rollout_steps + 1) * c.stride_frames

    def rollout(
        self, model: nn.Module, batch: Mapping[str, Tensor], steps: int
    ) -> Iterator[tuple[list[Tensor], Tensor]]:
        """For each step what `predicted` lists, and the logits of collisions (B, N, N, window).

        A step goes on from the predictions before it; gradients do not pass from step to step.
        """
        windows = [batch[name][:, :, : self.config.patches.window] for name in self.predicted]
        for _ in range(steps):
            *found, logits = model(*windows, batch["static"], batch["exists"])
            yield found, logits
            windows = [torch.cat([w[:, :, 1:], f[:, :, None].detach()], 2) for w, f in zip(windows, found, strict=True)]

    def losses(self, model: nn.Module, batch: Mapping[str, Tensor]) -> dict[str, LossTerm]:
        """Squared errors of what is predicted, as `predicted` names them, and `collision`, the cross-entropy of pairs."""
        exists, c = batch["exists"], self.config.patches
        terms: dict[str, list[LossTerm]] = defaultdict(list)
        for step, (found, logits) in enumerate(self.rollout(model, batch, self.config.rollout_steps)):
            weight = (batch["reliable"][:, :, c.window + step] & exists).float()
            for (name, loss), values in zip(self.predicted.items(), found, strict=True):
                error = self._error(name, values, batch[name][:, :, c.window + step])
                terms[loss].append(LossTerm((error * weight).sum(), weight.sum()))
            for k in range(c.window):
                until = batch["until"] + c.stride_frames * (k - step)
                hits = (until >= 1) & (until <= c.stride_frames)
                terms["collision"].append(pair_loss(logits[..., k], hits, exists))
        return {name: joined(of_steps) for name, of_steps in terms.items()}

    def _error(self, name: str, found: Tensor, true: Tensor) -> Tensor:
        """Squared error (B, N) of boxes (B, N, 4), or of patches (B, N, 4, cells, cells)."""
        if name == "patches":
            return (found - true).square().sum(2).mean((-1, -2))
        return (((found - true) / STEP_SCALE).square() * torch.tensor(self.box_weights, device=found.device)).sum(-1)

    def evaluate(self, model: nn.Module) -> dict[str, float]:
        """Scores of observed collisions, and errors of rollouts, on the held-out scenes."""
        return self.measure(PatchPropNetPredictor(cast(PatchPropNet, model)))


class ImagePropNetTask(PatchPropNetTask):
    """As `PatchPropNetTask`, with the squared error of drawn patches.

    Patches lie in `run_dir/patches` and are read from there, not held in memory. The boxes' weights are uneven because whole
    pixels of the masks' bounds and turning cubes would make up most of the loss, and nothing but the next boxes depends on
    sizes.
    """

    predicted = {"boxes": "motion", "patches": "image"}  # noqa: RUF012
    box_weights = (5.0, 5.0, 0.25, 0.25)

    def network(self) -> nn.Module:
        """The network, with random weights."""
        return ImagePropNet(self.config.patches, self.world)

    def read(self) -> MotionDataset:
        """The scenes of the data set; their patches are kept beside them."""
        c = self.config
        data, files = read_image_dataset(c.data, f"{c.run_dir}/patches", c.patches, c.limit or None)
        self._files = dict(zip(data.scene.tolist(), files, strict=True))
        return data

    def states(self, index: int) -> tuple[MotionStates, list[Event]]:
        """A held-out scene with patches, and its true collisions."""
        states, events = super().states(index)
        return replace(states, patches=np.array(self._patches(self.held_out.scene[index]))), events

    def _patches(self, scene: int) -> NDArray[np.uint8]:
        """(n, F, 4, cells, cells) of a scene, mapped from its file."""
        return cast(NDArray[np.uint8], np.load(self._files[int(scene)], mmap_mode="r"))

    def collate(self, examples: Sequence[_Window]) -> dict[str, Tensor]:
        """As in `PatchPropNetTask`, and `patches` (B, N, K, 4, cells, cells) float32 in 0-1."""
        patches = []
        for example in examples:
            frames = np.maximum(example.frame + self._offsets(), 0)
            cut = self._patches(self.data.scene[example.scene])[:, frames]
            patches.append(cut[..., ::-1] if example.mirror < 0 else cut)
        return {**super().collate(examples), "patches": torch.from_numpy(np.stack(patches)).float() / MAX_VALUE}

    def evaluate(self, model: nn.Module) -> dict[str, float]:
        """Scores of observed collisions, and errors of rollouts and of drawn patches, on the held-out scenes."""
        network = cast(ImagePropNet, model)
        return self.measure(ImagePropNetPredictor(network)) | self._drawing_errors(network)

    @torch.no_grad()
    def _drawing_errors(self, model: ImagePropNet) -> dict[str, float]:
        """Mean absolute errors (0-1) of patches `DRAWN_STEPS` later: of those drawn, and of the last one seen (`_kept`)."""
        c, h, found = self.config.patches, self.held_out, defaultdict[str, list[float]](list)
        device = next(model.parameters()).device
        first = round(DRAWN_FROM * (h.last_frame + 1))
        every = first + np.arange(1 - c.window, 1 + max(DRAWN_STEPS)) * c.stride_frames
        all_boxes = _boxes(h, 0)
        for i in range(len(h)):
            here = np.flatnonzero(h.exists[i] & h.present[i, :, first] & h.reliable[i][:, every].all(1))
            if not len(here):
                continue
            true = torch.from_numpy(self._patches(h.scene[i])[here][:, every]).to(device).float()[None] / MAX_VALUE
            batch = {
                "boxes": torch.from_numpy(all_boxes[i, here][:, every]).to(device)[None],
                "patches": true,
                "static": torch.from_numpy(h.static[i, here]).to(device)[None],
                "exists": torch.ones(1, len(here), dtype=torch.bool, device=device),
            }
            for step, ((_, drawn), _) in enumerate(self.rollout(model, batch, max(DRAWN_STEPS)), 1):
                if step in DRAWN_STEPS:
                    target = true[:, :, c.window - 1 + step]
                    found[f"image_error_{step}"].append(float((drawn - target).abs().mean()))
                    found[f"image_error_{step}_kept"].append(float((true[:, :, c.window - 1] - target).abs().mean()))
        return {name: float(np.mean(values)) for name, values in found.items()}


def _boxes(data: MotionDataset, margin: int) -> NDArray[np.float32]:
    """(S, N, margin + F, 4) the boxes of a data set, as `patch_boxes` makes them."""
    of_data = data.location_world, data.heights(), data.box_px, data.reliable
    return patch_boxes(*of_data, margin, data.world).astype(np.float32)
