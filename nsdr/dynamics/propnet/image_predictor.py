"""The paper's dynamics predictor with images: the predicted patches feed the rollout."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from nsdr.dynamics.base import VideoPixels
from nsdr.dynamics.motion_states import MotionStates, object_features, states_from_tracks
from nsdr.dynamics.propnet.image_model import ImageModel
from nsdr.dynamics.propnet.image_patches import MAX_VALUE, PATCH_CHANNELS, object_patches
from nsdr.dynamics.propnet.patch_model import PatchModelConfig
from nsdr.dynamics.propnet.patch_predictor import PatchPredictor
from nsdr.errors import DataError
from nsdr.io.device import limit_threads
from nsdr.types import DynamicsPrediction, Event, VideoTracks

__all__ = ["ImagePredictor"]

FloatArray = NDArray[np.floating[Any]]
BoolArray = NDArray[np.bool_]


class ImagePredictor(PatchPredictor):
    """PropNet over image and mask patches (paper, section 4.2), rolled out as `PatchPredictor` does.

    `MotionStates` that are given to its methods must hold `patches`.

    Differs from the paper: see `ImageModel`; frames of collisions are interpolated within the step.
    """

    reads_images = True
    built_from = (PatchModelConfig, ImageModel)
    default_checkpoint = "dynamics_paper_images"

    @limit_threads(1)
    def predict(
        self, tracks: VideoTracks, observed: Sequence[Event] | None = None, pixels: VideoPixels | None = None
    ) -> DynamicsPrediction:
        """As of `PatchPredictor`, with the video's pixels.

        Raises:
            DataError: no pixels are given, or they are not those of the tracks.
        """
        if pixels is None:
            raise DataError("dynamics 'paper_images' reads images; give videos, or use another backend")
        states = states_from_tracks(tracks, self.smoothing.measurement.visibility)
        patches = object_patches(pixels.frames, pixels.proposals, tracks, states, self.config)
        return self._predict(replace(states, patches=patches), observed)

    def _known(self, states: MotionStates) -> FloatArray:
        """(n, margin + F, 4 + K): boxes, and the patches of every frame; before the video those of the first frame."""
        if states.patches is None:
            raise DataError("the network on images needs states with patches")
        boxes = super()._known(states)
        margin = boxes.shape[1] - states.patches.shape[1]
        patches = np.pad(states.patches, [(0, 0), (margin, 0), (0, 0), (0, 0), (0, 0)], mode="edge")
        flat = patches.reshape(*patches.shape[:2], -1).astype(np.float32) / MAX_VALUE
        return np.concatenate([boxes, flat], -1)

    @torch.no_grad()
    def _step(self, window: FloatArray, states: MotionStates, here: BoolArray) -> tuple[FloatArray, FloatArray]:
        """What is seen (C, n, 4 + K) a step later, and collision probabilities (C, n, n, window)."""
        cells = self.config.patch_cells
        seen = torch.from_numpy(window.astype(np.float32))
        patches = seen[..., 4:].unflatten(-1, (PATCH_CHANNELS, cells, cells))
        static = torch.from_numpy(object_features(states.objects)).expand(len(window), -1, -1)
        inputs = (seen[..., :4], patches, static, torch.from_numpy(here.copy()))
        boxes, following, logits = (x.float().cpu() for x in self.model(*(x.to(self.device) for x in inputs)))
        possible = here[:, :, None] & here[:, None]
        probability = logits.sigmoid().numpy().astype(float) * possible[..., None]
        return torch.cat([boxes, following.flatten(2)], -1).numpy().astype(float), probability
