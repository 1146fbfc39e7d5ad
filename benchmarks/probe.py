"""What the maps of `nsdr extract-features` say of objects, by linear probes: their attributes, and where their centres are.

`python benchmarks/probe.py --root DATA --features FEATURES` fits, on the cells of training videos in which an object's centre
lies, one linear layer each for colour, material, shape, and the place of the centre in the cell, and one that tells such cells
from others. It prints how often each is right on videos of the validation split.
"""

import argparse
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional as F

from nsdr.baselines.features.files import FeatureCache
from nsdr.clevrer.dataset import CLEVRER, Split
from nsdr.io.video import spaced
from nsdr.world.camera import CLEVRER_CAMERA
from nsdr.world.vocabulary import ATTRIBUTES

STEPS, RATE, BATCH = 2000, 3e-3, 4096


class Cells(NamedTuple):
    """K cells: features (K, C), whether a centre lies in them (K,), words (K, 3) and place (K, 2; cells from their middle)."""

    features: Tensor
    has_centre: Tensor
    words: Tensor
    place: Tensor


def centres(annotation: Mapping[str, Any], frame: int, grid: tuple[int, int]) -> dict[tuple[int, int], tuple[Any, ...]]:
    """Words and place of the object nearest to the camera whose centre is in a cell, by the cell."""
    found: dict[tuple[int, int], tuple[Any, ...]] = {}
    words = {row["object_id"]: row for row in annotation["object_property"]}
    seen = [row for row in annotation["motion_trajectory"][frame]["objects"] if row["inside_camera_view"]]
    for row in sorted(seen, key=lambda row: -float(CLEVRER_CAMERA.depth(row["location"]))):
        u, v = CLEVRER_CAMERA.pixels(row["location"])
        x, y = u / CLEVRER_CAMERA.width * grid[1], v / CLEVRER_CAMERA.height * grid[0]
        if 0 <= x < grid[1] and 0 <= y < grid[0]:
            of = [known.index(words[row["object_id"]][name]) for name, known in ATTRIBUTES.items()]
            found[int(y), int(x)] = of, (x % 1 - 0.5, y % 1 - 0.5)
    return found


def cells_of(split: Split, features: FeatureCache, limit: int) -> Cells:
    """All cells with a centre in the first videos of a split, and as many others."""
    rng, rows = np.random.default_rng(0), []
    for index in sorted(split.entries("annotations"))[:limit]:
        maps, annotation = features.get(index, {"maps"})["maps"], split.annotation(index)
        for number, frame in enumerate(spaced(len(annotation["motion_trajectory"]), len(maps))):
            found = centres(annotation, int(frame), features.grid)
            empty = [divmod(int(k), features.grid[1]) for k in rng.permutation(maps[0, 0].size)[: 2 * len(found)]]
            for y, x in [*found, *(cell for cell in empty if cell not in found)]:
                words, place = found.get((y, x), ([0, 0, 0], (0.0, 0.0)))
                rows.append((maps[number, :, y, x], (y, x) in found, words, place))
    columns = [torch.from_numpy(np.array(column)) for column in zip(*rows, strict=True)]
    return Cells(columns[0].float(), columns[1], columns[2], columns[3].float())


def probe(train: Cells, size: int, loss: Any, target: Tensor) -> nn.Module:
    """A linear layer of the normalised features (K, C), fitted by Adam."""
    torch.manual_seed(0)
    layer = nn.Sequential(
        nn.BatchNorm1d(train.features.shape[1], affine=False), nn.Linear(train.features.shape[1], size)
    )
    optimizer = torch.optim.Adam(layer.parameters(), RATE)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, STEPS)
    for _ in range(STEPS):
        rows = torch.randint(len(target), (BATCH,))
        optimizer.zero_grad()
        loss(layer(train.features[rows]), target[rows]).backward()
        optimizer.step()
        schedule.step()
    return layer.eval()


@torch.no_grad()
def report(name: str, right: Tensor) -> None:
    """One line: the share that is right, and of how many."""
    print(f"{name}: {100 * right.float().mean():.2f} % of {len(right)}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--root", required=True)
    parser.add_argument("--features", required=True)
    parser.add_argument("--videos", type=int, default=300, help="training videos")
    parser.add_argument("--evaluation_videos", type=int, default=100)
    options = parser.parse_args()
    dataset, features = CLEVRER(options.root), FeatureCache(options.features, {"maps"})
    train = cells_of(dataset.split("train"), features, options.videos)
    test = cells_of(dataset.split("validation"), features, options.evaluation_videos)
    said = probe(train, 2, F.cross_entropy, train.has_centre.long())(test.features).argmax(1)
    report("has a centre", said == test.has_centre)
    here, there = (Cells(*(column[cells.has_centre] for column in cells)) for cells in (train, test))
    for k, (name, known) in enumerate(ATTRIBUTES.items()):
        said = probe(here, len(known), F.cross_entropy, here.words[:, k])(there.features).argmax(1)
        report(name, said == there.words[:, k])
    off = (probe(here, 2, F.smooth_l1_loss, here.place)(there.features) - there.place).abs()
    report("place within half a cell", (off < 0.5).all(1))
    print(f"place: mean error {off.mean():.3f} cells")


if __name__ == "__main__":
    main()
