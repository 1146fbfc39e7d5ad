"""Writing pictures as an H.264 video."""

from collections.abc import Iterable
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nsdr.errors import DataError
from nsdr.files import atomic_path

__all__ = ["write_video"]


def write_video(path: str | Path, frames: Iterable[NDArray[np.uint8]], fps: int = 25, crf: int = 20) -> None:
    """Write frames (H, W, 3) uint8 RGB as an H.264 mp4, atomically.

    Raises:
        DataError: PyAV is missing, or there are no frames.
    """
    try:
        import av
    except ImportError as e:
        raise DataError("writing videos needs PyAV: pip install 'nsdr[visualize]'") from e
    with atomic_path(path) as temporary:
        container = av.open(str(temporary), "w", format="mp4")
        with container:
            stream: Any = None
            for frame in frames:
                if stream is None:
                    stream = container.add_stream("libx264", rate=Fraction(fps))
                    stream.height, stream.width, stream.pix_fmt = *frame.shape[:2], "yuv420p"
                    stream.options = {"crf": str(crf), "preset": "slow"}
                container.mux(stream.encode(av.VideoFrame.from_ndarray(frame, format="rgb24")))
            if stream is None:
                raise DataError(f"{path}: no frames to write")
            container.mux(stream.encode())
