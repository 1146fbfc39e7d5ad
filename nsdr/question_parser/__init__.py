"""From questions and choices to programs: tokenizer, networks, constrained decoding and the grammar they are trained on."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

VERSION = 1
"""Of the programs of texts: raised when they change."""
