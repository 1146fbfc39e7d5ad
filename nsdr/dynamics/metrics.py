"""Measures of how well predicted collisions and motion agree with the true ones."""

from collections.abc import Iterable, Sequence

import numpy as np

from nsdr.dynamics.base import Dynamics
from nsdr.dynamics.motion_states import MotionStates, first_frames
from nsdr.types import Event
from nsdr.types.events import SAME_EVENT_FRAMES


def collision_scores(pairs: Iterable[tuple[Sequence[Event], Sequence[Event]]]) -> dict[str, float]:
    """Precision, recall and F1 of pairs (predicted collisions, true collisions), matched as in `same_collisions`."""
    right = predicted_total = true_total = 0
    for predicted, true in pairs:
        right += same_collisions(predicted, true)
        predicted_total += len(predicted)
        true_total += len(true)
    return {
        "collision_precision": right / max(predicted_total, 1),
        "collision_recall": right / max(true_total, 1),
        "collision_f1": 2 * right / max(predicted_total + true_total, 1),
    }


def same_collisions(
    predicted: Sequence[Event], true: Sequence[Event], tolerance_frames: int = SAME_EVENT_FRAMES
) -> int:
    """Number of predicted collisions that match a true one: same objects, frames at most `tolerance_frames` apart.

    Each true collision is matched at most once.
    """
    left = sorted(true, key=lambda e: e.frame)
    for event in sorted(predicted, key=lambda e: e.frame):
        fits = (e for e in left if e.objects == event.objects and abs(e.frame - event.frame) <= tolerance_frames)
        if (first := next(fits, None)) is not None:
            left.remove(first)
    return len(true) - len(left)


def rollout_errors(
    dynamics: Dynamics, scenes: Sequence[MotionStates], starts: Sequence[int] = (60, 80, 100)
) -> dict[str, float]:
    """Median and 90th percentile (`_p90`) of the distance of rollouts from tracks 10, 25 and 50 frames ahead (world units).

    For each of `starts`, a rollout starts from what is known of the frames before it (`first_frames`). Objects are left out
    if the rollout has no position for them, or if they were not in view at the start.
    """
    distances: dict[int, list[float]] = {10: [], 25: [], 50: []}
    for states in scenes:
        for start in starts:
            here = states.detected[:, :start].any(1)
            if not here.any():
                continue
            explanation = dynamics.explain(first_frames(states, start))
            rollout = explanation.rollout(frames=start + max(distances))
            for ahead, collected in distances.items():
                frame = start - 1 + ahead
                if frame < states.present.shape[1]:
                    seen = states.reliable[here, frame] & states.present[here, start - 1]
                    difference = rollout.location_world[seen, frame] - states.location_world[here, frame][seen]
                    collected += np.hypot(difference[:, 0], difference[:, 1]).tolist()
    errors = {}
    for ahead, values in distances.items():
        errors[f"rollout_error_{ahead}"] = float(np.nanmedian(values)) if values else float("nan")
        errors[f"rollout_error_{ahead}_p90"] = float(np.nanquantile(values, 0.9)) if values else float("nan")
    return errors
