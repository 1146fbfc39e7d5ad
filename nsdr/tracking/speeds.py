"""Whether objects move as fast as they should, by the frame rate that a video says."""

import numpy as np

from nsdr.types import Track, VideoTracks

FIRST_FRAMES, BORDER_FRAMES = 4, 2
"""A first speed is measured between detections `FIRST_FRAMES` apart, skipping the first `BORDER_FRAMES`: at the border, places
are off."""
DOUBTFUL_SPEED, UNFIT_SPEED = 0.125, 0.22
"""A first speed above the first value is noted, one above the second is refused (world units per frame of CLEVRER's; in
other worlds times `Scales.frame`). Of the 8,664 scenes of `train`, an object seems faster than `DOUBTFUL_SPEED` in 6 scenes,
than `UNFIT_SPEED` in none. With every second frame left out, one seems faster than `DOUBTFUL_SPEED` in 92 % of 1,444 scenes."""


def speed_notes(tracks: VideoTracks) -> tuple[str, ...]:
    """A note if an object starts too fast for the frame rate: frames are missing, or the rate is wrong."""
    fastest, world = fastest_start(tracks), tracks.world
    if fastest <= DOUBTFUL_SPEED * world.scales.frame:
        return ()
    times = fastest / (world.physics.start_speed_world_per_s[1] * world.physics.frame_seconds)
    return (
        f"objects move by {fastest:.2f} world units from frame to frame, {times:.1f} times as far as {world.name}'s fastest: "
        "frames are missing, or the frame rate is wrong, and collisions are missed; --fps gives the right one (in Python, "
        "VideoConfig.fps)",
    )


def fastest_start(tracks: VideoTracks) -> float:
    """How far the fastest object moves from frame to frame when it is first seen (world units)."""
    return max((_first_speed(t) for t in tracks.tracks), default=0.0)


def _first_speed(t: Track) -> float:
    """How far an object moves from frame to frame when it is first seen (world units)."""
    span = min(FIRST_FRAMES, len(t.frame_index) - 1)
    if not span:
        return 0.0
    moved = np.linalg.norm(t.location_world[span:] - t.location_world[:-span], axis=1)
    speeds = moved / (t.frame_index[span:] - t.frame_index[:-span])
    # At the border, places are off at first.
    return float(np.median(speeds[BORDER_FRAMES:][: FIRST_FRAMES + 1] if len(speeds) > 2 * BORDER_FRAMES else speeds))
