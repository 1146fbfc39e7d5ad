"""Rendering of scenes with Blender or a fast preview renderer, and exact masks."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
