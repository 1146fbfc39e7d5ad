"""COCO's compressed run-length masks, checked in Python: pycocotools crashes on bad ones."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pycocotools import mask as rle

from nsdr.errors import DataError
from nsdr.validation import FloatArray, IntArray, convert, expect

__all__ = ["check_mask"]

PIXEL_CENTRE_PX = 0.5
"""Offset from the index of a pixel to its centre (pixels)."""
FIRST_CHARACTER, BITS, MORE, SIGN = 48, 5, 0x20, 0x10
"""COCO's code: each character is 48 plus five bits of a number, lowest first, and a bit that says that more follow; the
highest bit of the last character is the sign. From the fourth on, numbers are differences to the last but one."""
MAX_CHARACTERS = 6
"""Most characters of one number; CLEVRER's have up to 4."""


def check_mask(size: object, counts: object, height: int, width: int, where: str) -> None:
    """Check a compressed run-length mask.

    Args:
        size: expected to be [height, width].
        counts: expected to be a string of runs that make up the image.
        height: of the image (px).
        width: of the image (px).
        where: location of the mask in the file, for error messages.

    Raises:
        DataError: the mask is of another size or damaged; names the location.
    """
    expect(size == [height, width], f"{where}.size", f"[{height}, {width}]", size)
    runs_of_mask(convert(counts, str, f"{where}.counts: "), height, width, where)


def runs_of_mask(counts: str, height: int, width: int, where: str) -> NDArray[np.int64]:
    """Lengths (K,) of the runs of a compressed mask, of background and object in turn, column by column.

    Raises:
        DataError: the string is no mask of that size; names `where`.
    """
    try:
        codes = np.frombuffer(counts.encode("ascii"), np.uint8).astype(np.int64) - FIRST_CHARACTER
    except UnicodeEncodeError:
        codes = np.zeros(0, np.int64)
    if not len(codes) or codes.min() < 0 or codes.max() >= 2 * MORE or codes[-1] & MORE:
        raise DataError(f"{where}.counts: expected COCO run lengths, got {counts!r:.40}")
    last = np.flatnonzero((codes & MORE) == 0)
    first = np.concatenate([[0], last[:-1] + 1])
    characters = last - first + 1
    if characters.max() > MAX_CHARACTERS:
        raise DataError(f"{where}.counts: expected runs of the image's {height}x{width} pixels, found a larger number")
    shifts = BITS * (np.arange(len(codes)) - np.repeat(first, characters))
    runs = np.add.reduceat((codes & (MORE - 1)) << shifts, first)
    runs -= ((codes[last] & SIGN) != 0) * (np.int64(1) << (BITS * characters))
    runs[1::2] = runs[1::2].cumsum()
    runs[2::2] = runs[2::2].cumsum()
    if runs.min() < 0 or runs.sum() != height * width:
        raise DataError(
            f"{where}.counts: expected runs of the image's {height}x{width} pixels, found {int(runs.sum())} pixels"
            f"{' and negative runs' if runs.min() < 0 else ''}"
        )
    return runs


class ObjectRuns(NamedTuple):
    """Runs of object pixels of N masks; a pixel's place in the image is counted column by column.

    Attributes:
        mask: (K,) int64 index of each run's mask, ascending.
        start: (K,) int64 place of each run's first pixel, ascending within a mask.
        stop: (K,) int64 place after its last pixel, larger than `start`.
    """

    mask: NDArray[np.int64]
    start: NDArray[np.int64]
    stop: NDArray[np.int64]


class MaskNumbers(NamedTuple):
    """What is known of masks of which none is empty.

    Attributes:
        centroid_px: (N, 2) float64, mean (column, row) of the pixel centres.
        area_px: (N,) int64, number of pixels.
        box_xyxy_px: (N, 4) int64, left, top, right and bottom, end exclusive.
    """

    centroid_px: FloatArray
    area_px: IntArray
    box_xyxy_px: IntArray


def object_runs(lengths: Sequence[NDArray[np.int64]]) -> ObjectRuns:
    """The runs of object pixels of masks, from the lengths (K,) of all runs of each, as `runs_of_mask` gives them."""
    stops = [of_mask.cumsum()[1::2] for of_mask in lengths]
    mask = np.repeat(np.arange(len(stops)), [len(stop) for stop in stops])
    stop = np.concatenate([np.zeros(0, np.int64), *stops])
    length = np.concatenate([np.zeros(0, np.int64), *(of_mask[1::2] for of_mask in lengths)])
    seen = length > 0
    return ObjectRuns(mask[seen], (stop - length)[seen], stop[seen])


def encoded_runs(runs: ObjectRuns, n_masks: int, height: int, width: int) -> list[str]:
    """The compressed masks of `n_masks` masks with these runs, of which adjoining ones become one."""
    joined = (runs.mask[1:] == runs.mask[:-1]) & (runs.start[1:] == runs.stop[:-1])
    first, last = np.append(True, ~joined), np.append(~joined, True)
    if not len(runs.mask):
        first = last = np.zeros(0, np.bool_)
    mask, changes = runs.mask[first], np.stack([runs.start[first], runs.stop[last]], 1).ravel()
    counts = np.split(changes, 2 * np.searchsorted(mask, np.arange(1, n_masks))) if n_masks else []
    masks = []
    for of_mask in counts:
        ends = of_mask if len(of_mask) and of_mask[-1] == height * width else np.append(of_mask, height * width)
        masks.append({"size": [height, width], "counts": np.diff(ends, prepend=0).tolist()})
    return [found["counts"].decode() for found in rle.frPyObjects(masks, height, width)] if masks else []


def numbers_of_runs(runs: ObjectRuns, height: int) -> MaskNumbers:
    """Centroids, areas and boxes of masks with these runs; each of the masks 0 to N - 1 has one at least."""
    first = np.flatnonzero(np.diff(runs.mask, prepend=-1))
    if not len(first):
        return MaskNumbers(np.zeros((0, 2)), np.zeros(0, np.int64), np.zeros((0, 4), np.int64))
    left, top = np.divmod(runs.start, height)
    right, bottom = np.divmod(runs.stop - 1, height)
    is_one_column = left == right
    corners = (left, np.where(is_one_column, top, 0)), (right + 1, np.where(is_one_column, bottom, height - 1) + 1)
    least, most = (
        [extreme.reduceat(values, first) for values in of]
        for extreme, of in zip((np.minimum, np.maximum), corners, strict=True)
    )
    area = np.add.reduceat(runs.stop - runs.start, first)
    sums = _sums_before(runs.stop, height) - _sums_before(runs.start, height)
    means = np.add.reduceat(sums, first, axis=1) / area
    return MaskNumbers(means.T + PIXEL_CENTRE_PX, area, np.stack([*least, *most], 1))


def _sums_before(place: NDArray[np.int64], height: int) -> NDArray[np.int64]:
    """Sums (2, K) of the columns and of the rows of all pixels before a place (K,) in the image."""
    column, row = np.divmod(place, height)
    columns = height * (column * (column - 1) // 2) + column * row
    rows = column * (height * (height - 1) // 2) + row * (row - 1) // 2
    return np.stack([columns, rows])
