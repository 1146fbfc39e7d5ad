"""An explained video: how it is continued, and what happens with changes."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from nsdr import (
    Add,
    Camera,
    DataError,
    Event,
    Explanation,
    Freeze,
    PhysicsPredictor,
    Remove,
    Rollout,
    SceneObject,
    SetMass,
    VideoTracks,
)
from nsdr.dynamics import StoredExplanation, simulate, states_from_tracks
from nsdr.types import DynamicsPrediction
from nsdr.types.interventions import Intervention
from nsdr.world.world import World

OBJECTS = (SceneObject(0, "red", "metal", "sphere"), SceneObject(1, "blue", "rubber", "cube"))
FRAMES = 10
HORIZON = 15
"""Frames of a rollout to 7/5 of the video."""


class Still(Explanation):
    """Nothing moves. Remembers what it was asked for."""

    def __init__(self) -> None:
        super().__init__(OBJECTS, FRAMES)
        self.asked: list[tuple[Any, ...]] = []

    def run(self, changes: Sequence[Intervention], from_frame: int, frames: int) -> Rollout:
        self.asked.append((*changes, from_frame, frames))
        n = len(OBJECTS) + sum(isinstance(change, Add) for change in changes)
        return Rollout(np.zeros((n, frames, 2)), np.ones((n, frames), bool), ())


def test_a_removal_is_computed_when_it_is_asked_for_and_kept() -> None:
    video = Still()
    assert list(video.counterfactual) == [0, 1]
    assert video.asked == []
    assert video.counterfactual[1] is video.counterfactual[1]
    assert video.asked == [(Remove(1), 0, HORIZON)]
    assert video.prediction.counterfactual[1] is video.counterfactual[1]
    assert video.observed is video.prediction.observed
    assert video.asked == [(Remove(1), 0, HORIZON), (Remove(0), 0, HORIZON), (0, HORIZON)]
    with pytest.raises(KeyError):
        video.counterfactual[2]


def test_a_rollout_is_as_long_as_it_is_asked_for_but_not_shorter_than_the_video() -> None:
    video = Still()
    assert [video.rollout(frames=n).visible.shape[1] for n in (30, 3, None)] == [30, FRAMES, HORIZON]


def test_backends_get_checked_changes_with_ids() -> None:
    video = Still()
    new = Add("gray", "rubber", "cylinder", 1.0, 1.0)
    video.rollout([SetMass("sphere", 2.0), new, Freeze(1)], from_frame=4)
    assert video.asked[-1] == (SetMass(0, 2.0), new, Freeze(1), 4, HORIZON)
    for changes, from_frame, message in (
        ([Remove("green")], 0, "no object fits"),
        ([Remove(0), Freeze(0)], 0, "contradict"),
        ([Remove(0)], FRAMES, "from_frame"),
        (Remove(0), 0, "expected a list"),
    ):
        with pytest.raises(DataError, match=message):
            video.rollout(changes, from_frame)  # type: ignore[arg-type]


def test_a_simulation_has_the_added_objects_in_both_worlds() -> None:
    simulation = simulate(Still(), [Add("gray", "rubber", "cylinder", 1.0, 1.0)], from_frame=2)
    assert [o.name for o in simulation.objects] == ["red metal sphere", "blue rubber cube", "gray rubber cylinder"]
    assert not simulation.original.visible[2].any()
    assert simulation.changed.visible[2].all()
    with pytest.raises(DataError, match="expected at least one"):
        simulate(Still(), [])


def test_a_stored_prediction_knows_what_was_stored() -> None:
    whole, without = (Rollout(np.full((2, 12, 2), x), np.ones((2, 12), bool), ()) for x in (0.0, 1.0))
    stored = StoredExplanation(DynamicsPrediction(OBJECTS, FRAMES, whole, {0: without}))
    assert stored.rollout() is whole
    assert stored.rollout([Remove("red sphere")]) is without
    for changes, from_frame, frames, message in (
        ([Remove(1)], 0, None, "no rollout without the blue rubber cube"),
        ([Remove(0)], 3, None, "Remove from frame 3: stored predictions can only remove one object from frame 0"),
        ([Freeze(0)], 0, None, "Freeze from frame 0: stored predictions can only remove"),
        ((), 0, 13, "the stored rollouts have 12, got 13"),
    ):
        with pytest.raises(DataError, match=message):
            stored.rollout(changes, from_frame, frames)


def test_a_stored_rollout_is_cut_to_the_frames_that_are_asked_for() -> None:
    hits = (Event("collision", 2, (0, 1)), Event("collision", FRAMES + 1, (0, 1)))
    n = len(OBJECTS)
    whole = Rollout(np.zeros((n, FRAMES + 5, 2)), np.ones((n, FRAMES + 5), bool), hits)
    cut = StoredExplanation(DynamicsPrediction(OBJECTS, FRAMES, whole)).rollout(frames=FRAMES)
    assert cut.location_world.shape == (n, FRAMES, 2)
    assert cut.visible.shape == (n, FRAMES)
    assert cut.collisions == hits[:1]


def test_a_video_without_objects_is_explained() -> None:
    camera = Camera((5.0, 0.0, 3.0))
    nothing = PhysicsPredictor.from_pretrained(device="cpu").explain(
        states_from_tracks(VideoTracks(FRAMES, (), World(camera=camera)))
    )
    assert nothing.camera == camera
    assert nothing.rollout([]).visible.shape[0] == 0
