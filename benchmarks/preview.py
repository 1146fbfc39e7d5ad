"""The preview renderer beside Blender: `python benchmarks/preview.py FRAMES [--frames 60] [-o PICTURE.png]`.

FRAMES is a folder of frames that Blender rendered, with their objects (`frames/` of the shared data). Prints the mean absolute
difference of colours (0-255) on the whole image, the ground and the objects, and CPU time per frame. With `-o`, writes some
frames side by side, the preview on the left.
"""

import argparse
import json
import time
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from nsdr.generate.render.geometry import Solid, instance_ids
from nsdr.generate.render.preview import render_preview
from nsdr.generate.render.view import View
from nsdr.types import SceneObject
from nsdr.world.camera import Camera

SHOWN = (161, 1150)
"""Rows of the annotations whose frames are in the picture."""
OFFSET = 3
"""First row of the annotations that is measured."""
REPEATS = 5
"""Measurements of CPU time; the fastest counts."""


def contents(row: dict[str, Any]) -> tuple[tuple[SceneObject, ...], list[Solid]]:
    objects = tuple(SceneObject(i, o["color"], o["material"], o["shape"]) for i, o in enumerate(row["objects"]))
    rotations = [Rotation.from_quat(o["quat"]).as_matrix() for o in row["objects"]]
    return objects, [
        Solid(o["shape"], np.array(o["location"]), r) for o, r in zip(row["objects"], rotations, strict=True)
    ]


def read(folder: Path, row: dict[str, Any]) -> np.ndarray:
    image = cv2.imread(str(folder / "images" / row["file_name"]), cv2.IMREAD_COLOR_RGB)
    if image is None:
        raise SystemExit(
            f"{folder / 'images' / row['file_name']}: no readable image; expected a frame rendered by Blender"
        )
    return np.asarray(image)


def differences(folder: Path, rows: list[dict[str, Any]]) -> None:
    found = []
    for row in rows:
        objects, solids = contents(row)
        difference = np.abs(render_preview(objects, solids, View()).astype(float) - read(folder, row))
        ids = instance_ids(solids, Camera())
        found.append((difference.mean(), difference[ids < 0].mean(), difference[ids >= 0].mean()))
    image, ground, on_objects = np.mean(found, 0)
    print(
        f"mean difference from Blender in {len(rows)} frames: {image:.2f}, ground {ground:.2f}, objects {on_objects:.2f}"
    )


def speed(rows: list[dict[str, Any]], width: int, height: int) -> None:
    view = View(Camera(width=width, height=height))
    frames = [contents(row) for row in rows]
    seconds = []
    for _ in range(REPEATS + 1):
        start = time.process_time()
        for objects, solids in frames:
            render_preview(objects, solids, view)
        seconds.append((time.process_time() - start) / len(frames))
    print(f"{width}x{height}: {1000 * min(seconds[1:]):.1f} ms of CPU time a frame")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="frames rendered by Blender")
    parser.add_argument("--frames", type=int, default=60, help="number of frames")
    parser.add_argument("-o", "--output", default="", help="picture to write")
    options = parser.parse_args()
    annotations = sorted(options.folder.glob("annotations_*.jsonl"))[0]
    rows = [json.loads(line) for line in annotations.read_text().splitlines()]
    measured = rows[OFFSET :: max(1, len(rows) // options.frames)][: options.frames]
    differences(options.folder, measured)
    speed(measured, 480, 320)
    speed(measured, 240, 160)
    if options.output:
        pairs = [
            np.hstack([render_preview(*contents(row), View()), read(options.folder, row)])
            for row in (rows[i] for i in SHOWN)
        ]
        cv2.imwrite(options.output, np.vstack(pairs)[..., ::-1])


if __name__ == "__main__":
    main()
