"""Rendering of scenes with Blender or a fast preview renderer, and exact masks."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from nsdr.generate.render.blender import Blender
    from nsdr.generate.render.preview import render_preview
    from nsdr.generate.render.raycast import Solid, instance_ids
    from nsdr.generate.render.view import RenderConfig, View, view_of

_HOME = {
    "nsdr.generate.render.blender": ["Blender"],
    "nsdr.generate.render.preview": ["render_preview"],
    "nsdr.generate.render.raycast": ["Solid", "instance_ids"],
    "nsdr.generate.render.view": ["RenderConfig", "View", "view_of"],
}
_MODULE_OF = {name: module for module, names in _HOME.items() for name in names}

__all__ = [
    "Blender",
    "RenderConfig",
    "Solid",
    "View",
    "instance_ids",
    "render_preview",
    "view_of",
]


def __getattr__(name: str) -> Any:
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'nsdr.generate.render' has no attribute {name!r}")
    return getattr(import_module(_MODULE_OF[name]), name)


def __dir__() -> list[str]:
    return __all__
