"""Finds the collisions of a video with the collision network."""

import numpy as np
import torch

from nsdr.dynamics.collisions.features import NetworkInputs, arrays_from_states, near_pairs, network_inputs
from nsdr.dynamics.collisions.network import STEP_FRAMES, CollisionNetwork, CollisionNetworkConfig
from nsdr.dynamics.motion_states import MotionStates
from nsdr.io.checkpoint import PretrainedPart
from nsdr.io.device import limit_threads
from nsdr.types import Event

__all__ = ["TrackCollisionDetector"]

PEAK_STEPS = 2
"""Steps on each side of the most probable one that decide the frame of a collision."""


class TrackCollisionDetector(PretrainedPart[CollisionNetwork]):
    """Collisions in observed motion, by a temporal network over whole tracks.

    Differs from the paper: the paper's network sees image patches of few frames.

    Args:
        model: trained network.
    """

    part = "collisions"
    built_from = (CollisionNetworkConfig, CollisionNetwork)

    def __init__(self, model: CollisionNetwork) -> None:
        self.model = model.eval()
        self.config = model.config

    @limit_threads(1)
    @torch.no_grad()
    def collision_candidates(self, states: MotionStates) -> list[tuple[Event, float]]:
        """For every pair that comes near each other, its most probable collision, and how probable that is; by frame."""
        pairs = near_pairs(states.location_world)
        if not len(pairs):
            return []
        frames, device = states.present.shape[1], self.device
        inputs = NetworkInputs(*(x.to(device) for x in network_inputs(arrays_from_states(states), pairs)))
        logits = self.model(inputs).double().cpu()
        log_total = logits.logsumexp(1)
        share = logits.softmax(1).numpy()
        candidates = []
        for pair, of_pair, probability in zip(pairs.tolist(), share, log_total.sigmoid().tolist(), strict=True):
            peak = int(of_pair.argmax())
            near = np.arange(max(peak - PEAK_STEPS, 0), min(peak + PEAK_STEPS + 1, len(of_pair)))
            frame = int(np.floor(STEP_FRAMES * np.average(near, weights=of_pair[near]) + 0.5))
            candidates.append((Event("collision", min(frame, frames - 1), (pair[0], pair[1])), probability))
        return sorted(candidates, key=lambda c: c[0].frame)
