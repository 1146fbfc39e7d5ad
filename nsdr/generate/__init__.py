"""Generation of data sets in CLEVRER's layout: simulated scenes, rendered videos, and questions with answers."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

VERSION = 3
"""Of all files of a generated data set: raised when they change."""
