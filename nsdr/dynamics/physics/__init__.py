"""The physics backend: a planar simulator, its fit to tracks, and the search for the collisions that explain them."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

VERSION = 2
"""Of this backend's predictions: raised when they change."""
