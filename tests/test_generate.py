"""Simulation of scenes, the preview renderer, and generated data sets."""

import json
import os
import threading
import time
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from nsdr import DataError, VideoDataset
from nsdr.baselines.features.extraction import frames_of
from nsdr.clevrer.dataset import CLEVRER
from nsdr.clevrer.files.scenes import iterate_scenes, scene_from_annotation, scene_from_truth
from nsdr.cli.main import main
from nsdr.generate import dataset
from nsdr.generate.dataset import LARGEST_SEED, DatasetConfig, Files, generate_dataset
from nsdr.generate.physics.bullet import Body, BulletConfig, Contact, Simulator
from nsdr.generate.physics.scene import SimulatedScene, removals_by_effect, scene_without, simulate_scene
from nsdr.generate.physics.scene_config import SceneConfig
from nsdr.generate.render.geometry import Solid, instance_ids
from nsdr.generate.render.preview import render_preview
from nsdr.generate.render.view import RenderConfig, View, view_of
from nsdr.generate.scene_files import truth_document
from nsdr.generate.statistics import count_scenes, released_statistics
from nsdr.io.reading import read_json
from nsdr.io.video import read_video
from nsdr.symbolic import Executor
from nsdr.tracking.localization import outline
from nsdr.tracking.visibility import in_image
from nsdr.types import SceneObject
from nsdr.world.camera import CLEVRER_CAMERA, Camera
from nsdr.world.shapes import hull_vertices, rendered_rotation
from nsdr.world.world import CLEVRER_WORLD
from tests.resimulation import resimulate


def ball(x: float, y: float, vx: float = 0.0, vy: float = 0.0, mass: float = 1.0) -> Body:
    return Body("sphere", (x, y, 0.2), (0.0, 0.0, 0.0), (vx, vy, 0.0), mass=mass)


def cube(x: float, y: float, vx: float = 0.0, vy: float = 0.0) -> Body:
    return Body("cube", (x, y, 0.2), (0.0, 0.0, 0.0), (vx, vy, 0.0))


@pytest.fixture(scope="module")
def scenes() -> list[SimulatedScene]:
    return [simulate_scene(seed) for seed in range(500100, 500106)]


@pytest.mark.parametrize("shape", ["cube", "sphere", "cylinder"])
def test_hulls_have_the_size_of_the_objects(shape: str) -> None:
    points = np.array(hull_vertices(shape))
    np.testing.assert_allclose(points.max(0), 0.2, atol=5e-4)
    np.testing.assert_allclose(points.min(0), -0.2, atol=5e-4)


def test_sliding_follows_the_law_of_deceleration() -> None:
    with Simulator() as simulator:
        motion = simulator.run([ball(-2, 0, 2.8), cube(-2, 1, 2.8)], 60)
    physics = CLEVRER_WORLD.physics
    for body, friction in ((0, 0.0), (1, CLEVRER_WORLD.vocabulary.shape("cube").friction * physics.gravity)):
        speed = 2.8
        for _ in range(59 * physics.steps_per_frame):
            speed -= (physics.linear_damping * (speed + speed**2) + friction) * physics.step_seconds
        assert motion.velocity[body, -1, 0] == pytest.approx(speed, abs=0.01)


def test_a_collision_keeps_momentum_and_is_reported_once() -> None:
    with Simulator() as simulator:
        motion = simulator.run([ball(-0.8, 0, 2.0, mass=1.2), ball(0, 0.1, mass=0.8)], 30)
    (contact,) = motion.contacts
    assert contact.bodies == (0, 1)
    before, after = motion.velocity[:, contact.frame - 1], motion.velocity[:, contact.frame + 1]
    change = (after - before)[:, :2] * np.array([[1.2], [0.8]])
    np.testing.assert_allclose(change.sum(0), 0, atol=0.12)
    assert np.linalg.norm(after[1]) > 0.5


def test_a_run_can_be_stopped_at_a_contact() -> None:
    with Simulator() as simulator:
        motion = simulator.run([ball(-0.8, 0, 2.0), ball(0, 0)], 60, stop=lambda contacts: True)
        assert not motion.complete
        assert len(motion.contacts) == 1
        assert simulator.run([ball(-0.8, 0, 2.0), ball(0, 0)], 60).complete


def test_a_scene_depends_on_its_seed_only(scenes) -> None:
    again = simulate_scene(scenes[3].seed)
    assert again.objects == scenes[3].objects
    np.testing.assert_array_equal(again.motion.location_world, scenes[3].motion.location_world)
    assert again.counterfactual == scenes[3].counterfactual


def test_scenes_follow_the_papers_construction(scenes) -> None:
    for scene in scenes:
        pairs = [c.bodies for c in scene.motion.contacts]
        assert pairs[0] == (0, 1)
        assert len(set(pairs)) == len(pairs)
        assert len({o.name for o in scene.objects}) == len(scene.objects)
        assert scene.motion.location_world.shape == (len(scene.objects), 179, 3)
        assert scene_from_truth(truth_document(scene, 0, Camera())).visible.any(1).all()
        touched = {i for pair in pairs for i in pair}
        assert touched.isdisjoint(range(4, len(scene.objects)))  # bystanders
        assert set(scene.counterfactual) == set(range(len(scene.objects)))


def test_every_unseen_and_counterfactual_collision_is_found_by_programs(scenes) -> None:
    found = 0
    for simulated in scenes:
        scene = scene_from_truth(truth_document(simulated, simulated.seed, Camera()))
        executor = Executor(scene)

        def one(i: int, scene=scene) -> list[str]:
            o = scene.objects[i]
            filters = [o.color, "filter_color", o.material, "filter_material", o.shape, "filter_shape"]
            return ["objects", *filters, "unique"]

        n = len(scene.objects)
        for i in range(n):
            for j in range(i + 1, n):
                both = [*one(i), "filter_collision", *one(j), "filter_collision", "exist"]
                predicted = any(e.objects == (i, j) for e in scene.predicted or ())
                assert executor.run(["unseen_events", *both]) is predicted
                for removed in set(range(n)) - {i, j}:
                    happens = any(e.objects == (i, j) for e in scene.counterfactual[removed])
                    program = ["all_events", *one(removed), "get_counterfact", *both]
                    assert executor.run(program) is happens
                    found += happens
    assert found > 10


def test_a_scene_without_an_object_is_that_of_the_truth(scenes) -> None:
    scene = scenes[0]
    for removed in removals_by_effect(scene)[:2]:
        without = scene_without(scene, removed)
        kept = [o for o in scene.objects if o.id != removed]
        assert [(o.id, o.name) for o in without.objects] == [(i, o.name) for i, o in enumerate(kept)]
        found: dict = {}
        for c in without.motion.contacts:
            found.setdefault(tuple(kept[i].id for i in c.bodies), c.frame)
        assert found == {c.bodies: c.frame for c in scene.counterfactual[removed]}


def test_removals_that_change_what_else_happens_come_first(scenes) -> None:
    at = (0.0, 0.0, 0.0)
    contacts = tuple(Contact(f, pair, at) for f, pair in enumerate([(0, 1), (1, 2), (2, 3)]))
    without = {
        0: contacts[2:],
        1: contacts[2:],
        2: (contacts[0],),
        3: contacts[:2],
        4: (*contacts, Contact(9, (0, 3), at)),
    }
    motion = replace(scenes[0].motion, contacts=contacts)
    assert removals_by_effect(replace(scenes[0], motion=motion, counterfactual=without)) == [0, 4, 1, 2, 3]


def test_scenes_obey_the_configuration() -> None:
    config = SceneConfig(
        objects={3: 1.0}, colors=("red", "blue"), held_out=("red cube", "metal"), speed=(2.0, 2.1), n_frames=60
    )
    scene = simulate_scene(500200, config)
    assert len(scene.objects) == 3
    assert all(o.material == "rubber" and (o.color, o.shape) != ("red", "cube") for o in scene.objects)
    assert scene.motion.location_world.shape[1] == 84
    speed = np.linalg.norm(scene.motion.velocity[0, 0])
    assert 2.0 <= speed <= 2.1
    scene = simulate_scene(500201, replace(config, held_out=(), only=("red cube",)))
    assert any((o.color, o.shape) == ("red", "cube") for o in scene.objects)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"colors": ("pink",)}, "colors: expected some of gray, .*, got pink"),
        ({"objects": {1: 1.0}}, "objects: expected probabilities of 2 to 32 objects"),
        ({"colors": ("red",), "shapes": ("cube",)}, "leave 2 combinations for scenes of 6 objects"),
        ({"only": ("red",), "colors": ("blue",)}, "only: .* leave no combination that matches red"),
        ({"n_frames": 5}, r"n_frames"),
    ],
)
def test_impossible_configurations_are_rejected(values, message) -> None:
    with pytest.raises(DataError, match=message):
        DatasetConfig("set", scene=SceneConfig(**values))


def test_negative_seeds_are_rejected() -> None:
    with pytest.raises(DataError, match="seed: expected 0 or more, got -1"):
        simulate_scene(-1)  # `random` would take it for 1


def test_a_configuration_without_scenes_raises(monkeypatch) -> None:
    monkeypatch.setattr("nsdr.generate.physics.scene.RESTARTS", 2)
    with pytest.raises(DataError, match="seed 1: no scene found in 2 attempts"):
        simulate_scene(1, SceneConfig(speed=(0.1, 0.11)))
    with pytest.raises(DataError, match=r"start_speed_world_per_s 0\.03: objects slide by at most"):
        simulate_scene(1, SceneConfig(speed=(0.03, 0.03)))
    with pytest.raises(DataError, match="participants 7: expected the number of objects in the largest scenes"):
        simulate_scene(1, SceneConfig(participants=7))


def test_the_default_view_is_clevrers_camera() -> None:
    points = np.random.default_rng(0).uniform(-2, 2, (50, 3))
    np.testing.assert_allclose(Camera().pixels(points), CLEVRER_CAMERA.pixels(points), atol=1e-3)
    assert view_of(RenderConfig(), 7, CLEVRER_WORLD) == View()
    jittered = RenderConfig(camera_jitter=0.2, light_jitter=0.5)
    of_seven, again, of_eight = (view_of(jittered, seed, CLEVRER_WORLD) for seed in (7, 7, 8))
    assert of_seven == again != of_eight
    with pytest.raises(DataError, match="aspect ratio of the world's camera, 480x320, got 320x320"):
        DatasetConfig("set", render=RenderConfig(width=320, height=320))


def test_visibility_ends_where_the_outline_leaves_the_image() -> None:
    x = np.full(41, 0.0)
    y = np.linspace(1.8, 2.8, 41)
    shown = in_image("sphere", np.stack([x, y, np.full(41, 0.2)], 1), np.zeros(41))
    inside = [outline("sphere", 0.0, v)[:, 0].min() < 480 for v in y]
    np.testing.assert_array_equal(shown, inside)
    assert shown[0]
    assert not shown[-1]


@pytest.mark.parametrize("shape", ["cube", "sphere", "cylinder"])
def test_masks_are_the_outlines(shape: str) -> None:
    orientation = np.array([np.pi / 2 if shape == "cylinder" else 0.0, 0.0, 0.4])
    position = np.array([0.3, -0.5, 0.2])
    mask = instance_ids([Solid(shape, position, rendered_rotation(shape, orientation).as_matrix())], Camera()) == 0
    drawn = np.zeros((320, 480), np.uint8)
    polygon = outline(shape, position[0], position[1], 0.4)
    cv2.fillPoly(drawn, [np.round((polygon - 0.5) * 16).astype(np.int32)], 1, shift=4)
    union = (mask | (drawn > 0)).sum()
    assert (mask & (drawn > 0)).sum() / union > 0.95


def test_nearer_objects_occlude_farther_ones() -> None:
    back, front = (Solid("sphere", np.array([x, 0.0, 0.2]), np.eye(3)) for x in (-0.4, 0.0))
    alone = (instance_ids([back], Camera()) == 0).sum()
    both = instance_ids([back, front], Camera())
    assert 0 < (both == 0).sum() < alone
    assert (both == 1).sum() == (instance_ids([front], Camera()) == 0).sum()


def test_the_preview_looks_like_its_objects() -> None:
    objects = (SceneObject(0, "red", "rubber", "cube"), SceneObject(1, "cyan", "metal", "sphere"))
    solids = [Solid("cube", np.array([0.0, -0.8, 0.2]), np.eye(3)), Solid("sphere", np.array([0, 0.8, 0.2]), np.eye(3))]
    image = render_preview(objects, solids, View())
    empty = render_preview((), (), View())
    assert image.shape == empty.shape == (320, 480, 3)
    assert 115 < empty.mean() < 150  # the release's empty scene has 133
    ids = instance_ids(solids, Camera())
    red, cyan = image[ids == 0].mean(0), image[ids == 1].mean(0)
    assert red[0] > 1.5 * red[1]
    assert cyan[1] > 1.5 * cyan[0]
    assert (empty[ids < 0].astype(int) - image[ids < 0]).max() > 20  # shadows


@pytest.mark.parametrize("size", [(480, 320), (240, 160)])
def test_outlines_of_the_preview_are_smooth_and_fit_the_masks(size) -> None:
    camera = Camera(width=size[0], height=size[1])
    objects = (SceneObject(0, "red", "rubber", "cube"), SceneObject(1, "yellow", "rubber", "sphere"))
    solids = [
        Solid("cube", np.array([0.0, -0.8, 0.2]), rotation(0.5)),
        Solid("sphere", np.array([0, 0.8, 0.2]), np.eye(3)),
    ]
    image = render_preview(objects, solids, View(camera)).astype(int)
    saturation = image.max(2) - image.min(2)
    ids = instance_ids(solids, camera)
    near = cv2.dilate((ids >= 0).astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    far_inside = cv2.erode((ids >= 0).astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    assert saturation[~near].max() < 12
    assert saturation[far_inside].min() > 35
    outline = saturation[near & ~far_inside]
    assert ((outline > 15) & (outline < 35)).mean() > 0.1  # neither ground nor object


def test_the_previews_shadows_are_soft() -> None:
    solid = Solid("cube", np.array([0.0, 0.0, 0.2]), np.eye(3))
    empty = render_preview((), (), View()).astype(float)
    image = render_preview((SceneObject(0, "gray", "rubber", "cube"),), [solid], View())
    column, row = Camera().pixels(np.array([0.0, 0.28, 0.0])).astype(int)
    end = Camera().pixels(np.array([0.0, 1.4, 0.0])).astype(int)[0]
    light = (image / empty)[row, column:end].mean(1)
    assert light[0] < 0.9
    assert light[-1] > 0.98
    assert np.diff(light).max() < 0.1
    assert np.diff(light).min() > -0.03


def test_metal_mirrors_and_rubber_does_not() -> None:
    solids = [
        Solid("sphere", np.array([0.5, -0.22, 0.2]), np.eye(3)),
        Solid("sphere", np.array([0.5, 0.22, 0.2]), np.eye(3)),
    ]
    inside = instance_ids(solids, Camera()) == 1
    spread, mirrored = {}, {}
    for material in ("metal", "rubber"):
        images = [
            render_preview(
                (SceneObject(0, c, "rubber", "sphere"), SceneObject(1, "gray", material, "sphere")), solids, View()
            )
            for c in ("red", "cyan")
        ]
        spread[material] = images[0][inside].astype(float).std()
        mirrored[material] = np.abs(images[0][inside].astype(int) - images[1][inside]).max()
    assert spread["metal"] > 2 * spread["rubber"]
    assert mirrored["metal"] > 20
    assert mirrored["rubber"] < 5


def test_previews_are_reproducible_wherever_objects_are() -> None:
    shapes = ("cube", "sphere", "cylinder")
    objects = tuple(SceneObject(i, "blue", "metal", shape) for i, shape in enumerate(shapes))
    rng = np.random.default_rng(1)
    config = RenderConfig(width=240, height=160, camera_jitter=0.5, light_jitter=1.0)
    for view in (View(), view_of(config, 3, CLEVRER_WORLD)):
        for _ in range(20):
            places = rng.uniform((-9, -4, 0.2), (5, 4, 0.2), (3, 3))
            solids = [Solid(shape, p, rotation(p[0])) for shape, p in zip(shapes, places, strict=True)]
            image = render_preview(objects, solids, view)
            assert (image == render_preview(objects, solids, view)).all()


def rotation(yaw: float) -> np.ndarray:
    c, s = np.cos(yaw), np.sin(yaw)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


@pytest.fixture(scope="module")
def tiny(tmp_path_factory) -> DatasetConfig:
    scene = SceneConfig(objects={3: 1.0}, n_frames=40)
    render = RenderConfig(width=120, height=80)
    folder = str(tmp_path_factory.mktemp("set"))
    config = DatasetConfig(folder, 3, first_scene=500300, scene=scene, render=render, workers=1)
    generate_dataset(config)
    return config


def test_a_generated_data_set_verifies_clean_and_reads(tiny, capsys) -> None:
    assert main(["data", "verify", tiny.output]) == 0
    assert "complete" in capsys.readouterr().out.splitlines()[-1]
    split = CLEVRER(tiny.output).split("train")
    assert split.indices == range(0, 2)
    scene = scene_from_annotation(split.annotation(1))
    assert scene.n_frames == 40
    truth = scene_from_truth(read_json(Files(tiny.output, "train", 1).truth))
    assert truth.n_frames == 40  # the file records its video's length
    assert truth.objects == scene.objects
    assert truth.events == scene.events
    assert truth.predicted is not None
    proposals = split.proposals(1)
    assert proposals.n_frames == 40
    with pytest.warns(UserWarning, match=r"120x80 px|40 frames"):
        assert read_video(split.video(1)).shape == (40, 320, 480, 3)
    assert not (Path(tiny.output) / "annotations" / "test").exists()


def test_seeds_have_no_scene_in_common(tmp_path) -> None:
    def made(name: str, seed: int) -> list[dict]:
        scene = SceneConfig(objects={2: 1.0}, participants=2, n_frames=12)
        config = DatasetConfig(str(tmp_path / name), 3, seed, splits={"train": 1}, renderer="none", masks=False)
        root = generate_dataset(replace(config, questions=None, scene=scene, workers=1))
        return [read_json(path) for path in sorted(root.rglob("truth_*.json"))]

    first, second = made("first", 0), made("second", 1)
    assert [t["seed"] for t in first + second] == [0, 1, 2, 1_000_000, 1_000_001, 1_000_002]
    motions = [json.dumps(t["frames"]) for t in first + second]
    assert len(set(motions)) == 6


def test_seeds_leave_room_for_the_numbers_of_scenes() -> None:
    assert DatasetConfig("out", seed=LARGEST_SEED).scene_seed(0) < 2**63
    with pytest.raises(DataError, match=r"seed"):
        DatasetConfig("out", seed=LARGEST_SEED + 1)


def files_of(folder: Path) -> dict[str, bytes]:
    """Content of the files that a data set consists of, without the ledger, whose order is that of the work."""
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and not path.name.startswith(".")
    }


def test_counterfactual_videos_are_data_sets_beside_the_videos(tmp_path) -> None:
    scene, render = SceneConfig(objects={3: 1.0}, n_frames=24), RenderConfig(width=96, height=64)
    config = DatasetConfig(
        str(tmp_path / "set"), 1, 3, splits={"validation": 1}, scene=scene, render=render, questions=None,
        counterfactual_videos=2, workers=1,
    )  # fmt: skip
    before = files_of(generate_dataset(config))
    truth = read_json(Files(config.output, "validation", 10000).truth)
    names = [(o["color"], o["material"], o["shape"]) for o in truth["objects"]]
    removed = set()
    for number in (1, 2):
        files = Files(config.output, "validation", 10000, number)
        assert files.video == Path(config.output, "counterfactual", str(number), *files.video.parts[-4:])
        other = read_json(files.truth)
        kept = [i for i in range(3) if i != other["removed"]]
        assert [(o["color"], o["material"], o["shape"]) for o in other["objects"]] == [names[i] for i in kept]
        expected = [(c["object_ids"], c["frame_id"]) for c in truth["counterfactual"][str(other["removed"])]]
        assert [([kept[i] for i in c["object_ids"]], c["frame_id"]) for c in other["collisions"]] == expected
        assert read_json(files.annotation)["motion_trajectory"] == other["frames"][:24]
        assert len(frames_of(files.video)) == 24
        assert files.proposals.exists()
        removed.add(other["removed"])
    assert len(removed) == 2
    with pytest.raises(DataError, match="scene 10000 is there twice below"):
        list(iterate_scenes(config.output))

    Files(config.output, "validation", 10000).truth.unlink()
    files.video.unlink()
    generate_dataset(config)
    assert files_of(Path(config.output)) == before
    with pytest.raises(DataError, match="made with another counterfactual_videos; choose another folder"):
        generate_dataset(replace(config, counterfactual_videos=0))


@pytest.mark.robustness
@pytest.mark.filterwarnings("ignore")
def test_a_data_set_is_the_same_when_a_node_of_the_cluster_is_lost(tmp_path) -> None:
    import ray
    from ray.cluster_utils import Cluster

    scene = SceneConfig(objects={3: 1.0}, n_frames=24)
    render = RenderConfig(width=96, height=64)
    config = DatasetConfig(str(tmp_path / "alone"), 8, 3, scene=scene, render=render, workers=1)
    generate_dataset(config)
    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False})
    try:
        second = cluster.add_node(num_cpus=1)
        ray.init(address=cluster.address, log_to_driver=False, runtime_env={"env_vars": {"PYTHONPATH": os.getcwd()}})
        lost = []

        def lose_a_node() -> None:
            while len(list((tmp_path / "together").rglob("truth_*.json"))) < 2:
                time.sleep(0.05)
            cluster.remove_node(second, allow_graceful=False)
            lost.append(len(list((tmp_path / "together").rglob("truth_*.json"))))

        thread = threading.Thread(target=lose_a_node)
        thread.start()
        generate_dataset(replace(config, output=str(tmp_path / "together"), engine="ray"))
        thread.join()
    finally:
        ray.shutdown()
        cluster.shutdown()
    assert lost[0] < 8
    assert files_of(tmp_path / "together") == files_of(tmp_path / "alone")


def test_the_manifest_and_statistics_describe_the_data_set(tiny) -> None:
    manifest = read_json(Path(tiny.output) / "manifest.json")
    assert (manifest["config"]["seed"], manifest["config"]["first_scene"]) == (0, 500300)
    assert read_json(Files(tiny.output, "train", 1).truth)["seed"] == 500301
    assert manifest["splits"] == {"train": [0, 2], "validation": [10000, 10000], "test": [15000, 15001]}
    assert "pybullet" in manifest["versions"]
    assert "/" not in json.dumps(manifest["config"])
    text = (Path(tiny.output) / "statistics.md").read_text()
    assert "## Collisions in a video" in text
    assert "| release | 0.5 | 35.6 |" in text


def test_an_interrupted_generation_resumes(tiny) -> None:
    finished = Files(tiny.output, "train", 0)
    unfinished = Files(tiny.output, "train", 1)
    before = finished.video.stat().st_mtime_ns, unfinished.truth.read_bytes(), unfinished.annotation.read_bytes()
    unfinished.truth.unlink()
    unfinished.annotation.unlink()
    generate_dataset(tiny)
    assert (
        finished.video.stat().st_mtime_ns,
        unfinished.truth.read_bytes(),
        unfinished.annotation.read_bytes(),
    ) == before
    with pytest.raises(DataError, match="made with another seed; choose another folder"):
        generate_dataset(replace(tiny, seed=1))


def test_one_failing_video_does_not_stop_the_rest(tiny, tmp_path, monkeypatch) -> None:
    make = dataset._make_videos

    def failing(config, job, output):
        if job == ("train", range(1)):
            raise OSError("disk is full")
        make(config, job, output)

    monkeypatch.setattr(dataset, "_make_videos", failing)
    config = replace(tiny, output=str(tmp_path / "set"), renderer="none", masks=False)
    with pytest.raises(DataError, match=r"1 of 3 failed: video 0: OSError: disk is full"):
        generate_dataset(config)
    assert Files(config.output, "train", 1).truth.exists()


def test_blender_renders_every_frame(monkeypatch, scenes) -> None:
    class Drawing:
        def render(self, objects, solids, view, path):
            cv2.imwrite(str(path), np.full((8, 12, 3), len(solids), np.uint8))

    monkeypatch.setattr(dataset, "_blender", lambda config: Drawing())
    frames = list(dataset._blender_frames(RenderConfig(), scenes[0], View(), [0, 5, 9]))
    assert [frame.max() for frame in frames] == [len(scenes[0].objects)] * 3


def test_videos_may_show_some_frames_alone(tmp_path) -> None:
    scene, render = SceneConfig(objects={3: 1.0}, n_frames=33), RenderConfig(120, 80)

    def frames(name: str, count: int) -> np.ndarray:
        config = DatasetConfig(
            str(tmp_path / name), 1, splits={"train": 1}, scene=scene, render=replace(render, frames=count), masks=False,
            questions=None, workers=1,
        )  # fmt: skip
        generate_dataset(config)
        return np.stack(frames_of(Files(tmp_path / name, "train", 0).video)).astype(float)

    some, every = frames("some", 5), frames("every", 0)
    assert len(some) == 5
    assert np.abs(some - every[::8]).mean() < 3
    assert CLEVRER(tmp_path / "some").split("train").annotation(0) == CLEVRER(tmp_path / "every").split(
        "train"
    ).annotation(0)
    assert main(["data", "verify", str(tmp_path / "some")]) == 0
    with pytest.raises(DataError, match="its videos show 5 frames of each scene"):
        VideoDataset(tmp_path / "some", "train")


def test_the_error_for_missing_blender_names_the_package(monkeypatch) -> None:
    import sys

    from nsdr.generate.render.blender import Blender

    monkeypatch.setitem(sys.modules, "bpy", None)
    with pytest.raises(DataError, match=r"pip install 'nsdr\[render\]'.*or choose renderer: preview"):
        Blender(RenderConfig())


def test_a_missing_simulator_is_named_before_the_work(monkeypatch, tmp_path) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(DataError, match=r"^simulating needs PyBullet: pip install 'nsdr\[generate\]'$"):
        generate_dataset(DatasetConfig(str(tmp_path / "set")))
    assert not (tmp_path / "set").exists()


def test_invalid_data_set_options_are_rejected(tmp_path, capsys) -> None:
    for values, message in (
        ({"renderer": "oil"}, "renderer"),
        ({"renderer": "blender"}, r"render\.assets: renderer blender needs CLEVR's Blender files, .*clevr-dataset-gen"),
        ({"splits": {"dev": 1.0}}, "train.*splits`"),
        ({"videos": 0}, r"videos"),
        ({"seed": -1}, r"seed"),
        (
            {"counterfactual_videos": 5},
            "counterfactual_videos: expected at most 4, the fewest objects of a scene, got 5",
        ),
        ({"first_scene": 990000}, "first_scene"),
    ):
        with pytest.raises(DataError, match=message):
            DatasetConfig(str(tmp_path), **values)
    with pytest.raises(DataError, match="25000 are too many for train"):
        DatasetConfig(str(tmp_path), 50000).indices()
    assert main(["generate", "film"]) == 2
    assert "expected one of generate dataset" in capsys.readouterr().err


def test_scene_command_writes_a_truth_file(tmp_path, capsys) -> None:
    path = tmp_path / "truth.json"
    assert main(["generate", "scene", "-o", str(path), "--seed", "500400", "--scene.objects", '{"3": 1}']) == 0
    assert capsys.readouterr().out.endswith(f"{path}\n")
    assert len(scene_from_truth(read_json(path)).objects) == 3


def test_statistics_count_the_content_of_scenes(small_scene) -> None:
    counts = count_scenes([small_scene])
    assert counts["collisions"] == {"2": 1.0}
    assert counts["collision_frame"] == {"20": 0.5, "40": 0.5}
    assert counts["predicted"] == {"1": 1.0}
    assert set(released_statistics()) >= {"objects", "collisions", "enters", "exits", "collision_frame"}


def test_physics_is_configurable() -> None:
    def last_speed(config: BulletConfig) -> float:
        with Simulator(config) as simulator:
            return float(simulator.run([cube(-2, 0, 2.0)], 40).velocity[0, -1, 0])

    assert last_speed(BulletConfig(friction=0.1)) < last_speed(BulletConfig()) - 0.3


def test_resimulation_finds_masses(scenes) -> None:
    annotation = {
        "object_property": [{"shape": "sphere"}, {"shape": "sphere"}],
        "collision": [],
        "motion_trajectory": [],
    }
    bodies = [ball(-0.8, 0, 2.0, mass=1.0), ball(0, 0.05, mass=0.75)]
    with Simulator() as simulator:
        motion = simulator.run(bodies, 40)
        annotation["collision"] = [{"object_ids": [0, 1], "frame_id": motion.contacts[0].frame}]
        names = ("location", "orientation", "velocity", "angular_velocity")
        values = (motion.location_world, motion.orientation, motion.velocity, motion.angular_velocity)
        for f in range(40):
            rows = [
                {"object_id": i, **{n: v[i, f].tolist() for n, v in zip(names, values, strict=True)}} for i in range(2)
            ]
            annotation["motion_trajectory"].append({"objects": rows})
        result = resimulate(annotation, simulator, evaluations=15)
    assert result.mass[1] == pytest.approx(0.75, abs=0.04)
    assert result.extra == ()
    ((expected, found),) = result.frames.values()
    assert expected == found
    assert result.error_world[:, -1].max() < 0.05


def test_the_command_says_how_many_videos_each_split_has(tmp_path, monkeypatch, capsys) -> None:
    from nsdr.cli import generate

    monkeypatch.setattr(generate, "generate_dataset", lambda config, keep_going: tmp_path)
    for given, told in (([], "train 2, validation 1, test 1"), (["--splits", '{"validation": 1}'], "validation 4")):
        assert main(["generate", "dataset", "-o", str(tmp_path), "--videos", "4", *given]) == 0
        assert capsys.readouterr().out == f"4 videos: {told}\n{tmp_path}\n"
