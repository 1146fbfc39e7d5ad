"""Masks of other trackers: their forms, sizes and frame rates, what is wrong with them, and what follows from their tracks."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from pycocotools import mask as rle

from nsdr import Camera, DataError, Pipeline, Remove, SceneObject, VideoTracks, World, tracks_from_masks
from nsdr.generate.physics.scene import simulate_scene
from nsdr.generate.render.geometry import Solid, instance_ids
from nsdr.generate.scene_files import solids_at
from nsdr.world.camera import CLEVRER_CAMERA, on_ground
from nsdr.world.physics import Timeline
from nsdr.world.vocabulary import Color, Vocabulary

OTHER = Camera(eye_world=(3.6, 1.6, 3.2), target_world=(0.2, -0.3, 0.1), lens_mm=28.0)
WORDS = ("red metal sphere", "blue rubber cylinder")
START = np.array([[0.5, -1.0], [-0.6, 0.5]])
SPEED = np.array([[0.0, 0.05], [0.02, 0.0]])
"""Positions at the start and steps per frame at 25 frames per second (world units) of both objects."""
FRAMES = 20


def labels(camera: Camera = CLEVRER_CAMERA, fps: float = 25.0, n_frames: int = FRAMES) -> np.ndarray:
    """(F, height, width) label images of the two objects."""
    images = []
    for f in range(n_frames):
        places = on_ground(START + SPEED * f * 25 / fps)
        solids = [Solid(name.split()[2], place, np.eye(3)) for name, place in zip(WORDS, places, strict=True)]
        images.append(instance_ids(solids, camera) + 1)
    return np.stack(images)


def planes(images: np.ndarray) -> np.ndarray:
    """(N, F, height, width) the same masks as bool."""
    return images == np.arange(1, len(WORDS) + 1)[:, None, None, None]


def run_lengths(images: np.ndarray, compressed: bool = True) -> list[list[dict[str, Any] | None]]:
    """The same masks as COCO run lengths."""

    def encoded(mask: np.ndarray) -> dict[str, Any] | None:
        if not mask.any():
            return None
        found = rle.encode(np.asfortranarray(mask.astype(np.uint8)))
        if compressed:
            return found
        flat = np.concatenate([[False], mask.T.ravel()])
        changes = np.flatnonzero(flat[1:] != flat[:-1])
        return {"size": found["size"], "counts": np.diff([0, *changes, mask.size]).tolist()}

    return [[encoded(mask) for mask in of_object] for of_object in planes(images)]


def assert_near(tracks: VideoTracks, frames: np.ndarray, within: float) -> None:
    """Both objects are where they should be in these frames, and have detections in no others."""
    for t, start, speed in zip(tracks.tracks, START, SPEED, strict=True):
        assert t.frame_index.tolist() == frames.tolist()
        np.testing.assert_allclose(t.location_world, start + speed * frames[:, None], atol=within)


@pytest.mark.parametrize("camera", [CLEVRER_CAMERA, OTHER])
def test_masks_of_all_forms_give_the_same_tracks(camera: Camera) -> None:
    images = labels(camera)
    world = World(camera=camera)
    found = tracks_from_masks(images, WORDS, world)
    assert [t.object.name for t in found.tracks] == list(WORDS)
    assert (found.n_frames, found.world, found.notes) == (FRAMES, world, ())
    assert_near(found, np.arange(FRAMES), 0.02)
    known = [SceneObject(7, *words.split()) for words in WORDS]
    for masks in (images.astype(np.uint8), planes(images), run_lengths(images), run_lengths(images, compressed=False)):
        assert tracks_from_masks(masks, known, world) == found
    texts = [[{**one, "counts": one["counts"].decode()} for one in masks] for masks in run_lengths(images)]
    assert tracks_from_masks(texts, WORDS, world) == found


def test_words_are_those_of_the_world() -> None:
    colors = (Color("red", (255, 0, 0)), Color("pink", (255, 150, 200)))
    world = World("mine", vocabulary=Vocabulary(colors=colors))
    found = tracks_from_masks(labels(n_frames=4), ["pink metal sphere", "red metal sphere"], world)
    assert [t.object.color for t in found.tracks] == ["pink", "red"]
    with pytest.raises(DataError, match=r"object 1: expected one color \(red, pink\) .* got 'blue metal sphere'"):
        tracks_from_masks(FEW, ["pink metal sphere", "blue metal sphere"], world)


def test_larger_masks_are_scaled() -> None:
    large = labels(replace(OTHER, width=1200, height=800), n_frames=5)
    found, small = (
        tracks_from_masks(images, WORDS, World(camera=OTHER)) for images in (large, labels(OTHER, n_frames=5))
    )
    assert_near(found, np.arange(5), 0.02)
    for a, b in zip(found.tracks, small.tracks, strict=True):
        assert np.abs(a.centroid_px - b.centroid_px).max() < 0.1
        assert np.abs(a.box_xyxy_px - b.box_xyxy_px).max() <= 1


@pytest.mark.parametrize(("fps", "n_frames"), [(24.0, 25), (29.97, 20), (30.0, 20), (50.0, 12), (60.0, 11)])
def test_positions_are_those_of_25_frames_a_second(fps: float, n_frames: int) -> None:
    """Of a video that is a little slower, one frame has no detection."""
    found = tracks_from_masks(labels(fps=fps, n_frames=24), WORDS, fps=fps)
    assert found.n_frames == n_frames
    frames = np.arange(n_frames) if fps > 25 else np.delete(np.arange(n_frames), 13)
    assert_near(found, frames, 0.02)


def test_frames_are_those_of_the_worlds_rate() -> None:
    world = World("fast", timeline=Timeline(fps=50))
    images = labels(n_frames=6)
    assert tracks_from_masks(images, WORDS, world).tracks == tracks_from_masks(images, WORDS).tracks
    assert [t.frame_index.tolist() for t in tracks_from_masks(images, WORDS, world, 25).tracks] == [
        [0, 2, 4, 6, 8, 10]
    ] * 2


def test_slow_videos_have_detections_in_some_frames() -> None:
    images = labels()
    found = tracks_from_masks(images[::2], WORDS, fps=12.5)
    assert found.n_frames == FRAMES
    assert_near(found, np.arange(0, FRAMES, 2), 0.02)


def test_an_object_that_is_hidden_for_some_frames_has_no_detections_there() -> None:
    images = labels()
    images[5:9][images[5:9] == 2] = 0
    for masks in (images, run_lengths(images)):
        found = tracks_from_masks(masks, WORDS)
        assert found.tracks[1].frame_index.tolist() == [*range(5), *range(9, FRAMES)]


def changed(**how: Any) -> list[list[Any]]:
    """Run lengths, of which the mask of object 1 in frame 2 is changed."""
    found = run_lengths(labels(n_frames=4))
    assert found[1][2] is not None
    found[1][2] |= how
    return found


def overlapping() -> np.ndarray:
    masks = planes(labels(n_frames=4))
    masks[1, 3] |= masks[0, 3]
    return masks


FEW = labels(n_frames=4)


@pytest.mark.parametrize(
    ("masks", "objects", "said"),
    [
        (FEW.astype(float), WORDS, "give `masks > 0.5`"),
        (planes(FEW)[0], WORDS, r"bool \(N, F, height, width\), .* got bool \(4, 320, 480\)"),
        (planes(FEW).astype(np.uint8), WORDS, r"got uint8 \(2, 4, 320, 480\)"),
        (FEW[:0], WORDS, r"got int64 \(0, 320, 480\)"),
        (None, WORDS, "got object"),
        (FEW, WORDS[:1], "frame 0 has the label 2; expected .* 1 to 1 .* give words for each label"),
        (-FEW, WORDS, "frame 0 has the label -1"),
        (FEW, (*WORDS, "green metal cube"), "object 2, green metal cube: its mask in all frames is empty"),
        (planes(FEW), WORDS[:1], "expected those of 1 objects, as there are words, got 2"),
        (run_lengths(FEW), WORDS[:1], "expected those of 1 objects, as there are words, got 2"),
        (overlapping(), WORDS, r"objects 0 and 1 overlap in frame 3, by \d+ pixels; .* masks\[1\] &= ~masks\[0\]"),
        (run_lengths(FEW)[:1] * 2, WORDS, "objects 0 and 1 overlap in frame 0"),
        (changed(size=[160, 240]), WORDS, r"masks\[1\]\[2\].size: expected \[320, 480\].* got \[160, 240\]"),
        (changed(size=None), WORDS, r"masks\[1\]\[2\].size: expected \[height, width\]"),
        (changed(counts=[1, 2]), WORDS, r"masks\[1\]\[2\].counts: expected COCO run lengths of 320x480"),
        (changed(counts=b"@"), WORDS, r"masks\[1\]\[2\].counts: expected"),
        (changed(counts=None), WORDS, r"masks\[1\]\[2\].counts: expected"),
        ([run_lengths(FEW)[0], run_lengths(FEW)[1][:3]], WORDS, r"masks\[1\]: expected 4 frames, .* got 3"),
        ([[None] * 4] * 2, WORDS, "a mask in some frame"),
        (FEW, (WORDS[0], "pink metal cube"), "object 1: expected one color .* got 'pink metal cube'"),
        (FEW, (WORDS[0], {"color": "red"}), "object 1: expected one color"),
        (FEW, (WORDS[0], WORDS[0]), "objects 0 and 1: expected other words"),
        (FEW, "red metal cube", "objects: expected the words of each object"),
        (FEW, (), "objects: expected the words of each object"),
        (FEW[:, :300], WORDS, "crop frames and masks to the columns 15:465"),
    ],
)
def test_malformed_masks_are_refused(masks: Any, objects: Any, said: str) -> None:
    with pytest.raises(DataError, match=said):
        tracks_from_masks(masks, objects)


def test_pixels_are_those_of_the_worlds_images() -> None:
    found = tracks_from_masks(labels(n_frames=5), WORDS, World(camera=Camera(width=960, height=640)))
    assert_near(found, np.arange(5), 0.02)
    assert found.tracks[0].centroid_px[0, 0] < 480 < found.tracks[1].centroid_px[0, 0]


def test_images_of_another_aspect_ratio_and_impossible_rates_are_refused() -> None:
    with pytest.raises(DataError, match=r"expected the aspect ratio 16:9, got 480x320; crop .* to the rows 25:295"):
        tracks_from_masks(FEW, WORDS, World(camera=Camera(width=640, height=360)))
    for fps in (0.0, np.nan, "25"):
        with pytest.raises(DataError, match="fps: expected 1 to 1000"):
            tracks_from_masks(FEW, WORDS, fps=fps)


def test_masks_above_the_horizon_are_left_out() -> None:
    camera = Camera(eye_world=(6.0, 0.0, 1.0), target_world=(0.0, 0.0, 0.5))
    images = labels(camera, n_frames=4)
    images[1][images[1] == 2] = 0
    images[1, :20, :20] = 2
    found = tracks_from_masks(images, WORDS, World(camera=camera))
    assert found.tracks[1].frame_index.tolist() == [0, 2, 3]
    assert found.notes == ("masks above the horizon are left out in 1 frames",)
    images[images == 2] = 0
    images[:, :20, :20] = 2
    with pytest.raises(DataError, match=r"object 1, blue rubber cylinder: .* above the horizon; is the camera right"):
        tracks_from_masks(images, WORDS, World(camera=camera))


@pytest.fixture(scope="module")
def clip() -> tuple[np.ndarray, tuple[SceneObject, ...]]:
    """Label images of a generated scene from another camera, and its objects."""
    scene = simulate_scene(500021, removals=False)
    return np.stack([instance_ids(solids_at(scene, f), OTHER) + 1 for f in range(scene.n_frames)]), scene.objects


def test_masks_lead_to_answers_and_what_ifs(clip, pipeline: Pipeline) -> None:
    tracks = tracks_from_masks(*clip, World(camera=OTHER))
    perception = pipeline.perceive(tracks=tracks)
    assert pipeline.answer(perception.scene, "How many objects are there?").answer == len(clip[1])
    assert perception.scene.notes == ()
    assert pipeline.simulate(tracks, [Remove(0)]).scene.n_frames == len(clip[0])


def test_tracks_of_masks_are_judged(clip, pipeline: Pipeline) -> None:
    """Also slow ones. An object without a mask where nothing hides it has vanished."""
    images, objects = clip
    for step in (1, 2):
        lawful = pipeline.judge(tracks=tracks_from_masks(images[::step], objects, World(camera=OTHER), 25 / step))
        assert lawful.violations == ()
    gone = images.copy()
    number = 1 + int(np.argmax([(gone[60:80] == o.id + 1).sum() for o in objects]))
    gone[60:80][gone[60:80] == number] = 0
    (violation,) = pipeline.judge(tracks=tracks_from_masks(gone, objects, World(camera=OTHER))).violations
    assert (violation.law, violation.objects, violation.frame, violation.end) == ("permanence", (number - 1,), 60, 80)


def test_judging_tracks_notes_the_wrong_camera(clip, pipeline: Pipeline) -> None:
    wrong = replace(OTHER, eye_world=(4.5, 2.0, 4.0))
    assert "objects look" in pipeline.judge(tracks=tracks_from_masks(*clip, World(camera=wrong))).notes[0]
