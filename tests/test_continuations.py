"""Continuations of videos: what is measured, beside what, and what is refused."""

import json
import shutil
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from nsdr import DataError, Event, VideoError, track
from nsdr.clevrer.files.proposals import parse_proposals
from nsdr.cli.main import main
from nsdr.continuations.candidates import BASELINES, baselines, bullet_runs, perceived
from nsdr.continuations.compare import GENERATED, ROWS, TRUTH, compare_videos
from nsdr.continuations.score import MEASURES, Continuation, PossibleFutures, TrueFuture, add, score, true_future
from nsdr.evaluation.measures import ratio_interval
from nsdr.generate.dataset import DatasetConfig, Files, generate_dataset
from nsdr.generate.physics.bullet import BulletConfig
from nsdr.generate.physics.scene import SimulatedScene, simulate_scene
from nsdr.generate.physics.scene_config import SceneConfig
from nsdr.generate.scene_files import proposal_document, truth_document
from nsdr.io.checkpoint import find_checkpoint
from nsdr.io.video import even_frames, frame_rate, write_video
from nsdr.tracking.tracker import TrackerConfig
from nsdr.types import VideoProposals
from nsdr.world.camera import CLEVRER_CAMERA
from nsdr.world.vocabulary import CLEVRER

CUT, RUNS, SEED = 32, 6, 595009
"""The scene has collisions of known objects after the cut."""


@cache
def scene() -> SimulatedScene:
    return simulate_scene(SEED, removals=False)


@cache
def document() -> dict[str, Any]:
    return truth_document(scene(), 0, CLEVRER_CAMERA)


@cache
def truth() -> TrueFuture:
    return true_future(document(), CUT, 128)


@cache
def runs() -> list[Continuation]:
    return bullet_runs(document(), truth(), 0.01, RUNS, BulletConfig())


@cache
def futures() -> PossibleFutures:
    return PossibleFutures(runs(), truth())


@cache
def proposals() -> VideoProposals:
    content = proposal_document(scene(), 0, "video_00000.mp4", CLEVRER_CAMERA)
    return parse_proposals(json.dumps(content).encode(), "proposals")


def itself() -> Continuation:
    return Continuation(truth().location_world, truth().collisions, np.ones(truth().asked.shape, np.int8))


def values(found: Continuation, **options: Any) -> dict[str, float]:
    sums = score(found, truth(), futures(), **options)
    total = {name: np.sum(value) for name, value in sums.items()}
    return {name: float(m.above(total) / m.below(total)) for name, m in MEASURES.items() if m.below(total)}


def test_the_truth_makes_no_error_and_is_as_likely_as_a_run_from_near_it() -> None:
    found = values(itself())
    assert len(truth().collisions) >= 2
    assert found["error"] == found["missing"] == found["frames_off"] == 0
    assert found["identity"] == found["collisions"] == found["order"] == found["possible"] == 1
    assert found["log_likelihood"] > 0


def test_runs_are_on_average_as_likely_as_each_other() -> None:
    sums = add(score(run, truth(), futures(), leave_out=r) for r, run in enumerate(runs()))
    assert sum(sums["gain"]) == pytest.approx(0, abs=1e-6)
    assert sum(sums["nearest"]) < sum(sums["error"])


def test_a_lawful_other_outcome_is_far_from_the_truth_and_near_a_possible_future() -> None:
    far = max(runs(), key=lambda run: sum(score(run, truth(), futures())["error"]))
    found, wrong = values(far), values(replace(itself(), location_world=truth().location_world + 3.0))
    assert found["nearest"] == 0
    assert found["error"] > 0.1
    assert wrong["nearest"] > 1
    assert found["log_likelihood"] > wrong["log_likelihood"] + 3


def test_less_disturbed_runs_are_nearer_to_the_truth() -> None:
    near = bullet_runs(document(), truth(), 0.0001, RUNS, BulletConfig())
    errors = [np.mean([values(run)["error"] for run in of_error]) for of_error in (near, runs())]
    assert errors[0] < 0.5 * errors[1]


def test_missing_objects_and_other_words_are_counted() -> None:
    i = truth().known[0]
    location, words = truth().location_world.copy(), np.ones(truth().asked.shape, np.int8)
    location[i] = np.nan
    words[i] = -1
    share = truth().asked[i].sum() / truth().asked.sum()
    found = values(Continuation(location, (), words))
    assert found["missing"] == pytest.approx(share)
    assert found["identity"] == pytest.approx(1 - share)
    assert found["error"] == 0
    words[i] = 0
    found = values(Continuation(truth().location_world, (), words))
    assert (found["missing"], found["identity"]) == (0, pytest.approx(1 - share))


def test_events_are_matched_by_pair_order_and_frame() -> None:
    first, second = truth().collisions[:2]
    swapped = (replace(first, frame=second.frame), replace(second, frame=first.frame))
    found = values(replace(itself(), collisions=swapped))
    n = len(truth().collisions)
    assert found["collisions"] == pytest.approx(2 * 2 / (2 + n))
    assert found["frames_off"] == second.frame - first.frame
    assert found["order"] == 0


def made_up(collisions: Sequence[tuple[int, int, int]], seen: Sequence[tuple[int, int]]) -> TrueFuture:
    """Objects at rest, each in the image in the frames of `seen`, that are said to collide (i, j, frame)."""
    words = [("red", "metal", "cube"), ("blue", "metal", "cube"), ("cyan", "rubber", "sphere")]
    objects = [
        {"object_id": i, "color": c, "material": m, "shape": s, "mass": 1.0} for i, (c, m, s) in enumerate(words)
    ]
    still = {"orientation": [0.0] * 3, "velocity": [0.0] * 3, "angular_velocity": [0.0] * 3}
    frames = [
        {
            "frame_id": f,
            "objects": [
                {"object_id": i, "location": [i, 0.0, 0.2], "inside_camera_view": a <= f < b, **still}
                for i, (a, b) in enumerate(seen)
            ],
        }
        for f in range(100)
    ]
    rows = [{"object_ids": [i, j], "frame_id": f, "location": [0.0] * 3} for i, j, f in collisions]
    content = {"objects": objects, "frames": frames, "collisions": rows, "counterfactual": {}, "n_frames": 100}
    return true_future(content, CUT, 100)


def test_what_the_given_frames_do_not_show_is_not_asked() -> None:
    always, late = (0, 100), (40, 100)
    future = made_up([(0, 1, 45), (1, 2, 60), (0, 1, 70)], [always, always, late])
    assert future.asked[1].sum() == 60 - CUT
    assert future.asked[0].sum() == 70 - CUT
    assert not future.asked[2].any()
    assert [(e.objects, e.frame) for e in future.collisions] == [((0, 1), 45)]


def test_collisions_at_the_cut_do_not_count() -> None:
    always = (0, 100)
    future = made_up([(0, 1, CUT + 1), (1, 2, 60)], [always] * 3)
    assert [e.objects for e in future.collisions] == [(1, 2)]
    told = [Event("collision", CUT + 5, (0, 1)), Event("collision", 61, (1, 2)), Event("collision", 200, (0, 2))]
    assert future.counted(told) == {(1, 2): 61}


def test_objects_are_asked_for_in_the_image_only() -> None:
    future = made_up([], [(0, 50), (0, 100), (20, 100)])
    assert future.asked.sum(1).tolist() == [50 - CUT, 100 - CUT, 100 - CUT]


def seen(given: VideoProposals) -> Continuation:
    return perceived(given, track(given), [], truth())


def test_exact_masks_show_the_truth() -> None:
    found = values(seen(proposals()))
    assert found["error"] < 0.02
    assert found["missing"] < 0.02
    assert found["identity"] > 0.99


@pytest.mark.parametrize("words", [1, 3])
def test_an_object_that_changes_after_the_cut_has_not_kept_its_identity(words: int) -> None:
    given, i = proposals(), truth().known[0]
    o = scene().objects[i]
    old = CLEVRER.index(o.color, o.material, o.shape)
    color = next(c for c in CLEVRER.words["color"] if c not in {p.color for p in scene().objects})
    other = {"cube": "sphere", "sphere": "cylinder", "cylinder": "cube"}
    material = "metal" if o.material == "rubber" else "rubber"
    new = CLEVRER.index(color, *((o.material, o.shape) if words == 1 else (material, other[o.shape])))
    assert len(set(CLEVRER.triple(new)) - set(CLEVRER.triple(old))) == words
    attribute = np.where((given.frame_index >= CUT) & (given.attribute == old), new, given.attribute)
    share = truth().asked[i].sum() / truth().asked.sum()
    assert values(seen(replace(given, attribute=attribute)))["identity"] == pytest.approx(1 - share, abs=0.03)


def test_other_given_frames_are_refused() -> None:
    moved = replace(proposals(), box_xyxy_px=proposals().box_xyxy_px // 2, centroid_px=proposals().centroid_px / 2)
    with pytest.raises(
        VideoError, match=r"the first 32 frames do not show .*, so they are not those of the truth's video"
    ):
        seen(moved)


def test_baselines_see_the_given_frames_alone() -> None:
    weights, config = find_checkpoint("default"), TrackerConfig()
    found = baselines(proposals(), config, weights, truth(), "cpu")
    assert tuple(found) == BASELINES
    changed = proposals().attribute.copy()
    changed[proposals().frame_index >= CUT] = 0
    again = baselines(replace(proposals(), attribute=changed), config, weights, truth(), "cpu")
    for name, one in found.items():
        assert np.array_equal(one.location_world, again[name].location_world, equal_nan=True), name
    errors = {name: values(one)["error"] for name, one in found.items()}
    assert np.ptp(found["last frame frozen"].location_world, axis=1)[truth().known].max() == 0
    assert errors["fitted simulator"] < errors["constant velocity"]
    assert errors["PropNet"] < errors["last frame frozen"]
    with pytest.raises(DataError, match="cuda:99"):  # their networks run where they are told
        baselines(proposals(), config, weights, truth(), "cuda:99")


def test_sums_of_videos_of_different_lengths_add_up() -> None:
    assert add([{"a": [1, 2, 3], "n": 1}, {"a": [4], "n": 2}, {"a": [0, 0, 0, 5]}]) == {"a": [5, 2, 3, 5], "n": 3}


def test_the_interval_of_a_ratio_draws_whole_scenes() -> None:
    assert ratio_interval(np.array([1.0, 0.0]), np.array([1.0, 0.0])) == (1.0, 1.0)  # the second one says nothing
    low, high = ratio_interval(np.array([0.0, 2.0]), np.array([2.0, 2.0]))
    assert (low, high) == (0.0, 1.0)


@pytest.fixture(scope="module")
def root(tmp_path_factory) -> Path:
    """Two videos of 36 frames, of which 20 are to be given."""
    folder = tmp_path_factory.mktemp("continued") / "truth"
    scenes = SceneConfig(objects={3: 1.0}, n_frames=36)
    config = DatasetConfig(
        str(folder), 2, first_scene=500310, splits={"test": 1.0}, scene=scenes, questions=None, workers=1
    )
    generate_dataset(config)
    return folder


def command(root: Path, generated: Path, output: Path) -> list[str]:
    folders = ["--root", str(root), "--generated", str(generated), "-o", str(output)]
    return ["compare-videos", *folders, "--given-frames", "20", "--runs", "3", "--workers", "1"]


def test_videos_are_scored_and_the_rest_is_listed(root, tmp_path, capsys, monkeypatch) -> None:
    generated, output = tmp_path / "generated", tmp_path / "report"
    generated.mkdir()
    shutil.copy(Files(root, "test", 15000).video, generated)
    assert main(command(root, generated, output)) == 1
    printed = capsys.readouterr()
    assert f"not scored: video_15001: {generated} has no video_15001.mp4" in printed.out
    assert "1 of 2 videos failed: video_15001: " in printed.err
    report = json.loads((output / "report.json").read_text())
    assert list(report["table"]) == list(ROWS)
    assert report["table"][GENERATED] == report["table"][TRUTH]
    assert report["table"][GENERATED]["error"]["value"] < 0.05
    assert report["table"]["last frame frozen"]["error"]["value"] > 0.1
    assert len(report["curves"][GENERATED]["error"]) == 16
    assert (output / "curves.png").read_bytes().startswith(b"\x89PNG")
    page = (output / "report.html").read_text()
    assert "video_15000" in page
    assert page.count("data:image/jpeg") == 4

    # What was scored is kept; the other file is no video, then has another rate, then too few frames.
    frames = even_frames(Files(root, "test", 15001).video)
    bad = generated / "video_15001.mp4"
    monkeypatch.setattr("nsdr.continuations.compare.bullet_runs", None)
    for write, reason in (
        (lambda: bad.write_text("no video"), "is a text file; expected a video"),
        (
            lambda: write_video(bad, frames, fps=30),
            "30 frames per second; expected 25, the rate of the truth; write it",
        ),
        (lambda: write_video(bad, frames[:22]), "only 22 frames; expected at least 28"),
    ):
        write()
        assert main([*command(root, generated, output), "--keep-going"]) == 0
        assert reason in capsys.readouterr().out


def test_a_wrong_rate_in_the_header_is_overruled(root, tmp_path) -> None:
    generated, video = tmp_path / "generated", Files(root, "test", 15000).video
    generated.mkdir()
    write_video(generated / video.name, even_frames(video), fps=8)
    assert main([*command(root, generated, tmp_path / "out"), "--set", "video.fps=25", "--keep-going"]) == 0
    (scored,) = json.loads((tmp_path / "out" / "report.json").read_text())["videos"]
    assert scored["rows"][GENERATED]["error"] < 0.05


def test_without_any_score_the_command_fails(root, tmp_path, capsys) -> None:
    generated = tmp_path / "empty"
    generated.mkdir()
    assert main(command(root, generated, tmp_path / "report")) == 2
    assert "none of 2 videos could be scored, such as video_15000" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda c: c.update(render={"frames": 9}), "its videos show 9 frames of each scene"),
        (lambda c: c["scene"].update(physics={"gravity": -1}), r"manifest\.json: config\.scene\.physics: .*gravity"),
        (lambda c: c.clear(), r"manifest\.json: .*render"),
    ],
)
def test_data_sets_whose_futures_are_not_known_are_refused(change, message, root, tmp_path) -> None:
    manifest = json.loads((root / "manifest.json").read_text())
    change(manifest["config"])
    (tmp_path / "manifest.json").write_text(json.dumps(manifest))
    with pytest.raises(DataError, match=message):
        compare_videos(tmp_path, tmp_path, tmp_path / "out")


def test_folders_without_what_is_needed_are_refused(root, tmp_path) -> None:
    with pytest.raises(DataError, match=r"has no manifest\.json; expected a data set of"):
        compare_videos(tmp_path, tmp_path, tmp_path / "out")
    with pytest.raises(DataError, match="none: no such folder"):
        compare_videos(root, tmp_path / "none", tmp_path / "out")
    with pytest.raises(DataError, match="at least 2 given frames and 2 runs, got 1 and 20"):
        compare_videos(root, root, tmp_path / "out", given_frames=1)
    with pytest.raises(DataError, match=r"holds no truth_\*\.json"):
        compare_videos(root, root, tmp_path / "out", split="train")


def test_frame_rates_are_read(tmp_path) -> None:
    path = tmp_path / "video.mp4"
    write_video(path, np.zeros((3, 32, 48, 3), np.uint8), fps=12)
    assert frame_rate(path) == pytest.approx(12)


def test_continuations_of_other_shapes_are_refused() -> None:
    with pytest.raises(DataError, match=r"Continuation.*words"):
        Continuation(np.zeros((2, 5, 2)), (), np.zeros((2, 4), np.int8))
