"""From questions and choices to programs, by rules (the default), the paper's networks, or a language model on a server."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

VERSION = 8
"""Of the programs of texts: raised when they change."""
