"""Time in CLEVRER's videos: frame rate, length, and how far beyond the video the world was simulated."""

__all__ = ["FPS", "VIDEO_FRAMES", "horizon_frame", "simulated_frames"]

FPS = 25
"""Frames per second of video time (the release's encoding)."""
VIDEO_FRAMES = 128
"""Frames of a released video (three irregular ones aside; see `nsdr.clevrer.annotations.IRREGULAR_VIDEOS`)."""
_SIMULATED_SHARE = 7 / 5
"""CLEVRER simulates 7 s of video time and shows the first 5 (paper, section 3.1)."""


def simulated_frames(n_frames: int) -> int:
    """Number of frames that are simulated for a video of `n_frames` (128: 179)."""
    return round(n_frames * _SIMULATED_SHARE)


def horizon_frame(n_frames: int) -> int:
    """Last frame to predict for a video of `n_frames` (128: 179, which agrees best with CLEVRER's own answers)."""
    return round(n_frames * _SIMULATED_SHARE)
