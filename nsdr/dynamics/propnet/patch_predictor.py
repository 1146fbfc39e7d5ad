"""The paper's dynamics backends: rollouts of one-step predictions by a network on patches."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from nsdr.dynamics.base import Explanation
from nsdr.dynamics.motion_states import MotionStates, object_features
from nsdr.dynamics.propnet.explanation import NetworkExplanation
from nsdr.dynamics.propnet.patch_model import (
    PATCH_CHANNELS,
    ImagePropNet,
    PatchNetwork,
    PatchPropNet,
    PatchPropNetConfig,
    box_scale,
)
from nsdr.dynamics.propnet.patches import MAX_VALUE, boxes_of, object_patches
from nsdr.dynamics.track_smoothing import rollout_in_image, smooth_tracks, with_smoothed_tracks
from nsdr.errors import DataError
from nsdr.io.checkpoint import PretrainedPart
from nsdr.io.device import exact_convolutions, limit_threads
from nsdr.types import Event, Rollout
from nsdr.validation import BoolArray, FloatArray
from nsdr.world.world import ANY_LOOK, ANY_PLACE


class PatchPropNetPredictor(PretrainedPart[PatchNetwork]):
    """A dynamics backend with PropNet on patches of masks (section 4.2 of the paper).

    Collisions in the video are detected in the observed samples. The future is rolled out from the last samples. Without an
    object, its vertex and edges are removed from the graph, and the whole video is rolled out from the first samples; objects
    that come into view later enter as observed.

    Differs from the paper: see `PatchPropNet`; the frames of collisions are interpolated between samples.

    Args:
        model: the trained network.
    """

    part = "dynamics"
    built_from: ClassVar[tuple[type, type[nn.Module]]] = (PatchPropNetConfig, PatchPropNet)
    name = default_checkpoint = "propnet_patches"
    free = tuple(name for name in ANY_LOOK if name != "camera.") + ANY_PLACE

    def __init__(self, model: PatchNetwork) -> None:
        self.model = model.eval()
        self.config = model.config

    @limit_threads(1)
    def explain(self, states: MotionStates, collisions: Sequence[Event] | None = None) -> Explanation:
        """Detect the collisions in the video unless they are given; see `nsdr.dynamics.Dynamics`.

        Raises:
            DataError: the network was trained for another world.
        """
        self.check_world(states.world)
        observed = self.observed_collisions(states) if collisions is None else collisions
        smoothed = smooth_tracks(states, observed)

        def continued(frames: int) -> Rollout:
            return with_smoothed_tracks(self._future(states, observed, frames), smoothed)

        return NetworkExplanation(states, continued, lambda frames: self._without_each(states, frames))

    @limit_threads(1)
    def observed_collisions(self, states: MotionStates) -> list[Event]:
        """Collisions during the video, at most one for each pair, in its most probable step."""
        n, frames = states.present.shape
        if n < 2 or frames < 2:
            return []
        stride = self.config.stride_frames
        samples = np.arange(frames - 1, 0, -stride)[::-1]
        known = self._known(states)
        windows = np.stack([self._window(known, t) for t in samples])
        predicted = self._step(windows, states, states.present.T[samples])[1]
        return self._collisions(self._averaged(predicted)[:-1], samples)

    def _averaged(self, predicted: FloatArray) -> FloatArray:
        """Collision probabilities (S + 1, ...) of the steps that end at each of S samples, and of the step after the last.

        The network predicts the collisions of a step at its start, at its end and one step later, when their effect is seen.
        The probability is the mean of these predictions.

        Args:
            predicted: (S, ..., window) predictions at each sample for the next step, the step that ends there, and those
                before.
        """
        steps = len(predicted) + 1
        summed, counts = np.zeros((steps, *predicted.shape[1:-1])), np.zeros((steps, *[1] * (predicted.ndim - 2)))
        for k in range(predicted.shape[-1]):
            first = max(1 - k, 0)
            last = min(steps, steps - k)
            summed[first:last] += predicted[first + k - 1 : last + k - 1, ..., k]
            counts[first:last] += 1
        return summed / counts

    def _collisions(self, probability: FloatArray, ends: NDArray[np.integer[Any]]) -> list[Event]:
        """Collisions from probabilities (steps, n, n) of steps that end at the frames `ends`, at most one for each pair."""
        events = []
        n = probability.shape[-1]
        for i in range(n):
            for j in range(i + 1, n):
                k = int(probability[:, i, j].argmax())
                if probability[k, i, j] > self.config.collision_threshold:
                    near = np.arange(max(k - 1, 0), min(k + 2, len(probability)))
                    end = np.average(ends[near], weights=probability[near, i, j])
                    events.append(Event("collision", max(int(end - (self.config.stride_frames - 1) / 2), 0), (i, j)))
        return sorted(events, key=lambda e: e.frame)

    def _known(self, states: MotionStates) -> FloatArray:
        """Inputs (n, margin + F, K) of the network for each object in each frame, the boxes (`patch_boxes`) first.

        The `margin` frames before the video are those to which the window of the first frame reaches back.
        """
        return boxes_of(states, (self.config.window - 1) * self.config.stride_frames)

    def _window(self, known: FloatArray, t: int) -> FloatArray:
        """The window (n, window, K) of samples that ends at frame t."""
        return known[:, t + self.config.stride_frames * np.arange(self.config.window)]

    @torch.no_grad()
    @exact_convolutions()  # a rollout feeds predictions back as inputs: in TF32, positions came to differ by 0.01 world units
    def _step(self, window: FloatArray, states: MotionStates, here: BoolArray) -> tuple[FloatArray, FloatArray]:
        """Predict one step of C rollouts: the next samples (C, n, K), and collision probabilities (C, n, n, window).

        Args:
            window: (C, n, window, K) inputs of the network.
            states: motion states of the objects.
            here: (C, n) bool, whether each object is there.
        """
        static = torch.from_numpy(object_features(states.objects, states.world.vocabulary)).expand(len(window), -1, -1)
        inputs = (torch.from_numpy(window.astype(np.float32)), static, torch.from_numpy(here.copy()))
        following, logits = (x.float().cpu() for x in self._network(*(x.to(self.device) for x in inputs)))
        possible = here[:, :, None] & here[:, None]
        return following.numpy().astype(float), logits.sigmoid().numpy().astype(float) * possible[..., None]

    def _network(self, seen: Tensor, static: Tensor, here: Tensor) -> tuple[Tensor, Tensor]:
        """The next samples (C, n, K) after windows (C, n, window, K), and collision logits (C, n, n, window)."""
        boxes, logits = self.model(seen, static, here)
        return boxes, logits

    def _future(self, states: MotionStates, observed: Sequence[Event], total: int) -> Rollout:
        """The rollout of `total` frames with all objects, predicted from the last frame of the video."""
        last = states.present.shape[1] - 1
        exists = states.present.any(1, keepdims=True).T
        return self._rollouts(states, np.asarray(exists), last, states.present[:, last][None], observed, total)[0]

    def _without_each(self, states: MotionStates, total: int) -> list[Rollout]:
        """Rollouts of `total` frames without each object, predicted from the first full window."""
        start = min((self.config.window - 1) * self.config.stride_frames, states.present.shape[1] - 1)
        exists = ~np.eye(len(states.objects), dtype=bool)
        return self._rollouts(states, exists, start, np.zeros_like(exists), None, total)

    def _rollouts(
        self,
        states: MotionStates,
        exists: BoolArray,
        start: int,
        here: BoolArray,
        observed: Sequence[Event] | None,
        total: int,
    ) -> list[Rollout]:
        """Predict C rollouts.

        Args:
            states: motion states of the objects.
            exists: (C, n) bool, whether each object exists in each rollout.
            start: frame from which the rollouts are predicted.
            here: (C, n) bool, whether each object is in view at `start`; the others enter when they are first detected.
            observed: collisions during the video, which each rollout keeps; None to predict collisions from `start` on.
            total: number of frames of the rollouts.
        """
        (n_rollouts, n), frames = exists.shape, states.present.shape[1]
        if not n:
            return [Rollout(np.zeros((0, total, 2)), np.zeros((0, total), bool), ())] * n_rollouts
        stride, here, known = self.config.stride_frames, here.copy(), self._known(states)
        margin = known.shape[1] - frames
        window = np.repeat(self._window(known, start)[None], n_rollouts, 0)
        boxes = np.full((n_rollouts, n, total + stride, 4), np.nan)
        detected, predictions = states.present.any(1), []
        first = np.where(detected, states.present.argmax(1), total)
        last = np.where(detected, frames - 1 - states.present[:, ::-1].argmax(1), -1)
        for t in range(start, total - 1, stride):
            # An object that has come into view moves as observed until its window is full.
            follows = exists & (first <= t) & (t <= np.minimum(np.maximum(first + margin, start), last))
            follows &= observed is None
            for i in np.flatnonzero(follows.any(0)).tolist():
                window[follows[:, i], i] = self._window(known, t)[i]
                boxes[follows[:, i], i, first[i] : t + 1] = known[i, margin + first[i] : margin + t + 1, :4]
            here |= follows
            following, probability = self._step(window, states, here)
            for k in range(1, stride + 1):
                boxes[here, t + k] = (window[here, -1, :4] * (stride - k) + following[here, :4] * k) / stride
            predictions.append(probability)
            window = np.concatenate([window[:, :, 1:], following[:, :, None]], 2)
        middle = np.array(box_scale(states.world)[:2])
        pixels = boxes[:, :, :total, :2] * middle + middle
        location = np.empty_like(pixels)
        for i, o in enumerate(states.objects):
            height = states.world.vocabulary.shape(o.shape).height_world
            location[:, i] = states.camera.ground(np.nan_to_num(pixels[:, i], nan=-1.0), height)
        location[np.isnan(pixels).any(-1)] = np.nan
        shapes = [states.world.vocabulary.shape(o.shape) for o in states.objects]
        inside = np.stack([rollout_in_image(shapes, location[k], states.camera) for k in range(n_rollouts)])
        averaged, ends = self._averaged(np.stack(predictions)), start + stride * np.arange(len(predictions) + 1)
        rollouts = []
        for c in range(n_rollouts):
            if observed is None:
                rollouts.append(Rollout(location[c], inside[c], tuple(self._collisions(averaged[:, c], ends))))
                continue
            later = averaged[1:, c]
            for event in observed:
                i, j = event.objects
                later[:, i, j] = later[:, j, i] = 0.0
            predicted = [replace(e, frame=max(e.frame, frames)) for e in self._collisions(later, ends[1:])]
            rollouts.append(Rollout(location[c], inside[c], (*observed, *predicted), later.max(0)))
        return rollouts


class ImagePropNetPredictor(PatchPropNetPredictor):
    """A dynamics backend with PropNet on patches of images and masks (section 4.2 of the paper).

    Rollouts are made like those of `PatchPropNetPredictor`. `MotionStates` that are given to its methods must have `patches`
    or, for `explain`, `pixels`.

    Differs from the paper: see `ImagePropNet`; the frames of collisions are interpolated between samples.
    """

    built_from = (PatchPropNetConfig, ImagePropNet)
    name = default_checkpoint = "propnet_images"

    def explain(self, states: MotionStates, collisions: Sequence[Event] | None = None) -> Explanation:
        """Explain the motion like `PatchPropNetPredictor.explain`, from the patches of the states or from their pixels.

        Raises:
            DataError: the states have neither patches nor pixels, or the pixels of another video.
        """
        if states.patches is None:
            if states.pixels is None:
                raise DataError("dynamics 'propnet_images' reads images; give videos, or use another backend")
            states = replace(states, patches=object_patches(states.pixels, states, self.config))
        return super().explain(states, collisions)

    def _known(self, states: MotionStates) -> FloatArray:
        """Inputs (n, margin + F, 4 + K) of the network: boxes and patches. Before the video, patches are those of frame 0."""
        if states.patches is None:
            raise DataError("the network on images needs states with patches")
        boxes = super()._known(states)
        margin = boxes.shape[1] - states.patches.shape[1]
        patches = np.pad(states.patches, [(0, 0), (margin, 0), (0, 0), (0, 0), (0, 0)], mode="edge")
        flat = patches.reshape(*patches.shape[:2], -1).astype(np.float32) / MAX_VALUE
        return np.concatenate([boxes, flat], -1)

    def _network(self, seen: Tensor, static: Tensor, here: Tensor) -> tuple[Tensor, Tensor]:
        """The next boxes and patches (C, n, 4 + K) after windows (C, n, window, 4 + K), and collision logits."""
        cells = self.config.patch_cells
        patches = seen[..., 4:].unflatten(-1, (PATCH_CHANNELS, cells, cells))
        boxes, following, logits = self.model(seen[..., :4], patches, static, here)
        return torch.cat([boxes.float(), following.flatten(2)], -1), logits
