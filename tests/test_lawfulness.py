"""The judge as a reward: what a video earns."""

import numpy as np
import pytest

from nsdr import DataError, Pipeline, read_video
from nsdr.clevrer.example import VIDEO
from nsdr.rewards import lawfulness, lawfulness_parts
from nsdr.types import LAWS

pytestmark = pytest.mark.filterwarnings("ignore:.* frames")


@pytest.fixture(scope="module")
def frames() -> np.ndarray:
    """The first two seconds of the example, in which objects enter and collide."""
    return read_video(VIDEO)[:50]


def test_a_video_earns_as_it_obeys_the_laws_and_shows_motion(frames) -> None:
    jump = np.concatenate([frames[:20], frames[32:]])
    still = np.repeat(frames[20:21], 24, 0)
    noise = np.random.default_rng(0).integers(0, 255, frames[:24].shape, np.uint8)
    pipeline = Pipeline.from_pretrained(device="cpu")
    lawful, jumping, resting, unseen = lawfulness_parts([frames, jump, still, noise], pipeline)
    assert lawful.reward > 0.9
    assert lawful.laws == dict.fromkeys(LAWS, 1)
    assert jumping.reward < 0.1
    assert jumping.laws["continuity"] < 0.1
    assert (resting.reward, resting.motion, resting.problem) == (0, 0, "")
    assert (unseen.reward, set(unseen.laws.values())) == (0, {0})
    assert "not a video of CLEVRER's scene" in unseen.problem
    assert lawfulness(noise, pipeline) == 0


def test_frames_of_another_form_are_refused() -> None:
    with pytest.raises(DataError, match="expected an image or an array"):
        lawfulness(np.zeros((4, 8, 8), np.float32))
