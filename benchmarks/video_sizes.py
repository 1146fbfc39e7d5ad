"""Sizes of objects in videos relative to what is expected at their places: `python benchmarks/video_sizes.py PROPOSALS.npz`."""

import argparse
from itertools import islice
from pathlib import Path

import numpy as np

from nsdr import track
from nsdr.clevrer.files.compact_proposals import read_compact_proposals
from nsdr.tracking.localization import MAX_RATIO, TYPICAL_RATIO, size_ratio


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("proposals", type=Path)
    parser.add_argument("--limit", type=int, default=300, help="videos")
    options = parser.parse_args()
    found = [size_ratio(track(p)) for _, p in islice(read_compact_proposals(options.proposals), options.limit)]
    ratios = np.array([ratio for ratio in found if ratio is not None])
    deviation = np.exp(np.abs(np.log(ratios / TYPICAL_RATIO)).max(1))
    print(f"{len(ratios)} videos; median width and height {np.median(ratios, 0).round(3)}")
    print(f"largest deviation {deviation.max():.3f}; above {MAX_RATIO}: {(deviation > MAX_RATIO).sum()}")


if __name__ == "__main__":
    main()
