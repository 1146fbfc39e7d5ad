"""From questions and choices to programs: rules, the networks, a language model, and the default, which joins them."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

VERSION = 6
"""Of the programs of texts: raised when they change."""
