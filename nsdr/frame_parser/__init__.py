"""From frames to proposals: the Mask R-CNN with attribute heads, its data set, its metrics and its use on videos."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

VERSION = 1
"""Version of the proposals of a video. It is raised when they change."""
