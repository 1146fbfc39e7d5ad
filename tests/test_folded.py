"""The state backend's networks for inference against the networks that are trained."""

import numpy as np
import pytest
import torch

from nsdr import StatePredictor
from nsdr.dynamics.propnet.state_model import StateModel, StateModelConfig
from nsdr.tracking.tracker import track

from .test_dynamics import SMALL
from .test_frame_parser import BLUE, GREEN, RED, as_proposals, moving


class _Unfolded(StateModel):
    def folded(self):
        return self


def inputs(scenes: int, n: int, samples: int) -> tuple[torch.Tensor, ...]:
    """Objects about a diameter apart; a third of them does not exist."""
    start, steps = torch.randn(scenes, n, 1, 2), 0.1 * torch.randn(scenes, n, samples, 2)
    static = torch.nn.functional.one_hot(torch.randint(5, (scenes, n)), 5).float()
    return start + steps.cumsum(2), torch.rand(scenes, n, samples) > 0.3, static, torch.rand(scenes, n) > 0.3


@pytest.mark.parametrize("steps", [1, 2, 3])
@torch.inference_mode()
def test_folded_networks_agree_with_those_that_are_trained(steps: int) -> None:
    torch.manual_seed(0)
    config = StateModelConfig(hidden=16, propagation_steps=steps)
    model = StateModel(config)
    folded = model.folded()
    for scenes in (7, 4, 4):  # the second and third have the same sizes but other objects
        window, reliable, static, exists = inputs(scenes, 5, config.past_steps)
        exists[0], exists[1] = False, torch.arange(5) == 3  # no object; one alone
        both = exists[:, :, None] & exists[:, None] & ~torch.eye(5, dtype=torch.bool)
        expected, expected_logits = model.predict(window, reliable, static, exists)
        positions, logits = folded.predict(window, reliable, static, exists)
        torch.testing.assert_close(positions[exists], expected[exists], rtol=0, atol=1e-5)
        torch.testing.assert_close(logits[both], expected_logits[both], rtol=1e-5, atol=1e-5)
        assert (logits[~both] == -torch.inf).all()
        window, reliable, static, _ = inputs(scenes, 5, 2 * config.side_steps + 1)
        logits = folded.observe(window, reliable, static, exists)
        expected_logits = model.observe(window, reliable, static, exists)
        torch.testing.assert_close(logits[both], expected_logits[both], rtol=1e-5, atol=1e-5)


@torch.inference_mode()
def test_folded_networks_take_scenes_without_objects() -> None:
    positions, logits = StateModel(SMALL).folded().predict(*inputs(2, 0, SMALL.past_steps))
    assert positions.shape == (2, 0, 2)
    assert logits.shape == (2, 0, 0)


def test_predictions_do_not_depend_on_the_folding_and_follow_the_weights() -> None:
    rows = moving(range(40), RED, 50, 4) + moving(range(40), BLUE, 300, 0) + moving(range(12, 40), GREEN, 400, -1)
    video = track(as_proposals(rows, 40))
    torch.manual_seed(0)
    model, other = StateModel(SMALL), _Unfolded(SMALL)
    predictor, reference = StatePredictor(model), StatePredictor(other)
    predictor.predict(video)
    for parameter in model.parameters():  # as training does between two measurements
        parameter.data += 0.02
    other.load_state_dict(model.state_dict())
    ours, expected = predictor.predict(video), reference.predict(video)
    for rollout, same in zip(
        [ours.observed, *ours.counterfactual.values()],
        [expected.observed, *expected.counterfactual.values()],
        strict=True,
    ):
        np.testing.assert_allclose(rollout.location_world, same.location_world, atol=1e-4)
        np.testing.assert_array_equal(rollout.visible, same.visible)
        assert rollout.collisions == same.collisions
