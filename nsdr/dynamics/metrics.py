"""Agreement of predicted collisions and motion with what happened."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any, Protocol

import numpy as np

from nsdr.dynamics.motion_states import MotionStates
from nsdr.types import Event, Rollout
from nsdr.world.physics_constants import SAME_EVENT_FRAMES


def collision_scores(pairs: Iterable[tuple[Sequence[Event], Sequence[Event]]]) -> dict[str, float]:
    """Precision, recall and F1 of (predicted, true) collisions: same pair, frames at most `SAME_EVENT_FRAMES` apart."""
    right = predicted_total = true_total = 0
    for predicted, true in pairs:
        frames = {e.objects: e.frame for e in true}
        right += sum(abs(frames.get(e.objects, -100) - e.frame) <= SAME_EVENT_FRAMES for e in predicted)
        predicted_total += len(predicted)
        true_total += len(true)
    return {
        "collision_precision": right / max(predicted_total, 1),
        "collision_recall": right / max(true_total, 1),
        "collision_f1": 2 * right / max(predicted_total + true_total, 1),
    }


class Continues(Protocol):
    """A predictor that can go on from the last frame it is shown."""

    def continue_motion(self, states: MotionStates) -> Rollout:
        """The rollout after the last frame of `states`."""


def rollout_errors(
    predictor: Continues, scenes: Sequence[MotionStates], starts: Sequence[int] = (60, 80, 100)
) -> dict[str, float]:
    """Median and 90th percentile (`_p90`) distance (world units) of rollouts from real tracks, 10, 25 and 50 frames ahead.

    A rollout sees the frames before its start, one of `starts`, only. Objects without a position in the rollout are left out.
    """
    distances: dict[int, list[float]] = {10: [], 25: [], 50: []}
    for states in scenes:
        for start in starts:
            here = states.present[:, :start].any(1)
            if not here.any():
                continue
            names = ("location_world", "detected", "reliable", "present", "box_px", "patches")
            arrays = {name: getattr(states, name) for name in names}
            shown: dict[str, Any] = {k: None if a is None else a[here, :start] for k, a in arrays.items()}
            objects = (states.objects[i] for i in np.flatnonzero(here))
            cut = replace(states, objects=tuple(replace(o, id=i) for i, o in enumerate(objects)), **shown)
            rollout = predictor.continue_motion(cut)
            for ahead, collected in distances.items():
                frame = start - 1 + ahead
                if frame < min(states.present.shape[1], rollout.location_world.shape[1]):
                    seen = states.reliable[here, frame] & states.present[here, start - 1]
                    difference = rollout.location_world[seen, frame] - states.location_world[here, frame][seen]
                    collected += np.hypot(difference[:, 0], difference[:, 1]).tolist()
    errors = {}
    for ahead, values in distances.items():
        errors[f"rollout_error_{ahead}"] = float(np.nanmedian(values)) if values else float("nan")
        errors[f"rollout_error_{ahead}_p90"] = float(np.nanquantile(values, 0.9)) if values else float("nan")
    return errors
