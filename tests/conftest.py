"""Shared fixtures. Real data lie beside the project; only tests marked `real_data` may read them."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from pycocotools import mask as rle

from nsdr import Event, Pipeline, Scene, SceneObject, load
from nsdr.clevrer.example import TRUTH, VIDEO
from nsdr.io.video import read_video, write_video
from nsdr.pipeline import Perception
from nsdr.symbolic import Executor
from nsdr.tracking.localization import outline
from nsdr.world.vocabulary import CLEVRER

SHARED = Path(__file__).resolve().parents[2] / "shared" / "data"


@pytest.fixture
def shared() -> Path:
    assert SHARED.is_dir(), f"{SHARED} is missing; run these tests only where the shared data are"
    return SHARED


@pytest.fixture(scope="session")
def example_scene() -> Scene:
    return load(TRUTH, Scene)


@pytest.fixture(scope="session")
def short_video(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The example's first frames, where three eighths of the time to see the whole clip are enough."""
    path = tmp_path_factory.mktemp("short") / "short.mp4"
    write_video(path, read_video(VIDEO)[:48], crf=10, preset="veryfast")
    return path


@pytest.fixture(scope="session")
def pipeline() -> Pipeline:
    return Pipeline.from_pretrained(device="cpu")


@pytest.fixture(scope="session")
def perception(pipeline: Pipeline) -> Perception:
    """What the pipeline finds in the example."""
    return pipeline.perceive(VIDEO)


@pytest.fixture
def small_scene() -> Scene:
    """A red cube (0) hits a blue sphere (1) at 20, which hits a green cylinder (2) at 40; 3 enters at 10, 1 exits at 60."""
    objects = (
        SceneObject(0, "red", "metal", "cube"),
        SceneObject(1, "blue", "rubber", "sphere"),
        SceneObject(2, "green", "rubber", "cylinder"),
        SceneObject(3, "red", "rubber", "sphere"),
    )
    visible = np.ones((4, 128), bool)
    visible[3, :10] = False
    visible[1, 60:] = False
    moving = np.zeros((4, 128), bool)
    moving[0, :50] = True
    moving[1, 20:60] = True
    moving[3, 10:] = True
    events = (
        Event("in", 10, (3,)),
        Event("collision", 20, (0, 1)),
        Event("collision", 40, (1, 2)),
        Event("out", 60, (1,)),
    )
    predicted = (Event("collision", 150, (2, 3)),)
    counterfactual = {
        0: (Event("collision", 150, (2, 3)),),
        1: (Event("collision", 30, (0, 2)),),
        2: (Event("collision", 20, (0, 1)),),
        3: (Event("collision", 20, (0, 1)), Event("collision", 40, (1, 2))),
    }
    return Scene(objects, 128, visible, moving, events, predicted, counterfactual)


@pytest.fixture
def executor(small_scene: Scene) -> Executor:
    return Executor(small_scene)


def draw_frame(positions: list[tuple[str, str, str, float, float]]) -> tuple[np.ndarray, list[dict[str, object]]]:
    """A flat image (320, 480, 3) RGB of (color, material, shape, x, y) objects, and their annotation."""
    image = np.full((320, 480, 3), 130, np.uint8)
    annotation = []
    for color, material, shape, x, y in sorted(positions, key=lambda p: p[3]):
        polygon = np.round(outline(shape, x, y)).astype(np.int32)
        mask = np.zeros((320, 480), np.uint8)
        cv2.fillPoly(mask, [polygon], 1)
        image[mask > 0] = {c.word: c.srgb for c in CLEVRER.colors}[color]
        counts = rle.encode(np.asfortranarray(mask))["counts"].decode()
        segmentation = {"size": [320, 480], "counts": counts}
        annotation.append({"color": color, "material": material, "shape": shape, "segmentation": segmentation})
    return image, annotation


@pytest.fixture
def tiny_frames(tmp_path: Path) -> Path:
    """A folder of six drawn frames with annotations, of two scenes (20 is for evaluation)."""
    folder = tmp_path / "frames"
    (folder / "images").mkdir(parents=True)
    lines = []
    for number in range(6):
        shift = 0.1 * number
        positions = [("red", "rubber", "cube", -1.0 + shift, -0.8), ("cyan", "metal", "sphere", 0.5, 0.6 - shift)]
        image, annotation = draw_frame(positions)
        name = f"{number}.png"
        cv2.imwrite(str(folder / "images" / name), image[..., ::-1])
        scene = 20 if number >= 4 else 21
        lines.append(json.dumps({"file_name": name, "scene": scene, "frame": number, "objects": annotation}))
    (folder / "annotations_0.jsonl").write_text("\n".join(lines) + "\n")
    return folder


@pytest.fixture
def looked_at(monkeypatch: pytest.MonkeyPatch) -> list[np.ndarray]:
    """The frames that frame parsers process from now on; nothing is detected in them."""
    import torch

    frames: list[np.ndarray] = []
    empty = {"image": (0,), "boxes": (0, 4), "masks": (0, 1, 28, 28), "scores": (0,), "attribute": (0, 48)}

    def detect(batch: list[np.ndarray]) -> dict[str, torch.Tensor]:
        frames.extend(batch)
        return {name: torch.zeros(shape) for name, shape in empty.items()}

    monkeypatch.setattr("nsdr.frame_parser.parser.Detector", lambda *_: detect)
    return frames


@pytest.fixture
def tiny_motion(tmp_path: Path) -> tuple[Path, Path]:
    """Compact proposals and truth of four made-up scenes: one object runs into a resting one at frame 40."""
    import gzip

    from nsdr.world.camera import CLEVRER_CAMERA

    rows = []
    truth = []
    for video in range(4):
        truth.append(
            {
                "video": video,
                "n_frames": 128,
                "objects": [
                    {"id": 0, "color": "red", "material": "metal", "shape": "sphere"},
                    {"id": 1, "color": "blue", "material": "rubber", "shape": "cube"},
                ],
                "in_outs": [],
                "collisions": [{"type": "collision", "object": [0, 1], "frame": 40}],
            }
        )
        for frame in range(128):
            moved = 0.04 * frame
            first = (-1.6 + moved if frame < 40 else 0.0, 0.1 * video)
            second = (0.4 + (0.02 * (frame - 40) if frame > 40 else 0.0), 0.1 * video)
            for (x, y), attribute in ((first, 7), (second, 15)):
                u, v = CLEVRER_CAMERA.pixels([x, y, 0.2])
                box = [int(u - 18), int(v - 18), int(u + 18), min(int(v + 18), 320)]
                rows.append((video, frame, attribute, 255, int(u * 64), int(v * 64), 1000, box))
    columns = list(zip(*rows, strict=True))
    names = ("video", "frame", "attr", "score", "cx64", "cy64", "area", "box")
    arrays = {name: np.array(column) for name, column in zip(names, columns, strict=True)}
    np.savez(tmp_path / "proposals.npz", **arrays)
    (tmp_path / "truth.json.gz").write_bytes(gzip.compress(json.dumps(truth).encode()))
    return tmp_path / "proposals.npz", tmp_path / "truth.json.gz"
