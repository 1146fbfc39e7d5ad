"""From proposals of single frames to tracks: linking, positions on the ground plane, and which sides of a box are hidden."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

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
_MODULE_OF = {name: module for module, names in _HOME.items() for name in names}

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


def __getattr__(name: str) -> Any:
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_MODULE_OF[name]), name)


def __dir__() -> list[str]:
    return __all__
