"""Speed of the generator, and its preview renderer beside Blender.

`python -m benchmarks.generate [--scenes 40] [--frames FOLDER] [-o PICTURE.png]`

Measures seconds of CPU time per scene on one core (with the construction and the simulation without each object) and per frame
of the preview renderer. FOLDER has frames that Blender rendered, with their objects (`images/`, `annotations_*.jsonl`): prints
the mean absolute difference of colours (0-255) on the whole image, the ground and the objects; `-o` draws some frames side by
side, the preview on the left.
"""

import json
import time
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.shared import fastest, parser_of
from nsdr.generate.physics.scene import simulate_scene
from nsdr.generate.render.geometry import Solid, instance_ids
from nsdr.generate.render.preview import render_preview
from nsdr.generate.render.view import View
from nsdr.generate.scene_files import solids_at
from nsdr.types import SceneObject
from nsdr.world.camera import Camera

FIRST_SEED = 510_000
"""Seed of the first scene."""
TIMED_FRAMES = 32
"""Frames of a round of the preview renderer."""
COMPARED_FRAMES = 60
SHOWN = (161, 1150)
"""Rows of the annotations whose frames are in the picture."""
OFFSET = 3
"""First row of the annotations that is measured."""


def measure_speed(n_scenes: int) -> None:
    start = time.process_time()
    scenes = [simulate_scene(seed) for seed in range(FIRST_SEED, FIRST_SEED + n_scenes)]
    print(f"{(time.process_time() - start) / len(scenes):.2f} s per scene, with all removals")
    solids = [solids_at(scenes[0], f) for f in range(0, scenes[0].n_frames, scenes[0].n_frames // TIMED_FRAMES)]

    def render(width: int, height: int) -> None:
        for one in solids:
            render_preview(scenes[0].objects, one, View(Camera(width=width, height=height)))

    sizes = ((480, 320), (240, 160))
    for name, (cpu, _) in fastest({f"{w}x{h}": partial(render, w, h) for w, h in sizes}, 5).items():
        print(f"preview {name}: {1000 * cpu / len(solids):.1f} ms of CPU time a frame")


def contents(row: dict[str, Any]) -> tuple[tuple[SceneObject, ...], list[Solid]]:
    """Objects of a row of the annotations, and where they are."""
    objects = tuple(SceneObject(i, o["color"], o["material"], o["shape"]) for i, o in enumerate(row["objects"]))
    rotations = [Rotation.from_quat(o["quat"]).as_matrix() for o in row["objects"]]
    places = zip(row["objects"], rotations, strict=True)
    return objects, [Solid(o["shape"], np.array(o["location"]), rotation) for o, rotation in places]


def compare(folder: Path, output: str) -> None:
    """Print the differences from Blender's frames, and draw some."""
    annotations = sorted(folder.glob("annotations_*.jsonl"))[0]
    rows = [json.loads(line) for line in annotations.read_text().splitlines()]

    def blender(row: dict[str, Any]) -> np.ndarray:
        image = cv2.imread(str(folder / "images" / row["file_name"]), cv2.IMREAD_COLOR_RGB)
        if image is None:
            raise SystemExit(f"{row['file_name']}: no readable image; expected a frame rendered by Blender")
        return np.asarray(image)

    found = []
    for row in rows[OFFSET :: max(1, len(rows) // COMPARED_FRAMES)][:COMPARED_FRAMES]:
        objects, solids = contents(row)
        difference = np.abs(render_preview(objects, solids, View()).astype(float) - blender(row))
        ids = instance_ids(solids, Camera())
        found.append((difference.mean(), difference[ids < 0].mean(), difference[ids >= 0].mean()))
    image, ground, on_objects = np.mean(found, 0)
    print(
        f"mean difference from Blender in {len(found)} frames: {image:.2f}, ground {ground:.2f}, objects {on_objects:.2f}"
    )
    if output:
        pairs = [np.hstack([render_preview(*contents(rows[i]), View()), blender(rows[i])]) for i in SHOWN]
        cv2.imwrite(output, np.vstack(pairs)[..., ::-1])


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("--scenes", type=int, default=40, help="number of scenes")
    parser.add_argument("--frames", type=Path, help="folder of frames rendered by Blender")
    parser.add_argument("-o", "--output", default="", help="picture to write")
    options = parser.parse_args()
    measure_speed(options.scenes)
    if options.frames:
        compare(options.frames, options.output)


if __name__ == "__main__":
    main()
