"""COCO's compressed run-length masks, checked in Python: pycocotools crashes on bad ones."""

import numpy as np
from numpy.typing import NDArray

from nsdr.errors import DataError
from nsdr.validation import convert, expect

__all__ = ["check_mask"]

MaskNumbers = tuple[tuple[float, float], int, tuple[int, int, int, int]]
"""Mean (column, row) of the pixel centres, number of pixels, and box (left, top, right, bottom) with exclusive end (px)."""

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


def numbers_of_runs(runs: NDArray[np.int64], height: int) -> MaskNumbers:
    """Centroid, area and box of the mask with these runs (K,); all zero for an empty mask."""
    ends = runs.cumsum()[1::2]
    lengths = runs[1::2]
    if not lengths.any():
        return (0.0, 0.0), 0, (0, 0, 0, 0)
    starts = ends - lengths
    # Position of each object pixel, column by column: its run's start, plus its place in the run.
    pixels = np.arange(lengths.sum()) + np.repeat(starts - (lengths.cumsum() - lengths), lengths)
    columns, rows = np.divmod(pixels, height)
    box = (int(columns.min()), int(rows.min()), int(columns.max()) + 1, int(rows.max()) + 1)
    return (float(columns.mean()) + PIXEL_CENTRE_PX, float(rows.mean()) + PIXEL_CENTRE_PX), len(rows), box
