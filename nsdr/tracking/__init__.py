"""From proposals of single frames to tracks: linking, positions on the ground plane, and which sides of a box are hidden."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

VERSION = 3
"""Version of the tracks of proposals. It is raised when they change."""
