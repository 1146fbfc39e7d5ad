"""Videos from other cameras: sizes of objects, and another place, direction and lens."""

from dataclasses import replace

import numpy as np
import pytest

from nsdr import Camera, CheckpointError, DataError, Pipeline, PipelineConfig
from nsdr.clevrer.example import VIDEO
from nsdr.cli.main import main
from nsdr.dynamics.motion_states import states_from_tracks
from nsdr.dynamics.physics.trajectory_fit import fit_trajectories
from nsdr.dynamics.propnet.patches import boxes_of
from nsdr.dynamics.sliding import slide
from nsdr.dynamics.track_smoothing import smooth_tracks
from nsdr.generate.render.view import RenderConfig, view_of
from nsdr.io.fingerprint import fingerprint
from nsdr.io.storage import load, save
from nsdr.pipeline import pipeline_settings
from nsdr.tracking.localization import expected_size, ground_location, outline, size_notes, size_ratio
from nsdr.tracking.tracker import track, tracks_from_annotation
from nsdr.tracking.visibility import hidden_sides
from nsdr.types import SceneObject, Track, VideoTracks
from nsdr.world.camera import CLEVRER_CAMERA
from nsdr.world.world import CLEVRER_WORLD, World

from .test_dynamics import LAWS
from .test_frame_parser import BLUE, RED, as_proposals, moving

OTHER = Camera(eye_world=(3.6, 1.6, 3.2), target_world=(0.2, -0.3, 0.1), lens_mm=28.0)


def tracks(zoom: tuple[float, float], n: int = 2, camera: Camera = CLEVRER_CAMERA) -> VideoTracks:
    """Spheres at rest, whose boxes are larger than they should be by a factor of width and height."""
    found = []
    for k in range(n):
        polygon = outline("sphere", 0.5, k - 0.5, camera=camera)
        low, high = polygon.min(0), polygon.max(0)
        centre, half = (low + high) / 2, (high - low) / 2 * zoom
        frames = np.arange(9)
        box = np.tile(np.round([*(centre - half), *(centre + half)]), (9, 1)).astype(int)
        place = np.tile([0.5, k - 0.5], (9, 1))
        sphere = SceneObject(k, "red", "rubber", "sphere")
        found.append(Track(sphere, frames, place, np.tile(centre, (9, 1)), box, np.ones(9)))
    return VideoTracks(128, tuple(found), World(camera=camera))


def test_expected_sizes_are_those_of_outlines() -> None:
    for camera in (CLEVRER_CAMERA, OTHER):
        polygon = outline("cylinder", 0.3, 0.8, camera=camera)
        (found,) = expected_size("cylinder", np.array([[0.3, 0.8]]), camera)
        assert found == pytest.approx(polygon.max(0) - polygon.min(0), abs=0.5)


def test_sizes_that_do_not_fit_the_camera_are_doubtful() -> None:
    assert size_ratio(tracks((1.25, 1.0))) == pytest.approx([1.25, 1.0], abs=0.03)
    assert size_notes(tracks((1.0, 1.0))) == ()
    assert "1.2" in "".join(size_notes(tracks((1.25, 1.25))))
    assert "0.7" in "".join(size_notes(tracks((0.75, 1.0))))
    assert size_ratio(tracks((2.0, 2.0), n=1)) is None
    assert size_notes(tracks((1.0, 1.0), camera=OTHER)) == ()
    assert size_notes(replace(tracks((1.0, 1.0), camera=OTHER), world=CLEVRER_WORLD)) != ()


def test_a_camera_sees_its_target_in_the_middle_and_upright() -> None:
    np.testing.assert_allclose(OTHER.pixels(OTHER.target_world), [240, 160], atol=1e-9)
    column, row = OTHER.pixels([0.2, -0.3, 1.0])
    assert column == pytest.approx(240, abs=1e-9)
    assert row < 160
    assert OTHER.focal_px == pytest.approx(0.8 * CLEVRER_CAMERA.focal_px)
    np.testing.assert_allclose(OTHER.ground(OTHER.pixels([1.0, -0.7, 0.2])), [1.0, -0.7], atol=1e-9)


MARKS = np.array([(x, y) for x in (1.5, 0.0, -1.5) for y in (-1.5, 0.0, 1.5)])
"""Places of marks on the ground."""


def clicked(camera: Camera, places: np.ndarray = MARKS) -> np.ndarray:
    """Where a camera sees marks on the ground, which are lower than centres of objects."""
    return camera.pixels(np.c_[places, np.zeros(len(places))])


@pytest.mark.parametrize("camera", [CLEVRER_CAMERA, OTHER, Camera((-2.0, -5.0, 1.5), (0.0, 0.3, 0.0), 50.0)])
def test_a_camera_is_found_from_points(camera: Camera) -> None:
    """Also from four corners, from places of any height, and in an image of another size."""
    high = np.array([[0.0, 0.0, 0.4], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.3], [0.0, -1.0, 0.0]])
    for pixels, places in ((clicked(camera), MARKS), (camera.pixels(high), high)):
        for scale in (1, 4):
            found, residual_px = Camera.from_points(scale * pixels, places, (480 * scale, 320 * scale))
            assert residual_px < 1e-6
            np.testing.assert_allclose(found.matrix, camera.matrix, rtol=1e-6, atol=1e-6)
    corners = MARKS[[0, 2, 6, 8]]
    noise = np.random.default_rng(0).normal(size=(4, 2))
    found, residual_px = Camera.from_points(clicked(camera, corners) + noise, corners)
    assert residual_px < 2
    places = np.array([[0.5, 0.5], [0.0, -0.7]])
    np.testing.assert_allclose(found.ground(camera.pixels(places)), places, atol=0.06)


def test_a_camera_of_wider_images_is_found_from_points() -> None:
    camera = Camera((3.0, 0.5, 3.0), (0.0, 0.0, 0.0), 30.0, 640, 360)
    for scale in (1, 3):
        found, residual_px = Camera.from_points(scale * clicked(camera), MARKS, (640 * scale, 360 * scale), (640, 360))
        assert residual_px < 1e-6
        np.testing.assert_allclose(found.matrix, camera.matrix, rtol=1e-6, atol=1e-6)
    for size_px, message in (((640, 400), "expected the aspect ratio 16:9, got 640x400"), ((0, 360), "above 0")):
        with pytest.raises(ValueError, match=message):
            Camera.from_points(clicked(camera), MARKS, size_px, (640, 360))


def test_the_residual_is_the_distance_of_the_points_from_where_the_camera_sees_them() -> None:
    pixels = clicked(OTHER) + np.random.default_rng(1).normal(size=(9, 2))
    found, residual_px = Camera.from_points(pixels, MARKS)
    off = np.linalg.norm(clicked(found) - pixels, axis=1)
    assert residual_px == pytest.approx(np.sqrt((off**2).mean()))


LINE = np.array([(0.0, y) for y in (-1.5, -0.5, 0.5, 1.5)])


@pytest.mark.parametrize(
    ("pixels", "places", "said"),
    [
        (clicked(OTHER)[:3], MARKS[:3], "expected 4 or more"),
        (clicked(OTHER)[[0, 0, 1, 2]], MARKS[[0, 0, 1, 2]], "4 or more different points, got 3"),
        (clicked(OTHER), MARKS[:4], "one world point for each pixel, got 9 and 4"),
        (clicked(OTHER)[:, :1], MARKS, r"pixels \(N, 2\)"),
        (clicked(OTHER) * np.nan, MARKS, "finite"),
        (clicked(CLEVRER_CAMERA, LINE), LINE, "not on one line"),
        (clicked(OTHER, LINE), LINE, "not on one line"),
        (clicked(OTHER, 0.2 * MARKS[[0, 2, 6, 8]]), 0.2 * MARKS[[0, 2, 6, 8]], "further apart"),
        (clicked(OTHER), MARKS[:, ::-1], "x towards the camera, y to the right"),
        (clicked(OTHER)[[1, 0, *range(2, 9)]], MARKS, "at point [01]. Was it exchanged"),
    ],
)
def test_points_that_determine_no_camera_are_refused(pixels: np.ndarray, places: np.ndarray, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        Camera.from_points(pixels, places)


def test_a_rolled_camera_is_refused_with_its_roll() -> None:
    a = np.radians(6)
    turned = (clicked(OTHER) - [240, 160]) @ [[np.cos(a), np.sin(a)], [-np.sin(a), np.cos(a)]] + [240, 160]
    with pytest.raises(ValueError, match=r"rolled \(by about [56] degrees"):
        Camera.from_points(turned, MARKS)


def test_an_image_of_another_aspect_ratio_is_refused_with_the_part_to_crop() -> None:
    """The cropped points give the camera."""
    wide = 4 * clicked(OTHER) + [(1920 * 1280 / 1080 - 1920) / 2, 0]
    with pytest.raises(ValueError, match="columns 150:1770, and subtract 150"):
        Camera.from_points(wide, MARKS, (1920, 1080))
    pixels = clicked(OTHER) * 1080 / 320 + [150, 0]
    found, _ = Camera.from_points(pixels - [150, 0], MARKS, (1620, 1080))
    np.testing.assert_allclose(found.matrix, OTHER.matrix, rtol=1e-6, atol=1e-6)
    with pytest.raises(ValueError, match=r"rows 600:1320, .*, give images_px=\(1080, 1920\)"):
        Camera.from_points(wide, MARKS, (1080, 1920))


LEVEL = Camera(eye_world=(6.0, 0.0, 1.0), target_world=(0.0, 0.0, 0.5))
"""The horizon lies in its image."""


def test_above_the_horizon_there_is_no_ground() -> None:
    np.testing.assert_allclose(LEVEL.ground(LEVEL.pixels([[-3.0, 1.0, 0.2], [2.0, -1.0, 0.2]])), [[-3, 1], [2, -1]])
    assert np.isnan(LEVEL.ground([[240.0, 20.0], [10.0, 110.0]])).all()
    stone = moving(range(40), RED, 100, 3)
    cloud = [
        (f, BLUE, s, (x, 30.0), [box[0], 15, box[2], 45]) for f, _, s, (x, _), box in moving(range(40), RED, 50, 3)
    ]
    low = [(f, a, s, (x, 250.0), [box[0], 235, box[2], 265]) for f, a, s, (x, _), box in stone]
    assert [t.object.color for t in track(replace(as_proposals(low + cloud), world=World(camera=LEVEL))).tracks] == [
        "red"
    ]
    with pytest.raises(ValueError, match="above the ground"):
        Camera(eye_world=(6.0, 0.0, 1.0), target_world=(0.0, 0.0, 5.0))


@pytest.mark.parametrize("shape", ["cube", "sphere", "cylinder"])
@pytest.mark.parametrize("camera", [OTHER, LEVEL])
def test_positions_follow_from_masks_by_any_camera(shape: str, camera: Camera) -> None:
    polygon = outline(shape, 0.4, -0.6, 0.3, camera)
    box = np.array([[*polygon.min(0), *polygon.max(0)]])
    x, y = polygon.T
    cross = x * np.roll(y, -1) - np.roll(x, -1) * y
    centroid = np.array([((x + np.roll(x, -1)) * cross).sum(), ((y + np.roll(y, -1)) * cross).sum()]) / (
        3 * cross.sum()
    )
    (found,) = ground_location(shape, centroid[None], box, hidden_sides(box, camera), camera)
    np.testing.assert_allclose(found, [0.4, -0.6], atol=0.03)


def test_all_that_follows_from_tracks_uses_their_camera(tmp_path) -> None:
    """A cube slides through the image of the other camera; what is measured of it there explains it."""
    frames = [
        {
            "objects": [
                {
                    "object_id": 0,
                    "inside_camera_view": True,
                    "location": [-1.0 + distance, 0.5, 0.2],
                    "orientation": [0.0, 0.0, 0.3],
                }
            ]
        }
        for distance in slide(LAWS["cube"], np.array(1.2), np.arange(40) * CLEVRER_WORLD.physics.frame_seconds)[0]
    ]
    cube = {"object_id": 0, "color": "red", "material": "metal", "shape": "cube"}
    seen = tracks_from_annotation({"object_property": [cube], "motion_trajectory": frames}, World(camera=OTHER))
    save(tmp_path / "tracks.json", seen)
    assert load(tmp_path / "tracks.json", VideoTracks) == seen
    states = states_from_tracks(seen)
    assert states.camera == OTHER
    smoothed = smooth_tracks(states, [])
    assert smoothed.visible.all()
    fit = fit_trajectories(states, [])
    assert fit.cost < 0.2
    assert fit_trajectories(replace(states, world=CLEVRER_WORLD), []).cost > 1.0  # the edges of the cube do not fit
    boxes = boxes_of(states, 0)[0]
    middle = boxes[:, :2] * [240, 160] + [240, 160]
    np.testing.assert_allclose(middle, OTHER.pixels([frame["objects"][0]["location"] for frame in frames]), atol=1e-6)


def test_tracks_hold_the_camera_they_were_made_with() -> None:
    rows = as_proposals(moving(range(40), RED, 100, 3), 40)
    ours, other = track(rows), track(replace(rows, world=World(camera=OTHER)))
    assert (ours.camera, other.camera) == (CLEVRER_CAMERA, OTHER)
    assert np.abs(ours.tracks[0].location_world - other.tracks[0].location_world).max() > 0.3


def test_the_camera_is_a_setting() -> None:
    settings = pipeline_settings(overrides=["world.camera.eye_world=[3.6,1.6,3.2]", "world.camera.lens_mm=28"])
    assert settings.world.camera == Camera((3.6, 1.6, 3.2), lens_mm=28.0)
    assert fingerprint(config=settings) != fingerprint(config=PipelineConfig())
    with pytest.raises(DataError, match=r"camera: eye_world .* at least 0\.5 high"):
        pipeline_settings(overrides=["world.camera.eye_world=[1,2,0.1]"])
    wide = Pipeline.from_pretrained(config=PipelineConfig(world=World(camera=Camera(width=640))), device="cpu")
    with pytest.raises(CheckpointError, match="trained on images of 480x320; those of the world CLEVRER have 640x320"):
        wide.proposals(np.zeros((2, 320, 640, 3), np.uint8))
    view = view_of(RenderConfig(width=240, height=160), 0, World(camera=OTHER))
    assert view.camera == replace(OTHER, width=240, height=160)


@pytest.mark.parametrize("eye", [(0.0, 0.0, 3.0), (1.0, 2.0, 0.1), (1.0, np.nan, 2.0), (np.inf, 0.0, 2.0)])
def test_impossible_places_are_refused(eye: tuple[float, float, float]) -> None:
    with pytest.raises(ValueError, match="expected the camera's place"):
        Camera(eye)
    with pytest.raises(ValueError, match="expected lens_mm"):
        Camera(lens_mm=0.0)


def test_a_wrong_place_is_one_line(capsys) -> None:
    assert main(["answer", str(VIDEO), "How many spheres are moving?", "--set", "world.camera.eye_world=[1,2,0]"]) == 2
    assert "expected the camera's place" in capsys.readouterr().err
