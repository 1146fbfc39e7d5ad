"""Rendering of scenes with Blender or a fast preview renderer, and exact masks."""

from typing import TYPE_CHECKING

from nsdr.io.lazy import lazy_exports

if TYPE_CHECKING:
    from nsdr.generate.render.blender import Blender
    from nsdr.generate.render.motion import render_motion
    from nsdr.generate.render.preview import render_preview
    from nsdr.generate.render.raycast import Solid, instance_ids
    from nsdr.generate.render.view import RenderConfig, View, view_of

_HOME = {
    "nsdr.generate.render.blender": ["Blender"],
    "nsdr.generate.render.motion": ["render_motion"],
    "nsdr.generate.render.preview": ["render_preview"],
    "nsdr.generate.render.raycast": ["Solid", "instance_ids"],
    "nsdr.generate.render.view": ["RenderConfig", "View", "view_of"],
}

__all__ = [
    "Blender",
    "RenderConfig",
    "Solid",
    "View",
    "instance_ids",
    "render_motion",
    "render_preview",
    "view_of",
]

__getattr__, __dir__ = lazy_exports(__name__, _HOME, __all__)
