"""The paper's dynamics network on images: patches, model, rollouts and training."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from nsdr import DataError
from nsdr.clevrer.dataset import CLEVRER
from nsdr.clevrer.files.annotations import write_annotation
from nsdr.clevrer.files.questions import Question, SceneQuestions, write_questions
from nsdr.dynamics.motion_states import VideoPixels, states_from_tracks
from nsdr.dynamics.propnet.layers import PropagationNetwork
from nsdr.dynamics.propnet.patch_model import ImagePropNet, PatchPropNetConfig
from nsdr.dynamics.propnet.patch_predictor import ImagePropNetPredictor
from nsdr.dynamics.propnet.patches import object_patches
from nsdr.dynamics.registry import BackendConfig, backend_settings, load_backend, weights_folder
from nsdr.dynamics.velocity_events import VelocityEvents
from nsdr.evaluation import EvaluationConfig, run_evaluation
from nsdr.io.checkpoint import find_checkpoint, save_checkpoint
from nsdr.io.files import write_json
from nsdr.io.video import read_frames, write_video
from nsdr.pipeline import Pipeline
from nsdr.tracking.tracker import track
from nsdr.training import dynamics
from nsdr.training.loop import LoopConfig
from nsdr.training.patch_dynamics import ImagePropNetTask
from nsdr.training.track_task import DynamicsTraining
from nsdr.world.world import CLEVRER_WORLD
from tests.conftest import draw_frame
from tests.second_device import second_device
from tests.test_devices import step

SMALL = PatchPropNetConfig(hidden=16, channels=(4, 8, 8))
COLLISION_FRAME = 40
KINDS = (("red", "metal", "sphere"), ("blue", "rubber", "cube"))


def write_scene(root: Path, index: int) -> None:
    """A video of a red sphere that runs into a resting blue cube, its masks and its annotation."""
    images, proposals, motion = [], [], []
    for f in range(CLEVRER_WORLD.timeline.frames):
        moved = min(f, COLLISION_FRAME) * 0.04
        places = [(-1.9 + moved, 0.1 * index), (0.1 + 0.02 * max(f - COLLISION_FRAME, 0), 0.1 * index)]
        image, drawn = draw_frame([(*kind, x, y) for kind, (x, y) in zip(KINDS, places, strict=True)])
        images.append(image)
        objects = [{"mask": o.pop("segmentation"), **o, "score": 1.0, "frame_index": f} for o in drawn]
        proposals.append({"frame_index": f, "objects": objects})
        still = {"orientation": [0.0, 0.0, 0.0], "velocity": [0.0, 0.0, 0.0], "angular_velocity": [0.0, 0.0, 0.0]}
        rows = [
            {"object_id": i, "location": [x, y, 0.2], **still, "inside_camera_view": True}
            for i, (x, y) in enumerate(places)
        ]
        motion.append({"frame_id": f, "objects": rows})
    name = f"video_{index:05d}.mp4"
    folder = "00000-01000"
    write_video(root / "videos" / "train" / f"video_{folder}" / name, images)
    document = {"video_index": index, "video_filename": name, "frames": proposals}
    write_json(root / "derender_proposals" / f"proposal_{index:05d}.json", document)
    annotation = {
        "scene_index": index,
        "video_filename": name,
        "object_property": [
            {"object_id": i, "color": c, "material": m, "shape": s} for i, (c, m, s) in enumerate(KINDS)
        ],
        "motion_trajectory": motion,
        "collision": [{"object_ids": [0, 1], "frame_id": COLLISION_FRAME, "location": [0.0, 0.0, 0.2]}],
    }
    write_annotation(
        root / "annotations" / "train" / f"annotation_{folder}" / f"annotation_{index:05d}.json", annotation
    )


@pytest.fixture(scope="module")
def root(tmp_path_factory) -> Path:
    """A data set of two scenes; 0 is held out."""
    folder = tmp_path_factory.mktemp("images")
    for index in (0, 1):
        write_scene(folder, index)
    return folder


def scene(root: Path):
    split = CLEVRER(root).split("train")
    proposals = split.proposals(0)
    tracks = track(proposals)
    return split.video(0), proposals, tracks, states_from_tracks(tracks)


def test_patches_show_each_object_alone_at_its_place(root) -> None:
    video, proposals, tracks, states = scene(root)
    patches = object_patches(VideoPixels(read_frames(video), proposals, tracks), states, SMALL)
    assert patches.shape == (2, CLEVRER_WORLD.timeline.frames, 4, 24, 24)
    for i, o in enumerate(states.objects):
        red, _, blue, mask = patches[i, 60].astype(float)
        assert (red.sum() > blue.sum()) == (o.color == "red")
        rows, columns = np.nonzero(mask > 127)
        assert abs(rows.mean() - 11.5) < 1.5
        assert abs(columns.mean() - 11.5) < 1.5
        assert not (red + blue)[mask == 0].any()


def test_patches_need_masks_and_all_frames(root) -> None:
    video, proposals, tracks, states = scene(root)
    with pytest.raises(DataError, match="need proposals with masks"):
        object_patches(VideoPixels(read_frames(video), replace(proposals, masks=None), tracks), states, SMALL)
    frames = list(read_frames(video))[:100]
    with pytest.raises(DataError, match="has 100 frames, and the tracks have 128"):
        object_patches(VideoPixels(frames, proposals, tracks), states, SMALL)


def random_inputs(scenes: int = 2, n: int = 3) -> tuple[torch.Tensor, ...]:
    torch.manual_seed(1)
    boxes, patches = torch.rand(scenes, n, 3, 4), torch.rand(scenes, n, 3, 4, 24, 24)
    return boxes, patches, torch.rand(scenes, n, 5), torch.ones(scenes, n, dtype=torch.bool)


def test_shapes_and_objects_that_do_not_exist() -> None:
    model = ImagePropNet(SMALL, CLEVRER_WORLD).eval()
    boxes, patches, static, exists = random_inputs()
    following, drawn, logits = model(boxes, patches, static, exists)
    assert (following.shape, drawn.shape, logits.shape) == ((2, 3, 4), (2, 3, 4, 24, 24), (2, 3, 3, 3))
    torch.testing.assert_close(logits, logits.transpose(1, 2))
    assert 0 <= drawn.min() <= drawn.max() <= 1
    gone = exists.clone()
    gone[:, 2] = False
    fewer = model(boxes[:, :2], patches[:, :2], static[:, :2], exists[:, :2])
    torch.testing.assert_close(model(boxes, patches, static, gone)[0][:, :2], fewer[0])
    with pytest.raises(DataError, match="patch_cells: expected a multiple of 8"):
        ImagePropNet(replace(SMALL, patch_cells=20), CLEVRER_WORLD)


def test_the_order_of_objects_does_not_matter() -> None:
    model = ImagePropNet(SMALL, CLEVRER_WORLD).eval()
    boxes, patches, static, exists = random_inputs()
    order = torch.tensor([2, 0, 1])
    expected = model(boxes, patches, static, exists)
    found = model(boxes[:, order], patches[:, order], static[:, order], exists)
    torch.testing.assert_close(found[1], expected[1][:, order], rtol=1e-4, atol=1e-5)
    torch.testing.assert_close(found[2], expected[2][:, order][:, :, order], rtol=1e-4, atol=1e-5)


def test_relations_keep_a_state_over_the_propagation_steps() -> None:
    """The second step reads the effects of the first one; the first step reads none."""
    torch.manual_seed(0)
    network = PropagationNetwork(torch.nn.Identity(), torch.nn.Identity(), 2, 2, 8, 2, edge_state=True)
    objects, relations, exists = torch.rand(1, 2, 8), torch.rand(1, 2, 2, 8), torch.ones(1, 2, dtype=torch.bool)
    before = network(objects, relations, exists)[1]
    with torch.no_grad():
        network.effect_state.weight.zero_()
    assert not torch.allclose(before, network(objects, relations, exists)[1])
    network.steps = 1
    once = network(objects, relations, exists)[1]
    with torch.no_grad():
        network.effect_state.weight.fill_(1.0)
    torch.testing.assert_close(once, network(objects, relations, exists)[1])  # there is no state before the first step


def test_a_sender_is_seen_where_it_lies_around_the_receiver() -> None:
    """The sender is 24 px (6 cells) to the right of the receiver and 12 px (3 cells) below."""
    patches = torch.zeros(1, 2, 3, 4, 24, 24)
    patches[:, :, :, 3, 12, 12] = 1.0
    centre = torch.zeros(1, 2, 3, 2)
    centre[:, 1] = torch.tensor([24 / 240, 12 / 160])
    seen = ImagePropNet(SMALL, CLEVRER_WORLD)._around_receivers(centre, patches)[0].unflatten(2, (3, 4))
    assert seen[0, 1, 0, 3].argmax().item() == 15 * 24 + 18
    assert seen[1, 0, 0, 3].argmax().item() == 9 * 24 + 6
    torch.testing.assert_close(seen[0, 0], patches[0, 0])


def test_past_samples_of_a_pair_lie_as_they_lay_then() -> None:
    """The sender stays where it is; the receiver comes from 24 px further left. Both patches of a sample are of that sample."""
    patches = torch.zeros(1, 2, 3, 4, 24, 24)
    patches[:, :, :, 3, 12, 12] = 1.0
    centre = torch.zeros(1, 2, 3, 2)
    centre[:, 0, 0, 0] = -24 / 240
    seen = ImagePropNet(SMALL, CLEVRER_WORLD)._around_receivers(centre, patches)[0].unflatten(2, (3, 4))
    assert [seen[0, 1, k, 3].argmax().item() for k in range(3)] == [12 * 24 + 18, 12 * 24 + 12, 12 * 24 + 12]


def test_before_training_patches_and_sizes_stay() -> None:
    torch.manual_seed(0)
    model = ImagePropNet(SMALL, CLEVRER_WORLD).eval()
    boxes, patches, static, exists = random_inputs()
    following, drawn, _ = model(boxes, patches, static, exists)
    torch.testing.assert_close(drawn, patches[:, :, -1], atol=0.03, rtol=0)
    assert model(boxes, torch.zeros_like(patches), static, exists)[1].max() < 0.01
    torch.testing.assert_close(following[..., 2:], boxes[:, :, -1, 2:], atol=0.05, rtol=0)
    expected = 2 * boxes[:, :, -1, :2] - boxes[:, :, -2, :2]
    torch.testing.assert_close(following[..., :2], expected, atol=0.05, rtol=0)


def training(root: Path, run: Path, **changed) -> DynamicsTraining:
    loop = LoopConfig(batch_size=2, device="cpu")
    values = {"rollout_steps": 2, "noise_world": 0.0, "patches": SMALL, "loop": loop, **changed}
    return DynamicsTraining(run_dir=str(run), data=str(root), network="propnet_images", **values)


def test_the_network_learns_a_few_windows(root, tmp_path) -> None:
    task = ImagePropNetTask(training(root, tmp_path, rollout_steps=1))
    batch = task.collate(task.draw(2, np.random.default_rng(0), 0))
    optimizer = torch.optim.Adam(task.model.parameters(), 3e-3)
    history = []
    for _ in range(80):
        terms = task.losses(task.model, batch)
        losses = {name: term.total / term.items for name, term in terms.items()}
        optimizer.zero_grad()
        sum(losses.values()).backward()
        optimizer.step()
        history.append({name: value.item() for name, value in losses.items()})
    for name, share in (("motion", 0.3), ("image", 0.7)):  # the decoder starts from the last patch
        assert history[-1][name] < share * history[0][name], name


def test_patches_are_kept_and_mirrored_with_the_boxes(root, tmp_path, monkeypatch) -> None:
    task = ImagePropNetTask(training(root, tmp_path))
    monkeypatch.setattr("nsdr.dynamics.propnet.data.read_frames", lambda _: pytest.fail("decoded again"))
    again = ImagePropNetTask(training(root, tmp_path))
    (example,) = task.draw(1, np.random.default_rng(0), 0)
    first, second = (task.collate([example._replace(mirror=m)]) for m in (1.0, -1.0))
    torch.testing.assert_close(again.collate([example._replace(mirror=1.0)])["patches"], first["patches"])
    torch.testing.assert_close(first["patches"].flip(-1), second["patches"])
    torch.testing.assert_close(first["boxes"][..., 0], -second["boxes"][..., 0])


def test_a_rollout_goes_on_without_images_after_the_video(root) -> None:
    video, proposals, tracks, _ = scene(root)
    torch.manual_seed(0)
    predictor = ImagePropNetPredictor(ImagePropNet(SMALL, CLEVRER_WORLD))
    fed, drawn = [], []
    forward = predictor.model.forward

    def spied(boxes, patches, static, exists):
        fed.append(patches)
        result = forward(boxes, patches, static, exists)
        drawn.append(result[1])
        return result

    predictor.model.forward = spied
    pixels = VideoPixels(read_frames(video), proposals, tracks)
    prediction = predictor.explain(states_from_tracks(tracks, pixels))
    assert prediction.observed.location_world.shape == (2, 180, 2)
    assert np.isfinite(prediction.observed.location_world[:, 140]).all()
    assert len(prediction.counterfactual) == 2
    assert np.isnan(prediction.counterfactual[1].location_world[1]).all()
    assert all(p.shape[2:] == (3, 4, 24, 24) for p in fed)
    for back in (1, 2, 3):  # the last step reads what the three before it have drawn
        torch.testing.assert_close(fed[-1][:, :, -back], drawn[-1 - back])
    with pytest.raises(DataError, match="'propnet_images' reads images; give videos"):
        predictor.explain(states_from_tracks(tracks))


def test_training_writes_a_checkpoint_that_a_backend_reads(root, tmp_path) -> None:
    sizes = ["--patches.hidden", "16", "--patches.channels", "[4, 8, 8]", "--loop.batch-size", "2"]
    data = ["--network", "propnet_images", "--data", str(root), "--run-dir", str(tmp_path / "run")]
    few = ["--rollout-steps", "2", "--loop.steps", "2", "--loop.log-every", "1", "--loop.device", "cpu"]
    output = dynamics.main([*data, *sizes, *few])
    last = json.loads((tmp_path / "run" / "metrics.jsonl").read_text().splitlines()[-1])
    assert {"loss/motion", "loss/image", "loss/collision", "collision_f1", "rollout_error_10"} <= set(last)
    assert last["rollout_error_50"] > 0
    assert 0 < last["image_error_1"] < 0.2
    assert 0 < last["image_error_5_kept"] < 0.2
    settings = tmp_path / "images.yaml"
    settings.write_text(f"backend: propnet_images\nweights: {output}\n")
    backend = load_backend(str(settings))
    assert isinstance(backend, ImagePropNetPredictor)
    assert weights_folder(Path("none"), backend_settings(str(settings))) == Path(output)
    video, proposals, _, _ = scene(root)

    class Parser:
        def parse(self, frames, progress=False):
            return proposals

    for dynamics_backend in (backend, VelocityEvents(backend)):
        pipeline = Pipeline(Parser(), dynamics_backend, None)
        pipeline.frames = read_frames
        assert pipeline.perceive(video).explanation is not None
        with pytest.raises(DataError, match="reads images; give videos"):
            pipeline.perceive(proposals=proposals)


def test_an_evaluation_gives_the_videos_of_proposals_to_a_backend_on_images(root, tmp_path) -> None:
    weights = tmp_path / "weights"
    save_checkpoint(weights, "dynamics", ImagePropNet(SMALL, CLEVRER_WORLD).state_dict(), SMALL, {})
    (tmp_path / "images.yaml").write_text(f"backend: propnet_images\nweights: {weights}\n")
    program = ("objects", "cube", "filter_shape", "count")
    count = Question(0, "How many cubes are there?", "descriptive", "count", program, "1", ())
    write_questions(tmp_path / "questions.json", [SceneQuestions(0, "video_00000.mp4", (count,))])
    common = {
        "questions": str(tmp_path / "questions.json"),
        "data": str(root / "derender_proposals"),
        "source": "proposals",
        "programs": "gold",
        "cache": str(tmp_path / "scenes"),
        "workers": 1,
        "device": "cpu",
        "set": ("video.check=off",),
    }
    images, videos = str(tmp_path / "images.yaml"), str(root / "videos" / "train")
    report = run_evaluation(EvaluationConfig(**common, dynamics=images, videos=videos))
    assert [r.get("error") for r in report.results] == [None]
    assert report["descriptive"]["accuracy"] == 1.0
    without = run_evaluation(EvaluationConfig(**common, dynamics=images))
    assert "reads images; give videos" in without.results[0]["error"]
    with pytest.raises(DataError, match="videos would do nothing: dynamics 'physics' reads no images"):
        run_evaluation(EvaluationConfig(**common, videos=videos))
    with pytest.raises(DataError, match="videos goes with --source proposals"):
        EvaluationConfig(**{**common, "source": "videos"}, videos=videos)


def test_the_shipped_weights_stand_for_the_default_checkpoint(root) -> None:
    backend = load_backend("propnet_images")
    assert isinstance(backend, ImagePropNetPredictor)
    assert (backend.config.hidden, backend.config.patch_cells) == (512, 24)
    assert weights_folder(find_checkpoint(), backend_settings("propnet_images")) == find_checkpoint("propnet_images")
    video, proposals, tracks, _ = scene(root)
    prediction = backend.explain(states_from_tracks(tracks, VideoPixels(read_frames(video), proposals, tracks)))
    assert prediction.observed.location_world.shape == (2, 180, 2)


def test_settings_that_would_do_nothing_are_refused(tmp_path) -> None:
    with pytest.raises(DataError, match="proposals: does nothing with network 'propnet_images'"):
        DynamicsTraining("p.npz", "", str(tmp_path), data="d", network="propnet_images")
    with pytest.raises(DataError, match="data: does nothing with network 'propnet'"):
        DynamicsTraining("p.npz", "t.json.gz", str(tmp_path), data="d")
    with pytest.raises(DataError, match="data: expected a path, got ''"):
        DynamicsTraining(run_dir=str(tmp_path), network="propnet_images")
    with pytest.raises(DataError, match="weights would do nothing with dynamics 'physics'"):
        backend_settings(BackendConfig(weights="somewhere"))


def test_it_runs_where_its_weights_are(root, tmp_path) -> None:
    task = ImagePropNetTask(training(root, tmp_path))
    start = {name: value.clone() for name, value in task.model.state_dict().items()}
    expected = step(task, "cpu")
    task.model.load_state_dict(start)
    with second_device() as device:
        for ours, theirs in zip(step(task, device), expected, strict=True):
            assert ours == pytest.approx(theirs, rel=1e-4, abs=1e-6, nan_ok=True)
