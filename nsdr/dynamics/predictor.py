"""Tracks -> what happened, what comes next, and what happens without each object."""

from collections.abc import Sequence
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from nsdr.checkpoint import load_checkpoint
from nsdr.clevrer.camera import HEIGHT_PX, OBJECT_RADIUS_WORLD, WIDTH_PX, pixels_from_world
from nsdr.dynamics.model import DynamicsConfig, DynamicsModel
from nsdr.dynamics.observed import observed_motion, with_observed_motion
from nsdr.dynamics.states import (
    MotionStates,
    extended,
    object_features,
    states_from_tracks,
    visible_frames,
)
from nsdr.types import DynamicsPrediction, Event, Rollout, VideoTracks

__all__ = ["HORIZON_FRAME", "DynamicsPredictor", "in_picture"]

HORIZON_FRAME = 179
"""Last frame that is predicted: 7 s of video time."""

FloatArray = NDArray[np.floating[Any]]


def in_picture(location_world: FloatArray) -> NDArray[np.bool_]:
    """Whether the centres (..., 2) on the ground are imaged inside the picture."""
    height = np.full((*location_world.shape[:-1], 1), OBJECT_RADIUS_WORLD)
    pixels = pixels_from_world(np.concatenate([location_world, height], -1))
    with np.errstate(invalid="ignore"):
        return np.asarray(((pixels >= 0) & (pixels < (WIDTH_PX, HEIGHT_PX))).all(-1))


class DynamicsPredictor:
    """Propagation networks over ground-plane states (paper, section 4.2).

    Differs from the paper: states instead of image patches; observed collisions are read from motion before and after;
    with an object removed, only what its absence can influence is predicted anew, the rest keeps its observed motion.

    Args:
        model: trained networks.
        shortcut: what a removal cannot influence keeps its observed motion; otherwise all is rolled out from its first frames.
        horizon_frame: last frame that is predicted.
    """

    def __init__(self, model: DynamicsModel, shortcut: bool = True, horizon_frame: int = HORIZON_FRAME) -> None:
        self.model = model.eval()
        self.config = model.config
        self.shortcut = shortcut
        self.horizon_frame = horizon_frame

    @classmethod
    def from_checkpoint(
        cls, folder: str | Path, shortcut: bool = True, horizon_frame: int = HORIZON_FRAME
    ) -> "DynamicsPredictor":
        """Load `dynamics.safetensors` and its JSON.

        Raises:
            CheckpointError: missing or corrupt.
        """
        state, details = load_checkpoint(folder, "dynamics")
        model = DynamicsModel(DynamicsConfig(**details["config"]))
        model.load_state_dict(state)
        return cls(model, shortcut, horizon_frame)

    def predict(self, tracks: VideoTracks, observed: Sequence[Event] | None = None) -> DynamicsPrediction:
        """Observed motion and collisions, their future, and one rollout for each removed object.

        Args:
            tracks: the video's objects.
            observed: the video's collisions, to be believed; None finds them.

        Returns:
            Rollouts to `horizon_frame`; empty ones for a video without objects.
        """
        states = states_from_tracks(tracks)
        observed = self.observed_collisions(states) if observed is None else observed
        motion = observed_motion(states, observed)
        rollouts = self._courses(states, observed, tracks.n_frames, motion.location_world)
        counterfactual = dict(enumerate(rollouts[1:]))
        course = with_observed_motion(rollouts[0], motion)
        return DynamicsPrediction(states.objects, tracks.n_frames, course, counterfactual)

    def continue_motion(self, states: MotionStates) -> Rollout:
        """The rollout after the last frame of `states`, nothing removed, its own collisions only."""
        return self._courses(states, [], states.present.shape[1], states.location_world, counterfactual=False)[0]

    def observed_collisions(self, states: MotionStates) -> list[Event]:
        """Collisions during the video, in order of time; each pair at most once, at its most probable frame."""
        return [event for event, p in self.collision_candidates(states) if p > self.config.collision_threshold]

    @torch.no_grad()
    def collision_candidates(self, states: MotionStates) -> list[tuple[Event, float]]:
        """For every pair that is ever seen together, its most probable collision, and how probable that is; by frame."""
        n, frames = states.present.shape
        if n < 2:
            return []
        c = self.config
        index = np.arange(frames)[:, None] + np.arange(-c.side_steps, c.side_steps + 1) * c.stride_frames
        window, reliable = windows(states, index)
        static = torch.from_numpy(object_features(states.objects)).expand(frames, -1, -1)
        exists = torch.from_numpy(states.present.T.copy())
        logits = self.model.observe(window, reliable, static, exists)
        both = exists[:, :, None] & exists[:, None, :]
        probability = (logits.sigmoid() * both).numpy()
        candidates = []
        for i, j in combinations(range(n), 2):
            course = probability[:, i, j]
            peak = int(course.argmax())
            if course[peak] > 0:
                near = np.arange(max(peak - 4, 0), min(peak + 5, frames))
                frame = int(np.floor(np.average(near, weights=course[near]) + 0.5))
                candidates.append((Event("collision", frame, (i, j)), float(course[peak])))
        return sorted(candidates, key=lambda c: c[0].frame)

    @torch.no_grad()
    def _courses(
        self,
        states: MotionStates,
        observed: Sequence[Event],
        n_frames: int,
        flown: FloatArray,
        counterfactual: bool = True,
    ) -> list[Rollout]:
        """The course of the world as it is, and without each object; observed motion is `flown` (n, F, 2) where known.

        An object is "free" from the frame on at which its motion is no longer the observed one: after the video, or from
        a collision that the removed object's absence changes.
        """
        n, stride, past = len(states.objects), self.config.stride_frames, self.config.past_steps
        total = max(self.horizon_frame + 1, n_frames)
        courses = n + 1 if counterfactual else 1
        location = np.full((courses, n, total + stride, 2), np.nan)
        location[:, :, :n_frames] = states.location_world
        # Offsets from the first place to those before the video; index -k stands for frame -k.
        reach = stride * past
        continued = extended(states.location_world, reach)[:, :reach] - states.location_world[:, :1]
        earlier = np.concatenate([np.zeros((n, 1, 2)), continued], 1)
        exists = np.ones((courses, n), bool)
        exists[np.arange(1, courses), np.arange(courses - 1)] = False
        first = states.present.argmax(1) if n else np.zeros(0, int)
        free_from = np.full((courses, n), (n_frames - 1) // stride * stride)
        if not self.shortcut:  # only the first samples of each object are observed
            free_from[1:] = np.minimum(free_from[1:], ((first + stride - 1) // stride + past - 1) * stride)
        collisions: list[list[Event]] = [[] for _ in range(courses)]
        met = [{e.objects for e in observed} if course == 0 else set() for course in range(courses)]
        collisions[0] = list(observed)
        pending = [list(observed) for _ in range(courses)]
        scores = np.zeros((n, n))
        static = torch.from_numpy(object_features(states.objects)).expand(courses, -1, -1)
        for t in range(0, total - 1, stride) if n else ():
            for course in range(1, courses):
                while pending[course] and pending[course][0].frame <= t + stride:
                    self._observed_event(pending[course].pop(0), course, t, exists, free_from, collisions, met)
            free = (free_from <= t) & exists
            if not free.any():
                continue
            times = t - stride * np.arange(past - 1, -1, -1)
            index = np.maximum(times, 0)
            known = np.ones((courses, n, past), bool)
            known[:, :, times < 0] = False
            seen = (times >= 0) & (times < n_frames)
            known[:, :, seen] = states.reliable[:, index[seen]] | (free_from[:, :, None] <= index[seen])
            here = exists & (first <= t)
            history = location[:, :, index] + earlier[:, np.minimum(times, 0)]
            window = torch.from_numpy(np.nan_to_num(history).astype(np.float32))
            places, logits = self.model.predict(window, torch.from_numpy(known), static, torch.from_numpy(here))
            following = places.numpy().astype(float)
            for step in range(1, stride + 1):
                between = location[:, :, t] + (following - location[:, :, t]) * step / stride
                location[:, :, t + step] = np.where(free[..., None], between, location[:, :, t + step])
            possible = here[:, :, None] & here[:, None] & (free[:, :, None] | free[:, None])
            probability = logits.sigmoid().numpy() * possible
            np.maximum(scores, probability[0], out=scores)
            hits = probability > self.config.collision_threshold
            for course, i, j in np.argwhere(np.triu(hits, 1)).tolist():
                if (i, j) not in met[course] and t + 1 < total:
                    met[course].add((i, j))
                    frame = t + 1 if course else max(t + 1, n_frames)
                    collisions[course].append(Event("collision", frame, (i, j)))
                    free_from[course, [i, j]] = np.minimum(free_from[course, [i, j]], t)
        visible = np.zeros((courses, n, total), bool)
        visible[:, :, :n_frames] = visible_frames(states)
        free_frames = np.arange(total) >= np.maximum(free_from, first)[..., None]
        free_frames[0, :, :n_frames] = False  # the video itself was observed to its last frame
        with np.errstate(invalid="ignore"):
            visible = np.where(free_frames, in_picture(location[:, :, :total]), visible) & exists[..., None]
        as_observed = (np.arange(n_frames) <= free_from[..., None]) | ~free_frames[..., :n_frames]
        shown = np.where(np.isfinite(flown) & states.present[..., None], flown, states.location_world)
        location[:, :, :n_frames][as_observed] = np.broadcast_to(shown, (courses, n, n_frames, 2))[as_observed]
        location[~exists] = np.nan
        for event in observed:  # a pair collides once
            scores[event.objects] = scores[event.objects[::-1]] = 0.0
        return [
            Rollout(
                location[k, :, :total],
                visible[k],
                tuple(sorted(collisions[k], key=lambda e: e.frame)),
                scores if k == 0 else None,
            )
            for k in range(courses)
        ]

    def _observed_event(
        self,
        event: Event,
        course: int,
        t: int,
        exists: NDArray[np.bool_],
        free_from: NDArray[Any],
        collisions: list[list[Event]],
        met: list[set[Any]],
    ) -> None:
        """An observed collision comes up in a counterfactual course: it stays when both objects still move as observed."""
        pair = list(event.objects)
        if exists[course, pair].all() and (free_from[course, pair] > t).all():
            collisions[course].append(event)
            met[course].add(event.objects)
        else:
            free_from[course, pair] = np.minimum(free_from[course, pair], t)


def windows(states: MotionStates, index: NDArray[Any]) -> tuple[torch.Tensor, torch.Tensor]:
    """Places (T, n, K, 2) and reliability (T, n, K) at frame indices (T, K); frames outside the video continue
    in straight lines and are not reliable."""
    frames = states.present.shape[1]
    inside = (index >= 0) & (index < frames)
    beyond = max(-int(index.min()), int(index.max()) - frames + 1, 0)
    window = extended(states.location_world, beyond)[:, index + beyond].transpose(1, 0, 2, 3)
    reliable = (states.reliable[:, np.clip(index, 0, frames - 1)] & inside).transpose(1, 0, 2)
    return torch.from_numpy(window.astype(np.float32)), torch.from_numpy(reliable)
