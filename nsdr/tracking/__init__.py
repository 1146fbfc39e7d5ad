"""From proposals of single frames to tracks: linking, positions on the ground plane, and which sides of a box are hidden."""

from typing import TYPE_CHECKING

from nsdr.io.lazy import lazy_exports

if TYPE_CHECKING:
    from nsdr.tracking.localization import ground_location, outline
    from nsdr.tracking.tracker import TrackerConfig, track
    from nsdr.tracking.truth_tracks import tracks_from_annotation, tracks_from_motion
    from nsdr.tracking.visibility import VisibilityConfig, cut_sides, hidden_sides, in_image

_HOME = {
    "nsdr.tracking.localization": ["ground_location", "outline"],
    "nsdr.tracking.tracker": ["TrackerConfig", "track"],
    "nsdr.tracking.truth_tracks": ["tracks_from_annotation", "tracks_from_motion"],
    "nsdr.tracking.visibility": ["VisibilityConfig", "cut_sides", "hidden_sides", "in_image"],
}

__all__ = [
    "TrackerConfig",
    "VisibilityConfig",
    "cut_sides",
    "ground_location",
    "hidden_sides",
    "in_image",
    "outline",
    "track",
    "tracks_from_annotation",
    "tracks_from_motion",
]

__getattr__, __dir__ = lazy_exports(__name__, _HOME, __all__)
