"""Time in CLEVRER's videos: frame rate, length, and the time simulated beyond the video."""

__all__ = ["FPS", "SAME_EVENT_FRAMES", "VIDEO_FRAMES", "horizon_frame"]

FPS = 25
"""Frame rate of the released videos (frames per second of video time)."""
VIDEO_FRAMES = 128
"""Number of frames of a released video, except three irregular ones (`nsdr.clevrer.files.annotations.IRREGULAR_VIDEOS`)."""
SAME_EVENT_FRAMES = 3
"""Events of one kind and one pair that are at most so many frames apart are taken as the same event."""
_SIMULATED_PER_SHOWN = 7 / 5
"""Simulated frames per shown frame: CLEVRER simulates 7 s of video time and shows the first 5 (paper, section 3.1)."""


def horizon_frame(n_frames: int) -> int:
    """Number of frames that CLEVRER simulates for a video of `n_frames`: 179 for 128.

    It is the last frame to predict, too, which agrees best with CLEVRER's own answers.
    """
    return round(n_frames * _SIMULATED_PER_SHOWN)
