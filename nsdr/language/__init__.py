"""One engine for rules that relate English and programs, its rule files, and the normal form of texts."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
