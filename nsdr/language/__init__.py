"""CLEVRER's question grammar (texts with their programs) and paraphrases of its texts."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
