"""Videos of a world that has nothing in common with CLEVRER's: no word, size, camera, frame rate or image size."""

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from pycocotools import mask as rle

import nsdr
from nsdr import World
from nsdr.baselines.features.extraction import FeatureExtraction
from nsdr.clevrer import SceneQuestions, scene_from_annotation, scene_from_ground_truth, scene_from_truth
from nsdr.clevrer.files.annotations import check_truth, read_annotation, read_truth, read_truth_file
from nsdr.clevrer.files.compact_proposals import compact_rows, read_compact_proposals
from nsdr.clevrer.files.proposals import parse_proposals, proposals_document, proposals_from_masks, read_proposals
from nsdr.clevrer.files.questions import Question
from nsdr.cli.main import main
from nsdr.continuations.candidates import baselines, bullet_runs, perceived
from nsdr.continuations.compare import compare_videos
from nsdr.continuations.score import KERNEL_WORLD, Continuation, PossibleFutures, true_future
from nsdr.datasets import VideoDataset
from nsdr.dynamics.collisions.features import MotionArrays, network_inputs, radii
from nsdr.dynamics.collisions.network import CollisionNetwork, CollisionNetworkConfig, TrackCollisionDetector
from nsdr.dynamics.motion_states import MotionStates, object_features
from nsdr.dynamics.propnet.patch_model import PatchPropNet, PatchPropNetConfig
from nsdr.dynamics.propnet.patch_predictor import PatchPropNetPredictor
from nsdr.dynamics.propnet.state_model import PropNet, PropNetConfig
from nsdr.dynamics.propnet.state_predictor import PropNetPredictor
from nsdr.dynamics.scene import scene_from_prediction
from nsdr.errors import CheckpointError, DataError, VideoError
from nsdr.evaluation.score import score_scenes
from nsdr.frame_parser.check.video import VideoConfig, check_video
from nsdr.generate.dataset import DatasetConfig, generate_dataset
from nsdr.generate.physics.bullet import Body, BulletConfig, BulletMotion, Simulator
from nsdr.generate.physics.scene import SimulatedScene, simulate_scene
from nsdr.generate.physics.scene_config import SceneConfig
from nsdr.generate.physics.violations import break_law
from nsdr.generate.render.geometry import Solid
from nsdr.generate.render.preview import render_preview
from nsdr.generate.render.view import View
from nsdr.generate.scene_files import annotation_document, proposal_document, solids_at, truth_document
from nsdr.generate.violations import ViolationsConfig, generate_violations
from nsdr.io.checkpoint import find_checkpoint
from nsdr.io.files import find_files, write_json
from nsdr.io.reading import read_json
from nsdr.io.video import frame_rate
from nsdr.io.worlds import stored_world, world_in
from nsdr.laws.evidence import evidence_of
from nsdr.laws.judge import judge_tracks
from nsdr.question_parser.loading import load_parser
from nsdr.symbolic.quantities import Quantities
from nsdr.tracking.localization import ground_location, outline, size_notes
from nsdr.tracking.speeds import speed_notes
from nsdr.tracking.tracker import TrackerConfig, existence, track, tracks_from_annotation
from nsdr.tracking.visibility import cut_sides
from nsdr.types import (
    DynamicsPrediction,
    ObjectPhysics,
    Rollout,
    Scene,
    SceneObject,
    Track,
    VideoProposals,
    VideoTracks,
)
from nsdr.visualize.annotate import write_annotated_video
from nsdr.world.camera import Camera
from nsdr.world.layout import Layout
from nsdr.world.look import Lamp, Look
from nsdr.world.physics import Physics, Timeline
from nsdr.world.shapes import surface_points
from nsdr.world.vocabulary import Color, Material, Shape, Vocabulary
from nsdr.world.world import CLEVRER_WORLD

DISC = Shape("disc", "cylinder", (0.5, 0.5, 0.16), 0.03)
COIN = Shape("coin", "cylinder", (0.3, 0.3, 0.16), 0.03)
BRICK = Shape("brick", "box", (0.6, 0.3, 0.3), 0.03)
DISCS = World(
    "discs",
    Vocabulary(
        (Color("orange", (255, 130, 20)), Color("white", (235, 235, 235)), Color("teal", (20, 140, 130))),
        (
            Material("wood", restitution=0.5, friction=2.0),
            Material("steel", restitution=0.9, metallic=True, roughness=0.2),
        ),
        (DISC, COIN, BRICK),
    ),
    Physics(8.0, step_seconds=0.005, steps_per_frame=9, start_speed_world_per_s=(2.5, 3.0), mass_range=(0.8, 1.5)),
    Timeline(15, 60),
    Camera((4.0, 1.5, 4.0), lens_mm=30.0, width=320, height=192),
    Look((0.1, 0.2, 0.3), (Lamp("lamp", (3.0, -3.0, 5.0), 0.8, 160.0),)),
    Layout(((3, 0.5), (4, 0.5)), 3),
)


def with_shapes(*shapes: Shape) -> World:
    return replace(DISCS, vocabulary=replace(DISCS.vocabulary, shapes=shapes))


UPRIGHT = (np.pi / 2, 0.0, 0.0)


def run(bodies: list[Body], frames: int = 30, world: World = DISCS) -> BulletMotion:
    with Simulator(world=world) as simulator:
        return simulator.run(bodies, frames)


def body(shape: Shape, x: float, speed: float = 0.0, material: str = "wood", y: float = 0.0) -> Body:
    turned = UPRIGHT if shape.solid == "cylinder" else (0.0, 0.0, 0.0)
    return Body(shape.word, (x, y, shape.height_world), turned, (speed, 0.0, 0.0), material=material)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("world") / "discs"
    config = DatasetConfig(str(root), 2, 1, splits={"train": 1.0}, questions=None, world=DISCS, workers=1)
    return generate_dataset(config)


def test_files_of_a_data_set_say_their_world_and_are_read_in_it(folder) -> None:
    assert world_in(read_json(folder / "manifest.json")) == DISCS
    annotation = read_annotation(folder / "annotations/train/annotation_00000-01000/annotation_00000.json")
    truth = read_truth_file(folder / "truth/train/truth_00000.json")
    for scene in (scene_from_annotation(annotation), scene_from_truth(truth)):
        assert scene.world == DISCS
        assert scene.n_frames == 60
    assert len(truth["frames"]) == 84
    assert {o["shape"] for o in truth["objects"]} <= {"disc", "coin", "brick"}
    truth["objects"][0]["color"] = "red"
    with pytest.raises(DataError, match=r"objects\[0\].color: expected one of orange, white, teal, got red"):
        check_truth(truth)


def test_proposals_and_their_files_say_their_world(folder, tmp_path) -> None:
    path = folder / "derender_proposals/proposal_00000.json"
    found = read_proposals(path)
    assert found.world == DISCS
    assert found.n_frames == 60
    assert set(" ".join(found.words).split()) <= {*DISCS.vocabulary.attributes}
    assert found.mask(0).sum() == found.area_px[0]
    document = proposals_document(found, "video_00000.mp4")
    write_json(tmp_path / "proposal_00000.json", document)
    assert read_proposals(tmp_path / "proposal_00000.json") == found
    assert found.world.camera.matrix.shape == (3, 4)  # which the camera keeps, and no file may have
    nsdr.save(tmp_path / "found.json", found)
    assert nsdr.load(tmp_path / "found.json", VideoProposals) == found
    words = "orange", "wood", "disc"
    with pytest.raises(DataError, match=r"frame 0: mask: expected \(192, 320\), got \(320, 480\)"):
        proposals_from_masks(1, [(0, words, 1.0, np.ones((320, 480), bool))], world=DISCS)
    row = next(row for frame in document["frames"] for row in frame["objects"])
    row["color"] = "red"
    write_json(tmp_path / "other.json", document)
    with pytest.raises(DataError, match=r"objects\[0\].color: expected one of orange, white, teal, got red"):
        read_proposals(tmp_path / "other.json")


def test_compact_files_say_their_world(folder, tmp_path) -> None:
    assert main(["data", "motion", str(folder), "--split", "train", "-o", str(tmp_path), "--workers", "1"]) == 0
    for video, compact in read_compact_proposals(tmp_path / "proposals.npz"):
        found = read_proposals(folder / f"derender_proposals/proposal_{video:05d}.json")
        assert compact.world == DISCS
        assert compact.n_frames == 60
        np.testing.assert_array_equal(compact.attribute, found.attribute)
        np.testing.assert_array_equal(compact.box_xyxy_px, found.box_xyxy_px)
        np.testing.assert_allclose(compact.centroid_px, found.centroid_px, atol=0.5 / 64)
    for video, block in read_truth(tmp_path / "truth.json.gz").items():
        truth = scene_from_truth(read_truth_file(folder / f"truth/train/truth_{video:05d}.json"))
        scene = scene_from_ground_truth(block, block["n_frames"])
        assert (scene.world, scene.objects, scene.n_frames) == (DISCS, truth.objects, 60)


def test_compact_files_hold_large_images_and_vocabularies(tmp_path) -> None:
    colors = tuple(Color(f"{a}{b}", (40 * i, 40 * k, 0)) for i, a in enumerate("abcd") for k, b in enumerate("efghi"))
    sizes = [(0.2 + 0.01 * i, 0.2 + 0.01 * i, 0.16) for i in range(10)]
    shapes = tuple(replace(DISC, word=f"disc{a}", size_world=s) for a, s in zip("abcdefghij", sizes, strict=True))
    camera = replace(DISCS.camera, width=1920, height=1080)
    world = replace(DISCS, vocabulary=replace(DISCS.vocabulary, colors=colors, shapes=shapes), camera=camera)
    mask = np.zeros((1080, 1920), bool)
    mask[1000:1080, 1800:1920] = True
    found = proposals_from_masks(1, [(0, world.vocabulary.triple(399), 1.0, mask)], world=world)
    np.savez(tmp_path / "one.npz", **compact_rows(7, found))
    ((_, compact),) = read_compact_proposals(tmp_path / "one.npz")
    assert compact.world == world
    assert compact.attribute.tolist() == [399]
    assert compact.centroid_px.tolist() == [[1860.0, 1040.0]]


def test_true_masks_give_true_tracks(folder) -> None:
    """Medians of the errors of eight videos are 0.0038 world units in CLEVRER, 0.0011 in pucks, 0.0052 in blocks."""
    errors = []
    for video in (0, 1):
        found = track(read_proposals(folder / f"derender_proposals/proposal_{video:05d}.json"))
        truth = read_truth_file(folder / f"truth/train/truth_{video:05d}.json")
        names = [" ".join((o["color"], o["material"], o["shape"])) for o in truth["objects"]]
        seen = scene_from_truth(truth).visible.any(1)
        assert found.world == DISCS
        assert {t.object.name for t in found.tracks} == {
            name for name, is_seen in zip(names, seen, strict=True) if is_seen
        }
        for t in found.tracks:
            rows = [truth["frames"][f]["objects"][names.index(t.object.name)] for f in t.frame_index]
            errors += [
                np.linalg.norm(row["location"][:2] - place) for row, place in zip(rows, t.location_world, strict=True)
            ]
        assert not (*found.notes, *speed_notes(found), *size_notes(found))
        assert (existence(found) == 1).all()
    assert np.median(errors) < 0.01


@pytest.mark.parametrize("yaw", [0.0, 0.3])
def test_a_brick_that_the_border_cuts_is_as_long_as_where_it_was_whole(yaw) -> None:
    places = np.array([[0.3, 0.05 * k] for k in range(60)])
    rows, true = [], []
    for f, (x, y) in enumerate(places):
        mask = np.zeros((192, 320), np.uint8)
        cv2.fillPoly(mask, [np.round(outline(BRICK, x, y, yaw, DISCS.camera) * 16).astype(np.int32)], 1, shift=4)
        if mask.sum() > 100:
            rows.append((f, ("teal", "wood", "brick"), 1.0, mask))
            true.append((x, y))
    found = proposals_from_masks(60, rows, world=DISCS)
    cut = cut_sides(found.box_xyxy_px, DISCS.camera)
    assert 3 < cut.any(1).sum() < len(true) / 2
    (brick,) = track(found).tracks
    alone = ground_location(BRICK, found.centroid_px, found.box_xyxy_px, cut, DISCS.camera)
    errors, of_mean_outline = (
        np.linalg.norm(p - true, axis=1)[cut.any(1)].max() for p in (brick.location_world, alone)
    )
    assert errors < 0.04
    assert errors < of_mean_outline / 2


def test_tracks_of_an_annotation_are_of_its_world_and_drawn_at_its_rate(folder, tmp_path) -> None:
    annotation = nsdr.CLEVRER(folder).split("train").annotation(0)
    tracks = tracks_from_annotation(annotation)
    assert tracks.world == DISCS
    scene = scene_from_annotation(annotation)
    write_annotated_video(tmp_path / "a.mp4", np.zeros((20, 192, 320, 3), np.uint8), None, tracks, scene)
    assert frame_rate(tmp_path / "a.mp4") == DISCS.timeline.fps


def test_programs_of_a_question_file_are_in_the_words_of_its_world() -> None:
    question = Question(
        0,
        "Are there any steel coins?",
        "descriptive",
        "exist",
        answer="yes",
        program=("objects", "steel", "filter_material", "coin", "filter_shape", "exist"),
    )
    scene = Scene.of(["teal steel coin"], world=DISCS)
    report = score_scenes([(SceneQuestions(0, "v.mp4", (question,)), nsdr.Executor(scene))], None)
    assert report.results[0]["correct"]


def test_features_of_pixels_are_of_clevrers_videos(folder, tmp_path) -> None:
    with pytest.raises(DataError, match=r"world discs: other than CLEVRER's in .*timeline\.fps.*features of pixels"):
        FeatureExtraction(str(folder), str(tmp_path / "f")).resolved(None)


def test_videos_have_the_worlds_size_and_rate(folder) -> None:
    video = cv2.VideoCapture(str(folder / "videos/train/video_00000-01000/video_00000.mp4"))
    values = [video.get(key) for key in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT, cv2.CAP_PROP_FPS)]
    assert values == [320, 192, 15]
    assert video.get(cv2.CAP_PROP_FRAME_COUNT) == 60


def test_video_data_sets_know_the_world(folder) -> None:
    item = VideoDataset(folder)[0]
    assert item["video"].shape == (60, 3, 192, 320)
    words, shown = DISCS.vocabulary, item["present"].nonzero()[:, 0].tolist()
    truth = read_truth_file(folder / "truth/train/truth_00000.json")
    for i in shown:
        names = [known[int(k)] for known, k in zip(words.words.values(), item["attributes"][i], strict=True)]
        assert names == [truth["objects"][i][name] for name in ("color", "material", "shape")]
        places = DISCS.camera.pixels(item["states"][:, i, :3].numpy())
        seen = [
            np.argwhere(mask.numpy() == i + 1).mean(0)[::-1] - place
            for mask, place in zip(item["masks"], places, strict=True)
            if (mask == i + 1).sum() > 100 and 20 < place[0] < 300 and 20 < place[1] < 172
        ]
        assert np.linalg.norm(np.median(seen, 0)) < 4


def test_objects_rest_at_their_heights(folder) -> None:
    for path in sorted((folder / "truth/train").glob("truth_*.json")):
        truth = read_truth_file(path)
        height = {o["object_id"]: DISCS.vocabulary.shape(o["shape"]).height_world for o in truth["objects"]}
        found = [row["location"][2] - height[row["object_id"]] for f in truth["frames"] for row in f["objects"]]
        assert np.abs(found).max() < 0.02


def test_masks_have_the_sizes_of_the_shapes(folder) -> None:
    checked = 0
    for number in (0, 1):
        rows = read_json(folder / f"derender_proposals/proposal_{number:05d}.json")["frames"]
        frames = read_truth_file(folder / f"truth/train/truth_{number:05d}.json")
        ids = {(o["color"], o["material"], o["shape"]): o["object_id"] for o in frames["objects"]}
        for f in range(0, 60, 10):
            for row in rows[f]["objects"]:
                x, y, width, height = rle.toBbox(
                    {"size": row["mask"]["size"], "counts": row["mask"]["counts"].encode()}
                )
                state = frames["frames"][f]["objects"][ids[row["color"], row["material"], row["shape"]]]
                shape, place = DISCS.vocabulary.shape(row["shape"]), state["location"]
                outline = DISCS.camera.pixels(surface_points(shape, state["orientation"][2]) + np.array(place))
                box = [*outline.min(0), *outline.max(0)]
                if box[0] > 2 and box[1] > 2 and box[2] < 318 and box[3] < 190:
                    found = np.abs(np.array([x, y, x + width, y + height]) - box)
                    others = [o["location"] for o in frames["frames"][f]["objects"] if o is not state]
                    if min(np.linalg.norm(np.subtract(other, place)) for other in others) > 1.2:
                        assert found.max() < 2
                        checked += 1
    assert checked >= 6


@pytest.mark.parametrize(
    ("first", "second", "reach"), [(DISC, DISC, 0.5), (DISC, COIN, 0.4), (BRICK, DISC, 0.55), (COIN, BRICK, 0.45)]
)
def test_collisions_happen_where_surfaces_touch(first, second, reach) -> None:
    motion = run([body(first, -1.0, 2.8, "steel"), body(second, 0.0, material="steel")])
    frame = motion.contacts[0].frame
    gap = np.linalg.norm(motion.location_world[1, frame - 1, :2] - motion.location_world[0, frame - 1, :2])
    assert reach <= gap < reach + 2.8 * 2 * DISCS.physics.frame_seconds


def test_a_turned_box_is_met_at_its_short_side() -> None:
    turned = replace(body(BRICK, 0.0), orientation=(0.0, 0.0, np.pi / 2))
    passed = run([body(COIN, -1.0, 2.8), replace(turned, location_world=(0.0, 0.4, 0.15))])
    assert passed.contacts  # along y, the box now reaches from 0.1 to 0.7
    missed = run([body(COIN, -1.0, 2.8), body(BRICK, 0.0, y=0.4)])
    assert not missed.contacts  # from 0.25 to 0.55


def test_friction_restitution_and_gravity_are_the_worlds() -> None:
    wood, steel = run([body(DISC, 0.0, 2.0, "wood"), body(DISC, 0.0, 2.0, "steel", y=2.0)], 12).velocity[:, -1, 0]
    seconds = 11 * DISCS.physics.frame_seconds
    assert steel - wood == pytest.approx(0.03 * 8.0 * seconds, abs=0.02)  # the friction of wood is twice that of steel

    def rebound(material: str) -> float:
        motion = run([body(DISC, -1.0, 2.8, material), body(DISC, 0.0, 0.0, material)], 14)
        return float(motion.velocity[1, -1, 0] - motion.velocity[0, -1, 0])

    assert rebound("steel") > 2 * rebound("wood")
    damped = replace(DISCS, physics=replace(DISCS.physics, linear_damping=0.4))
    assert run([body(DISC, 0.0, 2.0)], 12, damped).velocity[0, -1, 0] < wood - 0.1


def test_frames_show_the_colours_of_objects_and_table() -> None:
    objects = (SceneObject(0, "orange", "wood", "disc"), SceneObject(1, "teal", "wood", "disc"))
    solids = [Solid(DISC, np.array([0.0, y, DISC.height_world]), np.eye(3)) for y in (-0.6, 0.6)]
    image = render_preview(objects, solids, View(DISCS.camera, world=DISCS)).astype(int)
    orange, teal = (
        image[row, column] for column, row in DISCS.camera.pixels([[0, y, 0.16] for y in (-0.6, 0.6)]).astype(int)
    )
    table = image[180, 20]
    assert orange[0] > orange[1] > orange[2]
    assert teal[1] > 1.5 * teal[0]
    assert table[0] < table[1] < table[2]


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"questions": None, "scene": SceneConfig(colors=("red",))}, "colors: expected some of orange, white, teal"),
        ({"questions": None, "scene": SceneConfig(held_out=("red disc",))}, "combinations such as orange wood disc"),
        ({"questions": None, "renderer": "blender"}, "render.assets|renderer blender: world discs: look"),
        ({"questions": None, "world": with_shapes(DISC, replace(COIN, word="thing"))}, "thing: means something else"),
        ({"questions": None, "world": with_shapes(DISC, replace(COIN, word="disk"))}, "disc, disk: one letter apart"),
    ],
)
def test_settings_that_do_not_fit_the_world_are_refused(settings, message) -> None:
    with pytest.raises(DataError, match=message):
        DatasetConfig("set", **{"world": DISCS, **settings})


def test_a_video_of_another_worlds_data_set_is_not_taken_for_clevrers(folder) -> None:
    (video,) = find_files(folder / "videos", "video_00000.mp4")
    with pytest.raises(
        VideoError, match=r"of the world discs, and not of CLEVRER, .*--checkpoint with weights for discs"
    ):
        check_video(video)
    check_video(video, VideoConfig("warn"))
    assert check_video(video, world=DISCS).kind == "in"


@pytest.mark.parametrize(
    ("law", "seed"),
    [(law, 44) for law in ("permanence", "identity", "continuity", "inertia", "distance", "standstill")]
    + [("reaction", 110)],
)
def test_a_broken_law_is_found(law: str, seed: int) -> None:
    def laws(scene: SimulatedScene) -> list[str]:
        tracks = tracks_from_annotation(annotation_document(scene, 0, "video.mp4", DISCS.camera), DISCS)
        return [violation.law for violation in judge_tracks(tracks).violations]

    scene = simulate_scene(seed, removals=False, world=DISCS)
    made = break_law(scene, law, "clear", seed)
    assert made is not None
    assert made[1].law == law
    assert (laws(scene), laws(made[0])) == ([], [law])


def test_objects_that_rebound_little_can_react_too_much() -> None:
    made = break_law(simulate_scene(110, removals=False, world=DISCS), "reaction", "clear", 110)
    assert made is not None
    assert made[1].amount == pytest.approx(0.5 * 0.5 + 1.26)


def test_of_one_word_nothing_can_differ() -> None:
    one_material = replace(DISCS, vocabulary=replace(DISCS.vocabulary, materials=DISCS.vocabulary.materials[:1]))
    made = break_law(simulate_scene(40, removals=False, world=one_material), "identity", "clear", 40)
    assert made is not None
    assert made[1].amount == 2  # the colour and the shape


def test_pairs_of_videos_are_generated_in_their_world(tmp_path: Path) -> None:
    config = ViolationsConfig(
        str(tmp_path / "set"), 2, 1, world=DISCS, laws=("continuity",), renderer="none", workers=1
    )
    truth = read_truth_file(find_files(generate_violations(config) / "truth", "truth_*.json")[1])
    assert truth["violation"]["amount"] == pytest.approx(0.4 * DISCS.scales.size)
    assert {o["shape"] for o in truth["objects"]} <= set(DISCS.vocabulary.words["shape"])


def test_a_data_set_of_another_world_is_not_continued(folder) -> None:
    other = replace(DISCS, physics=replace(DISCS.physics, gravity=7.0))
    config = DatasetConfig(str(folder), 2, 1, splits={"train": 1.0}, questions=None, world=other, workers=1)
    with pytest.raises(DataError, match="was made with another world"):
        generate_dataset(config)


def test_scales_compare_a_world_with_clevrers() -> None:
    assert set(CLEVRER_WORLD.scales) == {1.0}
    assert DISCS.scales == pytest.approx((0.3 / 0.4, 1.0, 5 / 4, 45 / 28, 320 / 480, 8.0 / 9.81, 15 / 25))


def test_directions_are_seen_from_the_camera() -> None:
    """The camera of this world is 20.6 degrees off the x axis."""
    angle = np.radians(DISCS.camera.azimuth_degrees + 90)
    velocity = np.tile([2 * np.cos(angle), 2 * np.sin(angle)], (1, 60, 1))
    scene = Scene.of(["teal wood brick"], world=DISCS)
    physics = ObjectPhysics(velocity, velocity_error_world_per_s=0.0)
    for camera, direction in ((DISCS.camera, "right"), (Camera((-1.6, 4.0, 4.0)), "towards the camera")):
        world = replace(DISCS, camera=replace(camera, width=320, height=192))
        asked = replace(scene, physics=physics, world=world)
        assert Quantities(asked).direction(0, 0) == direction


def test_a_scene_counts_motion_by_the_worlds_time_and_sees_objects_at_their_heights() -> None:
    location = np.zeros((2, 60, 2))
    location[0, :, 0] = 0.0021 * np.arange(60)
    location[1, :, 1] = 0.003 * np.arange(60)
    objects = SceneObject(0, "orange", "wood", "disc"), SceneObject(1, "teal", "steel", "brick")
    rollout = Rollout(location, np.ones((2, 60), bool), ())
    scene = scene_from_prediction(DynamicsPrediction(objects, 60, rollout, world=DISCS))
    assert scene.moving is not None
    assert not scene.moving[0].any()  # 0.047 world units a second, and 0.075 if frames took as long as CLEVRER's
    assert scene.moving[1].all()
    first, last = DISCS.camera.pixels([[0.0, 0.0, 0.15], [0.0, 0.003 * 59, 0.15]])
    assert scene.motion_px is not None
    assert scene.motion_px[1] == pytest.approx(last - first)


@pytest.mark.parametrize("fps", [15, 25, 60])
def test_speeds_without_a_fit_are_those_of_the_same_time_at_every_rate(fps: int) -> None:
    n, frame_seconds = 2 * fps, 0.7 / fps
    physics = Physics(step_seconds=frame_seconds / 7)
    world = World("at a rate", physics=physics, timeline=Timeline(fps, n))
    location = 0.004 * np.random.default_rng(0).normal(size=(2, n, 2))
    location[1, :, 0] += 0.15 * frame_seconds * np.arange(n)  # one object rests, the other creeps
    objects = SceneObject(0, "red", "metal", "cube"), SceneObject(1, "blue", "metal", "cube")
    rollout = Rollout(location, np.ones((2, n), bool), ())
    moving = scene_from_prediction(DynamicsPrediction(objects, n, rollout, world=world)).moving
    assert moving is not None
    assert not moving[0].any()
    assert moving[1].all()


def discs_states(world: World = DISCS) -> MotionStates:
    """A disc that slides past a resting coin and a brick."""
    location = np.zeros((3, 60, 2))
    location[0, :, 0], location[1], location[2] = np.linspace(-2, 2, 60), (0.0, 0.45), (0.0, -2.5)
    words = (("orange", "wood", "disc"), ("teal", "steel", "coin"), ("white", "wood", "brick"))
    seen, box = np.ones((3, 60), bool), np.full((3, 60, 4), 30.0)
    objects = tuple(SceneObject(i, *names) for i, names in enumerate(words))
    return MotionStates(objects, location, seen, seen, seen, box, world=world)


@pytest.mark.parametrize(
    ("part", "network"),
    [
        (TrackCollisionDetector, lambda world: CollisionNetwork(CollisionNetworkConfig(8), world)),
        (PropNetPredictor, lambda world: PropNet(PropNetConfig(8), world)),
        (PatchPropNetPredictor, lambda world: PatchPropNet(PatchPropNetConfig(8, channels=(2, 2, 2)), world)),
    ],
)
def test_networks_of_motion_say_their_world_and_refuse_others(tmp_path, part, network) -> None:
    part(network(DISCS)).save_pretrained(tmp_path)
    again = part.from_checkpoint(tmp_path)
    assert again.trained_for == DISCS
    if part is TrackCollisionDetector:
        assert [event.objects for event, _ in again.collision_candidates(discs_states())] == [(0, 1)]
    words = replace(DISCS.vocabulary, colors=(Color("pink", (255, 150, 180)), *DISCS.vocabulary.colors[:2]))
    again.check_world(replace(DISCS, vocabulary=words, look=Look()))
    heavy = replace(DISCS, physics=replace(DISCS.physics, gravity=9.0))
    with pytest.raises(
        DataError, match=r"weights are of the world discs; the world discs has other physics\.gravity: giv"
    ):
        again.check_world(heavy)
    with pytest.raises(DataError, match=r"weights are of the world CLEVRER; .*vocabulary\.materials\.word.*physics"):
        part(network(CLEVRER_WORLD)).check_world(DISCS)


def test_a_checkpoint_without_a_frame_parser_takes_all_but_videos(tmp_path: Path) -> None:
    TrackCollisionDetector(CollisionNetwork(CollisionNetworkConfig(8), DISCS)).save_pretrained(tmp_path)
    pipeline = nsdr.Pipeline.from_pretrained(tmp_path, device="cpu")
    assert pipeline.world == DISCS
    document = annotation_document(simulate_scene(44, removals=False, world=DISCS), 0, "video.mp4", DISCS.camera)
    scene = pipeline.perceive(tracks=tracks_from_annotation(document, DISCS)).scene
    assert {o.name for o in scene.objects} == {
        " ".join(o[kind] for kind in ("color", "material", "shape")) for o in document["object_property"]
    }
    frames = np.zeros((16, DISCS.camera.height, DISCS.camera.width, 3), np.uint8)
    with pytest.raises(
        CheckpointError, match=r"videos need a frame parser, and .* has none for this world: .*trained on"
    ):
        pipeline.proposals(frames)


def test_a_world_without_weights_takes_tracks_with_their_true_collisions() -> None:
    pipeline = nsdr.Pipeline.from_pretrained(config=nsdr.PipelineConfig(world=DISCS), device="cpu")
    document = annotation_document(simulate_scene(44, removals=False, world=DISCS), 0, "video.mp4", DISCS.camera)
    tracks, truth = tracks_from_annotation(document, DISCS), scene_from_annotation(document | stored_world(DISCS))
    perception = pipeline.perceive(tracks=tracks, true_scene=truth)
    assert pipeline.answer(perception.scene, "How many collisions happen?").answer == len(document["collision"])
    assert pipeline.simulate(perception, [nsdr.Remove(0)]).differences()
    with pytest.raises(CheckpointError, match=r"where no true_scene is given, and default has none .*train collisions"):
        pipeline.perceive(tracks=tracks)
    with pytest.raises(CheckpointError, match=r"videos need a frame parser, and default has none for this world"):
        pipeline.scene(np.zeros((16, DISCS.camera.height, DISCS.camera.width, 3), np.uint8))


def test_continuations_are_compared_by_the_laws_and_in_the_words_of_their_world(tmp_path: Path) -> None:
    scene, cut = simulate_scene(500002, removals=False, world=DISCS), 20
    document = truth_document(scene, 0, DISCS.camera)
    truth = true_future(document, cut, scene.n_frames)
    proposals = parse_proposals(
        json.dumps(proposal_document(scene, 0, "video.mp4", DISCS.camera)).encode(), "proposals"
    )
    assert len(truth.collisions) == 2

    def error(found: Continuation) -> float:
        asked = truth.asked & np.isfinite(found.location_world).all(-1)
        assert asked.sum() > 0.9 * truth.asked.sum()
        return float(np.linalg.norm(found.location_world - truth.location_world, axis=-1)[asked].mean())

    near, far = bullet_runs(document, truth, 0.0001, 2, BulletConfig())
    assert error(near) < 0.002
    seen = perceived(proposals, track(proposals), [], truth)
    assert error(seen) < 0.02
    assert seen.words is not None
    assert (seen.words[truth.asked] != 0).all()
    futures = PossibleFutures([near, far], truth)
    assert futures.kernel_world == pytest.approx(KERNEL_WORLD * DISCS.scales.size)

    TrackCollisionDetector(CollisionNetwork(CollisionNetworkConfig(8), DISCS)).save_pretrained(tmp_path)
    found = baselines(proposals, TrackerConfig(), tmp_path, truth, "cpu")
    assert list(found) == [
        "last frame frozen",
        "constant velocity",
        "fitted simulator",
    ]  # PropNet's weights are CLEVRER's
    assert error(found["fitted simulator"]) < error(found["constant velocity"]) < error(found["last frame frozen"])


def test_continuations_need_weights_of_their_world(folder, tmp_path) -> None:
    with pytest.raises(
        DataError, match=r"was made in the world discs, and default is for CLEVRER, which has other voc"
    ):
        compare_videos(folder, folder, tmp_path / "out")


def test_networks_of_motion_know_how_wide_and_fast_objects_are() -> None:
    states, hidden = discs_states(), np.zeros((3, 60, 4), bool)
    flags = states.detected, states.reliable, states.present, hidden
    static, radius = (of(states.objects, DISCS.vocabulary) for of in (object_features, radii))
    assert static.tolist() == [[1, 0, 0, 1, 0], [0, 1, 0, 0, 1], [0, 0, 1, 1, 0]]
    assert radius == pytest.approx([0.25, 0.15, 0.225])
    arrays = MotionArrays(states.location_world, *flags, states.box_px, np.zeros((3, 60, 2)), static, radius)
    inputs = network_inputs(arrays, np.array([[0, 1]]), DISCS.scales)
    gap = np.hypot(arrays.location_world[0, 30, 0], 0.45) - 0.4
    assert float(inputs.pairs[0, 2, 30]) == pytest.approx(gap / (0.1 * 0.75), abs=1e-4)
    step = 4 / 59
    assert float(inputs.objects[0, 0, 30]) == pytest.approx(step / (0.05 * 45 / 28), abs=1e-4)
    network = PropNet(PropNetConfig(8), DISCS)
    assert [radius * network.length_world for radius in network.radii] == pytest.approx([0.25, 0.15, 0.225])


def true_tracks(bodies: list[Body], world: World = DISCS, frames: int = 50) -> VideoTracks:
    """Tracks of bodies that Bullet moves in `DISCS`, while their middle is in the image, said to be of a world."""
    motion, tracks, camera = run(bodies, frames), [], DISCS.camera
    for i, (one, places) in enumerate(zip(bodies, motion.location_world, strict=True)):
        shape, middle = DISCS.vocabulary.shape(one.shape), camera.pixels(places)
        seen = np.flatnonzero(((middle > 0) & (middle < (camera.width, camera.height))).all(1))
        outlines = [camera.pixels(surface_points(shape, motion.orientation[i, f, 2]) + places[f]) for f in seen]
        boxes = np.array([[*outline.min(0), *outline.max(0)] for outline in outlines])
        box = np.clip(boxes.round(), 0, (camera.width, camera.height) * 2).astype(np.int64)
        words = SceneObject(i, DISCS.vocabulary.words["color"][i], one.material, one.shape)
        tracks.append(Track(words, seen, places[seen, :2], middle[seen], box, np.ones(len(seen))))
    return VideoTracks(frames, tuple(tracks), world)


@pytest.mark.parametrize("material", ["wood", "steel"])
def test_the_judge_knows_the_laws_of_a_world(material) -> None:
    def judged(world: World) -> list[str]:
        hits = [body(DISC, -1.2, 2.8, material), body(COIN, 0.0, material=material), body(BRICK, 0.0, y=-1.2)]
        return [e.law for e in evidence_of(true_tracks(hits, world))]

    assert judged(DISCS) == []
    rough = [replace(one, friction=4 * one.friction) for one in DISCS.vocabulary.materials]
    vocabulary = replace(DISCS.vocabulary, materials=tuple(rough))
    assert "friction" in judged(replace(DISCS, vocabulary=vocabulary))


def every_second(tracks: VideoTracks) -> VideoTracks:
    names = ("frame_index", "location_world", "centroid_px", "box_xyxy_px", "score")
    thinned = [replace(t, **{name: getattr(t, name)[::2] for name in names}) for t in tracks.tracks]
    return replace(tracks, tracks=tuple(thinned))


def test_how_many_frames_a_second_are_enough_to_judge_is_the_same_in_each_world() -> None:
    tracks = every_second(true_tracks([body(DISC, -1.0, 2.5), body(COIN, 1.0, y=-1.0)], frames=60))
    with pytest.raises(
        VideoError, match=r"7\.5 frames a second are too few to judge; expected 8 or .* no more than 1$"
    ):
        judge_tracks(tracks)
    fast = replace(DISCS, timeline=replace(DISCS.timeline, fps=60))
    judged = judge_tracks(replace(tracks, world=fast))
    assert not any("frames a second" in note for note in judged.notes)  # 30 are many


def test_an_object_that_hits_two_others_at_once_breaks_no_law() -> None:
    moved = [body(DISC, -1.6, 3.0, "steel"), body(DISC, 0.2, y=0.4), body(DISC, 0.35, material="steel", y=-0.3)]
    assert [c.bodies for c in run(moved, 50).contacts] == [(0, 1), (0, 2)]
    assert not judge_tracks(true_tracks(moved)).violations


def test_an_object_that_is_hit_twice_while_it_looks_like_one_jump_breaks_no_law() -> None:
    pucks = nsdr.read_world("pucks")
    document = annotation_document(simulate_scene(300013, removals=False, world=pucks), 0, "video.mp4", pucks.camera)
    assert not judge_tracks(tracks_from_annotation(document, pucks)).violations


def test_the_judge_finds_what_breaks_the_laws_of_a_world() -> None:
    lawful = true_tracks([body(DISC, -1.0, 2.5), body(COIN, 1.0, y=-1.0)])
    assert judge_tracks(lawful).violations == ()
    first, second = lawful.tracks
    place = first.location_world.copy()
    place[12:, 1] += 0.06 * np.arange(len(place) - 12)
    (found,) = judge_tracks(replace(lawful, tracks=(replace(first, location_world=place), second))).violations
    assert (found.law, found.objects) == ("inertia", (0,))
    assert abs(found.frame - first.frame_index[12]) <= 1


@pytest.mark.parametrize(("name", "noun"), [("pucks", "puck"), ("blocks", "brick")])
def test_the_shipped_question_parsers_read_the_words_of_their_world(name: str, noun: str) -> None:
    parser = load_parser("network", find_checkpoint(name), vocabulary=nsdr.read_world(name).vocabulary)
    program = str(parser.parse(f"How many {noun}s enter the scene?"))
    assert program == f"events objects {noun} filter_shape filter_in count"
    with pytest.raises(nsdr.NsdrError, match="unknown word 'cubes'"):
        parser.parse("How many cubes are there?")


@pytest.mark.parametrize("name", ["pucks", "blocks"])
def test_the_shipped_weights_see_their_world(name: str) -> None:
    """In frames of a scene of evaluation seeds that are drawn here: words, and places to within a fifth of an object."""
    pipeline = nsdr.Pipeline.from_pretrained(name, device="cpu")
    scene = simulate_scene(500000, removals=False, world=pipeline.world)
    shown = list(range(0, scene.n_frames, 25))
    view = View(pipeline.world.camera, world=pipeline.world)
    found = pipeline.frame_parser.parse([render_preview(scene.objects, solids_at(scene, f), view) for f in shown])
    camera, seen = pipeline.world.camera, 0
    for k, frame in enumerate(shown):
        rows = found.frame_index == k
        names = [found.words[i] for i in np.flatnonzero(rows)]
        for o in scene.objects:
            place = scene.motion.location_world[o.id, frame]
            column, row = camera.pixels(place)
            if 40 < column < camera.width - 40 and 40 < row < camera.height - 40:
                at = found.centroid_px[rows][names.index(o.name)]
                assert np.linalg.norm(camera.ground(at, place[2]) - place[:2]) < 0.1
                seen += 1
    assert seen >= 5
