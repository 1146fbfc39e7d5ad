"""The collision network: its inputs, its training, and what it finds."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from nsdr import SceneObject, VideoTracks
from nsdr.dynamics.collisions.features import MotionArrays, arrays_from_states, near_pairs, network_inputs
from nsdr.dynamics.collisions.network import CollisionNetwork, CollisionNetworkConfig, TrackCollisionDetector
from nsdr.dynamics.motion_states import MotionStates, states_from_tracks
from nsdr.dynamics.registry import load_backend
from nsdr.errors import CheckpointError, DataError
from nsdr.training import collisions as training
from nsdr.world.camera import CLEVRER_CAMERA, on_ground
from nsdr.world.world import CLEVRER_WORLD

SMALL = CollisionNetworkConfig(width=8)


def states(n_frames: int = 60, objects: int = 3) -> MotionStates:
    """Objects that all rest but the first, which passes the second at frame 30 and stays away from the third."""
    location = np.zeros((objects, n_frames, 2))
    location[0, :, 0] = 0.05 * (np.arange(n_frames) - 30)
    location[1] = (0.0, 0.5)
    location[2:] = (0.0, -3.0)
    seen = np.ones((objects, n_frames), bool)
    box = np.concatenate([CLEVRER_CAMERA.pixels(on_ground(location)), np.full((objects, n_frames, 2), 40.0)], -1)
    kinds = [SceneObject(i, "red", "metal", ("sphere", "cube", "cylinder")[i % 3]) for i in range(objects)]
    return MotionStates(tuple(kinds), location, seen, seen, seen, box)


def network(seed: int = 0) -> CollisionNetwork:
    torch.manual_seed(seed)
    return CollisionNetwork(SMALL).eval()


def logits(model: CollisionNetwork, arrays: MotionArrays, pairs: np.ndarray) -> np.ndarray:
    with torch.no_grad():
        return model(network_inputs(arrays, pairs, CLEVRER_WORLD.scales)).numpy()


def test_only_pairs_that_come_near_are_looked_at() -> None:
    arrays = arrays_from_states(states())
    assert near_pairs(arrays.location_world, arrays.radius, CLEVRER_WORLD.scales).tolist() == [[0, 1]]
    assert near_pairs(arrays.location_world[:1], arrays.radius[:1], CLEVRER_WORLD.scales).shape == (0, 2)
    detector = TrackCollisionDetector(network())
    assert [e.objects for e, _ in detector.collision_candidates(states())] == [(0, 1)]
    assert detector.collision_candidates(states_from_tracks(VideoTracks(20, ()))) == []


@pytest.mark.parametrize("n_frames", [7, 60, 61])
def test_there_is_a_logit_for_every_second_frame(n_frames: int) -> None:
    found = logits(network(), arrays_from_states(states(n_frames)), np.array([[0, 1]]))
    assert found.shape == (1, (n_frames + 1) // 2)
    assert np.isfinite(found).all()


def test_the_order_of_a_pair_and_of_the_objects_does_not_matter() -> None:
    model, some = network(), states()
    pairs, order = np.array([[0, 1], [1, 2]]), np.array([2, 0, 1])
    expected = logits(model, arrays_from_states(some), pairs)
    np.testing.assert_allclose(logits(model, arrays_from_states(some), pairs[:, ::-1]), expected, atol=1e-5)
    objects = tuple(some.objects[i] for i in order)
    arrays = {
        name: getattr(some, name)[order] for name in ("location_world", "detected", "reliable", "present", "box_px")
    }
    renumbered = np.array([[1, 2], [2, 0]])
    found = logits(model, arrays_from_states(MotionStates(objects, **arrays)), renumbered)
    np.testing.assert_allclose(found, expected, atol=1e-5)


def test_videos_together_give_what_each_gives_alone() -> None:
    model, a, b = network(), arrays_from_states(states()), arrays_from_states(states(objects=4))
    both = MotionArrays(*(np.concatenate([getattr(a, n), getattr(b, n)]) for n in MotionArrays.__dataclass_fields__))
    pair = np.array([[0, 1]])
    together = logits(model, both, np.concatenate([pair, pair + 3]))
    alone = np.concatenate([logits(model, a, pair), logits(model, b, pair)])
    np.testing.assert_allclose(together, alone, atol=1e-5)


def test_pairs_tell_each_other_what_they_found() -> None:
    """The logits of a pair depend on the motion of an object that only its partner's other pair knows."""
    model, some = network(), states()
    moved = some.location_world.copy()
    moved[2, 30:, 0] += 0.5
    changed = replace(some, location_world=moved)
    pairs = np.array([[0, 1], [1, 2]])
    first, second = (logits(model, arrays_from_states(s), pairs)[0] for s in (some, changed))
    assert np.abs(first - second).max() > 1e-6


def test_hidden_sides_are_those_of_detected_boxes() -> None:
    some = states()
    box = some.box_px.copy()
    box[0] = box[1] + (5, 5, 0, 0)  # nearer, and over the other one's right half
    detected = some.detected.copy()
    detected[1, 20:] = False
    arrays = arrays_from_states(replace(some, box_px=box, detected=detected))
    assert arrays.hidden[1, :20, 2].all()
    assert not arrays.hidden[1, 20:].any()


def test_the_step_loss_is_a_cross_entropy_that_shares_odd_frames() -> None:
    scores = torch.tensor([[0.0, 2.0, 1.0], [0.0, 2.0, 1.0], [0.0, 2.0, 1.0]])
    total = float(np.log(1 + 1 + np.exp(2) + np.exp(1)))
    expected = (total - 2.0) + (total - 1.5) + total  # at frame 2, at frame 3, never
    assert training.step_loss(scores, torch.tensor([2.0, 3.0, -1000.0])).item() == pytest.approx(expected, abs=1e-5)


def test_training_learns_saves_and_is_loaded(tiny_motion: tuple[Path, Path], tmp_path: Path) -> None:
    proposals, truth = tiny_motion
    options = ["--proposals", str(proposals), "--truth", str(truth), "--run-dir", str(tmp_path / "run")]
    options += ["--loop.steps", "60", "--loop.batch-size", "4", "--loop.learning-rate", "0.01", "--model.width", "8"]
    folder = training.main([*options, "--output", str(tmp_path / "weights")])
    detector = TrackCollisionDetector.from_pretrained(folder)
    data = training.read_motion_dataset(proposals, truth)
    (event, probability), *more = detector.collision_candidates(data.states(0)[0])
    assert not more
    assert event.objects == (0, 1)
    assert abs(event.frame - 40) <= 3
    assert probability > 0.5
    detector.save_pretrained(tmp_path / "again")
    again = TrackCollisionDetector.from_pretrained(tmp_path / "again")
    assert again.collision_candidates(data.states(0)[0]) == [(event, probability)]


def test_gaps_and_errors_keep_the_rest_of_a_track(tiny_motion: tuple[Path, Path], tmp_path: Path) -> None:
    proposals, truth = map(str, tiny_motion)
    for gap, bias in ((1.0, 0.0), (0.0, 1.0)):
        config = training.CollisionTraining(
            proposals, truth, str(tmp_path / f"run{gap}"), noise_world=0.0, gap_share=gap, bias_share=bias, model=SMALL
        )
        task = training.CollisionTask(config)
        changed = 0
        for example in task.draw(20, np.random.default_rng(0), 0):
            before, after = task.arrays[example.scene], task._disturbed(example)
            mirror = -1 if example.mirror else 1
            difference = np.abs(after.location_world * (1, mirror) - before.location_world).max(-1)
            assert difference[after.reliable].max() < 1e-6
            changed += bool((after.reliable != before.reliable).any())
            if not gap:
                np.testing.assert_array_equal(after.detected, before.detected)
        assert changed > 5


def test_held_out_scenes_are_needed(tiny_motion: tuple[Path, Path], tmp_path: Path) -> None:
    proposals, truth = map(str, tiny_motion)
    with pytest.raises(DataError, match="expected scenes whose index is divisible by 5"):
        training.CollisionTask(training.CollisionTraining(proposals, truth, str(tmp_path), limit=1))


def test_the_physics_backend_needs_a_collision_network(tmp_path: Path) -> None:
    with pytest.raises(CheckpointError, match=r"has none of .*collisions\.json.*expected the folder of a checkpoint"):
        load_backend("physics", tmp_path)


@pytest.mark.parametrize("name", ["object_dilations", "pair_dilations", "last_dilations"])
def test_dilations_below_one_are_refused(name: str) -> None:
    with pytest.raises(DataError, match=name):
        CollisionNetworkConfig(**{name: (1, 0)})
