"""The state backend: propagation networks on ground-plane states (section 4.2 of the paper)."""

from collections.abc import Sequence
from itertools import combinations
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from nsdr.dynamics.base import Explanation
from nsdr.dynamics.motion_states import MotionStates, extrapolate, object_features
from nsdr.dynamics.propnet.explanation import NetworkExplanation
from nsdr.dynamics.propnet.state_model import PropNet, PropNetConfig
from nsdr.dynamics.track_smoothing import (
    SmoothedTracks,
    rollout_in_image,
    smooth_tracks,
    with_smoothed_tracks,
)
from nsdr.io.checkpoint import PretrainedPart
from nsdr.io.device import limit_threads
from nsdr.types import Event, Rollout
from nsdr.world.world import ANY_LOOK

PEAK_FRAMES = 4
"""The frame of a collision is the mean, weighted by probability, over this many frames on each side of the most probable
one."""
OBSERVED_AT_ONCE = 32
"""Number of frames in a batch of the observer network, which fits into a processor's cache. Results do not depend on it."""


class PropNetPredictor(PretrainedPart[PropNet]):
    """A dynamics backend with propagation networks on ground-plane states (section 4.2 of the paper).

    Differs from the paper: the inputs are states instead of image patches; collisions in the video are detected from the motion
    before and after them; without an object, only motion that its absence can influence is predicted, and all other motion is
    as observed.

    Args:
        model: the trained networks.
    """

    part = "dynamics"
    name = "propnet"
    free = ANY_LOOK
    built_from = (PropNetConfig, PropNet)

    def __init__(self, model: PropNet) -> None:
        self.model = model.eval()
        self.config = model.config

    @limit_threads(1)
    def explain(self, states: MotionStates, collisions: Sequence[Event] | None = None) -> Explanation:
        """Detect the collisions in the video unless they are given; see `nsdr.dynamics.Dynamics`.

        Raises:
            DataError: the networks were trained for another world.
        """
        self.check_world(states.world)
        observed = self.observed_collisions(states) if collisions is None else collisions
        smoothed = smooth_tracks(states, observed)

        def continued(frames: int) -> Rollout:
            return with_smoothed_tracks(self._rollouts(states, observed, smoothed, [None], frames)[0], smoothed)

        def without_each(frames: int) -> list[Rollout]:
            return self._rollouts(states, observed, smoothed, range(len(states.objects)), frames)

        return NetworkExplanation(states, continued, without_each)

    def observed_collisions(self, states: MotionStates) -> list[Event]:
        """Collisions during the video in order of time, at most one for each pair, at its most probable frame."""
        return [event for event, p in self.collision_candidates(states) if p > self.config.collision_threshold]

    @limit_threads(1)
    @torch.no_grad()
    def collision_candidates(self, states: MotionStates) -> list[tuple[Event, float]]:
        """For every pair that is ever present together, its most probable collision and its probability, in order of frames."""
        self.check_world(states.world)
        n, frames = states.present.shape
        if n < 2:
            return []
        c = self.config
        index = np.arange(frames)[:, None] + np.arange(-c.side_steps, c.side_steps + 1) * c.stride_frames
        window, reliable = windows(states, index)
        static = torch.from_numpy(object_features(states.objects, states.world.vocabulary)).expand(frames, -1, -1)
        exists = torch.from_numpy(states.present.T.copy())
        parts = zip(*(x.split(OBSERVED_AT_ONCE) for x in (window, reliable, static, exists)), strict=True)
        logits = torch.cat([self._on_device(self.model.observe, *part) for part in parts])
        both = exists[:, :, None] & exists[:, None, :]
        probability = (logits.sigmoid() * both).numpy()
        candidates = []
        for i, j in combinations(range(n), 2):
            of_pair = probability[:, i, j]
            peak = int(of_pair.argmax())
            if of_pair[peak] > 0:
                near = np.arange(max(peak - PEAK_FRAMES, 0), min(peak + PEAK_FRAMES + 1, frames))
                frame = int(np.floor(np.average(near, weights=of_pair[near]) + 0.5))
                candidates.append((Event("collision", frame, (i, j)), float(of_pair[peak])))
        return sorted(candidates, key=lambda c: c[0].frame)

    @torch.no_grad()
    def _rollouts(
        self,
        states: MotionStates,
        observed: Sequence[Event],
        smoothed: SmoothedTracks,
        removed: Sequence[int | None],
        total: int,
    ) -> list[Rollout]:
        """Make rollouts of `total` frames in one batch.

        An object is free, which means that its motion is predicted, from the end of the video on or from the first collision
        that the absence of the removed object changes. Before that it moves as observed.

        Args:
            states: motion states of the objects.
            observed: collisions during the video, in order of time.
            smoothed: the smoothed tracks.
            removed: id of the object that each rollout lacks; None for a rollout with all objects.
            total: number of frames.
        """
        n_frames = states.present.shape[1]
        n, stride, past = len(states.objects), self.config.stride_frames, self.config.past_steps
        n_rollouts = len(removed)
        reach = stride * (past - 1)  # frames before the video that the first window sees
        positions = np.zeros((n_rollouts, n, reach + total + stride, 2))
        positions[:, :, : reach + n_frames] = extrapolate(states.location_world, reach)[:, : reach + n_frames]
        location = positions[:, :, reach : reach + total]
        reliable = np.pad(states.reliable, [(0, 0), (0, total + stride - n_frames)], constant_values=True)
        reliable = np.pad(reliable, [(0, 0), (reach, 0)])
        exists = np.ones((n_rollouts, n), bool)
        for rollout, i in enumerate(removed):
            if i is not None:
                exists[rollout, i] = False
        of_video = np.asarray(exists.all(1))
        first = states.present.argmax(1) if n else np.zeros(0, int)
        free_from = np.full((n_rollouts, n), (n_frames - 1) // stride * stride)
        collisions: list[list[Event]] = [[] for _ in range(n_rollouts)]
        met: list[set[tuple[int, ...]]] = [set() for _ in range(n_rollouts)]
        pending = [list(observed) for _ in range(n_rollouts)]
        for rollout in np.flatnonzero(of_video).tolist():
            collisions[rollout], met[rollout], pending[rollout] = list(observed), {e.objects for e in observed}, []
        scores = np.zeros((n, n))
        static = torch.from_numpy(object_features(states.objects, states.world.vocabulary)).expand(n_rollouts, -1, -1)
        shares = np.arange(1, stride + 1)[:, None] / stride
        for t in range(0, total - 1, stride) if n else ():
            for rollout in range(n_rollouts):
                while pending[rollout] and pending[rollout][0].frame <= t + stride:
                    event = pending[rollout].pop(0)
                    pair = list(event.objects)
                    if exists[rollout, pair].all() and (free_from[rollout, pair] > t).all():  # both move as observed
                        collisions[rollout].append(event)
                        met[rollout].add(event.objects)
                    else:
                        free_from[rollout, pair] = np.minimum(free_from[rollout, pair], t)
            free = (free_from <= t) & exists
            at_work = np.flatnonzero(free.any(1))  # in the other rollouts, all objects still move as observed
            if not len(at_work):
                continue
            past_frames = slice(t, t + reach + 1, stride)
            times = np.arange(t - reach, t + 1, stride)
            window = positions[at_work, :, past_frames]
            known = reliable[:, past_frames] | (free_from[at_work][:, :, None] <= times)
            here = exists[at_work] & (first <= t)
            inputs = torch.from_numpy(window.astype(np.float32)), torch.from_numpy(known), static[: len(at_work)]
            following, logits = self._on_device(self.model.predict, *inputs, torch.from_numpy(here))
            now, moves = window[:, :, -1:], free[at_work][:, :, None]
            between = now + (following.numpy()[:, :, None] - now) * shares
            steps = slice(reach + t + 1, reach + t + stride + 1)
            positions[at_work, :, steps] = np.where(moves[..., None], between, positions[at_work, :, steps])
            possible = here[:, :, None] & here[:, None] & (moves | moves.transpose(0, 2, 1))
            probability = logits.sigmoid().numpy() * possible
            for k in np.flatnonzero(of_video[at_work]).tolist():
                np.maximum(scores, probability[k], out=scores)
            for k, i, j in np.argwhere(probability > self.config.collision_threshold).tolist():
                rollout = int(at_work[k])
                if i < j and (i, j) not in met[rollout] and t + 1 < total:
                    met[rollout].add((i, j))
                    frame = max(t + 1, n_frames) if of_video[rollout] else t + 1
                    collisions[rollout].append(Event("collision", frame, (i, j)))
                    free_from[rollout, [i, j]] = np.minimum(free_from[rollout, [i, j]], t)
        visible = np.zeros((n_rollouts, n, total), bool)
        visible[:, :, :n_frames] = smoothed.visible
        free_frames = np.arange(total) >= np.maximum(free_from, first)[..., None]
        free_frames[of_video, :, :n_frames] = False  # the video itself was observed to its last frame
        visible &= ~free_frames & exists[..., None]
        shapes = np.array([o.shape for o in states.objects])
        for shape in np.unique(shapes):
            frames = free_frames & (exists & (shapes == shape))[..., None]
            visible[frames] = rollout_in_image(
                [states.world.vocabulary.shape(shape)], location[frames][None], states.camera
            )[0]
        as_observed = (np.arange(n_frames) <= free_from[..., None]) | ~free_frames[..., :n_frames]
        fitted = np.isfinite(smoothed.location_world) & states.present[..., None]
        shown = np.where(fitted, smoothed.location_world, states.location_world)
        location[:, :, :n_frames][as_observed] = np.broadcast_to(shown, (n_rollouts, n, n_frames, 2))[as_observed]
        location[~exists] = np.nan
        for event in observed:  # a pair collides once
            scores[event.objects] = scores[event.objects[::-1]] = 0.0
        in_order = [tuple(sorted(events, key=lambda e: e.frame)) for events in collisions]
        return [
            Rollout(location[k], visible[k], in_order[k], scores if of_video[k] else None) for k in range(n_rollouts)
        ]

    def _on_device(self, network: Any, *inputs: torch.Tensor) -> Any:
        """Run a network on the device of its weights, and return its outputs on the CPU."""
        outputs = network(*(x.to(self.device) for x in inputs))
        return tuple(x.cpu() for x in outputs) if isinstance(outputs, tuple) else outputs.cpu()


def windows(states: MotionStates, index: NDArray[Any]) -> tuple[torch.Tensor, torch.Tensor]:
    """Positions (T, n, K, 2) and their reliability (T, n, K) at frame indices (T, K).

    Positions in frames outside the video are continued in straight lines and are not reliable.
    """
    frames = states.present.shape[1]
    inside = (index >= 0) & (index < frames)
    beyond = max(-int(index.min()), int(index.max()) - frames + 1, 0)
    window = extrapolate(states.location_world, beyond)[:, index + beyond].transpose(1, 0, 2, 3)
    reliable = (states.reliable[:, np.clip(index, 0, frames - 1)] & inside).transpose(1, 0, 2)
    return torch.from_numpy(window.astype(np.float32)), torch.from_numpy(reliable)
