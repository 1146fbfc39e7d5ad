"""The paper's dynamics predictor: one-step predictions of a patch network, rolled out from the first observations."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from nsdr.checkpoint import load_checkpoint
from nsdr.clevrer.camera import HEIGHT_PX, WIDTH_PX, ground_from_pixels
from nsdr.dynamics.observed import observed_motion, with_observed_motion
from nsdr.dynamics.patches import BOX_SCALE, PatchConfig, PatchModel
from nsdr.dynamics.predictor import HORIZON_FRAME
from nsdr.dynamics.states import MotionStates, object_features, states_from_tracks
from nsdr.types import DynamicsPrediction, Event, Rollout, VideoTracks

__all__ = ["PaperPredictor", "continued_back", "scaled_boxes"]

FloatArray = NDArray[np.floating[Any]]
CENTRE_PX = (WIDTH_PX / 2, HEIGHT_PX / 2, 0.0, 0.0)
ROW_OFFSET_PX = 4.0
"""The middle of a box lies this much above the image of the object's centre (mean over the picture; the camera looks down)."""


def scaled_boxes(box_px: FloatArray) -> FloatArray:
    """(..., 4) boxes in pixels -> in units of `BOX_SCALE`."""
    return (box_px - np.array(CENTRE_PX)) / np.array(BOX_SCALE)


def continued_back(box_px: FloatArray, present: NDArray[np.bool_], stride_frames: int) -> FloatArray:
    """(..., F, 4) boxes with those before an object was first seen continued backwards in a straight line.

    Args:
        box_px: (..., F, 4).
        present: (..., F).
        stride_frames: the line goes through the first box and the one so many frames later.
    """
    frames = np.arange(box_px.shape[-2])
    first = present.argmax(-1)[..., None]
    start = np.take_along_axis(box_px, first[..., None], -2)
    later = np.take_along_axis(box_px, np.minimum(first + stride_frames, frames[-1])[..., None], -2)
    before = start - (later - start) * ((first - frames) / stride_frames)[..., None]
    return np.where((frames < first)[..., None], before, box_px)


class PaperPredictor:
    """PropNet over patches (paper, section 4.2).

    Collisions of the video come from one-step predictions on the observed samples. The future is rolled out from the last
    samples; with an object removed, its vertex and edges are erased and everything is rolled out from the first samples, while
    objects that come into view later enter from observation.

    Differs from the paper: see `PatchModel`; frames of collisions are interpolated within the step.

    Args:
        model: trained network.
        horizon_frame: last frame that is predicted.
    """

    def __init__(self, model: PatchModel, horizon_frame: int = HORIZON_FRAME) -> None:
        self.model = model.eval()
        self.horizon_frame = horizon_frame
        self.config = model.config

    @classmethod
    def from_checkpoint(cls, folder: str | Path, horizon_frame: int = HORIZON_FRAME) -> "PaperPredictor":
        """Load `dynamics.safetensors` and its JSON; raises `CheckpointError` when missing or corrupt."""
        state, details = load_checkpoint(folder, "dynamics")
        model = PatchModel(PatchConfig(**details["config"]))
        model.load_state_dict(state)
        return cls(model, horizon_frame)

    def predict(self, tracks: VideoTracks, observed: Sequence[Event] | None = None) -> DynamicsPrediction:
        """Observed motion and collisions, their future, and one rollout for each removed object; see `DynamicsPredictor`."""
        states = states_from_tracks(tracks)
        observed = self.observed_collisions(states) if observed is None else observed
        course = self._future(states, observed)
        course = with_observed_motion(course, observed_motion(states, observed))
        return DynamicsPrediction(states.objects, tracks.n_frames, course, dict(enumerate(self._without_each(states))))

    def continue_motion(self, states: MotionStates) -> Rollout:
        """The rollout after the last frame of `states`, nothing removed, its own collisions only."""
        return self._future(states, [])

    def observed_collisions(self, states: MotionStates) -> list[Event]:
        """Collisions during the video: each pair at the sample from which its collision is most probable."""
        n, frames = states.present.shape
        stride, samples = self.config.stride_frames, range(0, frames, self.config.stride_frames)
        if n < 2:
            return []
        windows = np.stack([self._window(states, t) for t in samples])
        probability = self._step(windows, states, states.present.T[samples])[1]
        events = []
        for i in range(n):
            for j in range(i + 1, n):
                k = int(probability[:, i, j].argmax())
                if probability[k, i, j] > self.config.collision_threshold:
                    near = np.arange(max(k - 1, 0), min(k + 2, len(probability)))
                    middle = np.average(near, weights=probability[near, i, j]) * stride + (stride + 1) / 2
                    events.append(Event("collision", min(int(middle), frames - 1), (i, j)))
        return sorted(events, key=lambda e: e.frame)

    def _window(self, states: MotionStates, t: int) -> FloatArray:
        """(n, window, 4) boxes up to frame t."""
        past = t - self.config.stride_frames * np.arange(self.config.window - 1, -1, -1)
        boxes = continued_back(states.box_px, states.present, self.config.stride_frames)
        return scaled_boxes(boxes[:, np.maximum(past, 0)])

    @torch.no_grad()
    def _step(self, window: FloatArray, states: MotionStates, here: NDArray[np.bool_]) -> tuple[FloatArray, FloatArray]:
        """Boxes (C, n, 4) a step later, and collision probabilities (C, n, n) on the way, of several courses at once."""
        static = torch.from_numpy(object_features(states.objects)).expand(len(window), -1, -1)
        boxes, logits = self.model(torch.from_numpy(window.astype(np.float32)), static, torch.from_numpy(here.copy()))
        possible = here[:, :, None] & here[:, None]
        return boxes.numpy().astype(float), logits.sigmoid().numpy().astype(float) * possible

    def _future(self, states: MotionStates, observed: Sequence[Event]) -> Rollout:
        frames = states.present.shape[1]
        last = (frames - 1) // self.config.stride_frames * self.config.stride_frames
        exists = states.present.any(1, keepdims=True).T
        return self._rollouts(states, np.asarray(exists), last, states.present[:, last][None], observed)[0]

    def _without_each(self, states: MotionStates) -> list[Rollout]:
        start = min((self.config.window - 1) * self.config.stride_frames, states.present.shape[1] - 1)
        exists = ~np.eye(len(states.objects), dtype=bool)
        seen = states.present[:, : start + 1].any(1)
        return self._rollouts(states, exists, start, np.logical_and(exists, seen), None)

    def _rollouts(
        self,
        states: MotionStates,
        exists: NDArray[np.bool_],
        start: int,
        here: NDArray[np.bool_],
        observed: Sequence[Event] | None,
    ) -> list[Rollout]:
        """Predict several courses on from frame `start`; the others of `exists` (C, n) enter when they are first seen."""
        (courses, n), frames = exists.shape, states.present.shape[1]
        if not n:
            empty = Rollout(np.zeros((0, self.horizon_frame + 1, 2)), np.zeros((0, self.horizon_frame + 1), bool), ())
            return [empty] * courses
        stride, here = self.config.stride_frames, here.copy()
        total = max(self.horizon_frame + 1, frames)
        window = np.repeat(self._window(states, start)[None], courses, 0)
        known = scaled_boxes(states.box_px)
        boxes = np.full((courses, n, total + stride, 4), np.nan)
        boxes[:, :, : start + 1] = np.where(
            states.present[None, :, : start + 1, None] & exists[:, :, None, None], known[None, :, : start + 1], np.nan
        )
        collisions: list[list[Event]] = [list(observed or []) for _ in range(courses)]
        met = [{e.objects for e in observed or ()} for _ in range(courses)]
        scores = np.zeros((courses, n, n))
        first = np.where(states.present.any(1), states.present.argmax(1), total)
        for t in range(start, total - 1, stride):
            if t < frames:  # what has come into view enters from observation
                entering = exists & ~here & (first <= t) & states.present[:, t]
                for i in np.flatnonzero(entering.any(0)).tolist():
                    window[entering[:, i], i] = self._window(states, t)[i]
                    boxes[entering[:, i], i, first[i] : t + 1] = known[i, first[i] : t + 1]
                here |= entering
            following, probability = self._step(window, states, here)
            for k in range(1, stride + 1):
                boxes[here, t + k] = (window[here, -1] * (stride - k) + following[here] * k) / stride
            np.maximum(scores, probability, out=scores)
            for c, i, j in np.argwhere(np.triu(probability > self.config.collision_threshold, 1)).tolist():
                if (i, j) not in met[c]:
                    met[c].add((i, j))
                    frame = t + (stride + 1) // 2
                    collisions[c].append(Event("collision", frame if observed is None else max(frame, frames), (i, j)))
            window = np.concatenate([window[:, :, 1:], following[:, :, None]], 2)
        for event in observed or ():
            i, j = event.objects
            scores[:, i, j] = scores[:, j, i] = 0.0
        pixels = boxes[:, :, :total, :2] * np.array(BOX_SCALE[:2]) + np.array(CENTRE_PX[:2])
        inside = ((pixels >= 0) & (pixels < (WIDTH_PX, HEIGHT_PX))).all(-1)
        location = ground_from_pixels(np.nan_to_num(pixels, nan=-1.0) + np.array([0.0, ROW_OFFSET_PX]))
        location[np.isnan(pixels).any(-1)] = np.nan
        return [
            Rollout(
                location[c],
                inside[c],
                tuple(sorted(collisions[c], key=lambda e: e.frame)),
                None if observed is None else scores[c],
            )
            for c in range(courses)
        ]
