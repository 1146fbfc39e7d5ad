"""Everything that was found out about a video."""

from dataclasses import dataclass

from nsdr.dynamics.base import Explanation
from nsdr.errors import VideoError
from nsdr.tracking.speeds import UNFIT_SPEED, fastest_start, speed_notes
from nsdr.tracking.tracker import TrackerConfig
from nsdr.types import Scene, VideoProposals, VideoTracks
from nsdr.world.camera import Camera


@dataclass(frozen=True)
class Perception:
    """Everything that was found out about a video; stages that were given or skipped are None. Printed, it is its scene."""

    proposals: VideoProposals | None
    tracks: VideoTracks | None
    explanation: Explanation | None
    scene: Scene

    @property
    def camera(self) -> Camera:
        """The camera that took the video."""
        return self.scene.world.camera

    def __str__(self) -> str:
        return str(self.scene)


def check_tracks(tracks: VideoTracks, config: TrackerConfig, refuses_speeds: bool, name: str) -> None:
    """Refuse tracks from which no scene can be made.

    Args:
        tracks: tracks of a video.
        config: thresholds of the tracker.
        refuses_speeds: whether to refuse objects that all move too far from frame to frame for the video's frame rate.
        name: of the video, for messages.

    Raises:
        VideoError: there are no tracks, or their speeds are refused.
    """
    if not tracks.tracks:
        least, hint = config.min_frames, "is it a CLEVRER clip?"
        if tracks.n_frames <= least:
            fewer = max(tracks.n_frames - 1, 0)
            hint = f"there are only {tracks.n_frames}; --set tracker.min_frames={fewer} takes what is in all of them"
        raise VideoError(f"{name}: no objects found in more than {least} frames; {hint}")
    if refuses_speeds and fastest_start(tracks) > UNFIT_SPEED * tracks.world.scales.frame:
        raise VideoError(f"{name}: {speed_notes(tracks)[0]}. --force goes on all the same")
