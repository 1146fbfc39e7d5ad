"""The judge as a reward: what a video earns."""

import numpy as np
import pytest

from nsdr import DataError, Pipeline, read_video
from nsdr.clevrer.example import VIDEO
from nsdr.dynamics.sliding import law_of, slide
from nsdr.generate.render.preview import render_motion
from nsdr.generate.render.view import View
from nsdr.rewards import lawfulness, lawfulness_parts
from nsdr.types import LAWS, SceneObject
from nsdr.world.world import CLEVRER_WORLD

pytestmark = pytest.mark.filterwarnings("ignore:.* frames")
CUBE = SceneObject(0, "red", "rubber", "cube")


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


def rendered(*path: np.ndarray) -> np.ndarray:
    """24 frames of the table, with a cube if it is given its path (24, 2), and with a camera's noise."""
    places = np.array(path).reshape(-1, 24, 2)
    frames = np.stack(list(render_motion([CUBE][: len(path)], places, np.zeros(places.shape[:2]), View())))
    noise = np.random.default_rng(0).normal(0, 2, frames.shape)
    return np.clip(frames + noise, 0, 255).round().astype(np.uint8)


def test_what_does_not_move_earns_nothing_and_a_lawful_slide_earns_its_distance() -> None:
    seconds = np.arange(24) * CLEVRER_WORLD.physics.frame_seconds
    slid = slide(law_of(CUBE, CLEVRER_WORLD), np.array(2.8), seconds)[0]
    resting, sliding = np.full((24, 2), (0.3, -0.5)), np.stack([slid - 1.5, np.full(24, 0.2)], 1)
    videos = [rendered(), rendered(resting), rendered(sliding)]
    empty, rest, alone = lawfulness_parts(videos, Pipeline.from_pretrained(device="cpu"))
    assert (empty.reward, set(empty.laws.values())) == (0, {0})
    assert "no objects found" in empty.problem
    assert (rest.reward, rest.motion, rest.problem) == (0, 0, "")
    assert rest.laws == alone.laws == dict.fromkeys(LAWS, 1)
    assert alone.motion == pytest.approx(slid[-1] / 4, abs=0.02)
    assert alone.reward == pytest.approx(alone.motion, abs=0.05)


def test_frames_of_another_form_are_refused() -> None:
    with pytest.raises(DataError, match="expected an image or an array"):
        lawfulness(np.zeros((4, 8, 8), np.float32))
