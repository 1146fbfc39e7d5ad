"""What a text says about a video, and whether it is true: narrated answers and claims. Runs without PyTorch."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
