"""Claims of texts about a video: answers are narrated in claims, and claims are checked. Runs without PyTorch."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
