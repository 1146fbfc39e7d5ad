"""CLEVRER's files: one reader, and a writer where one is needed, for each kind, and the scenes they describe."""

import lazy_loader

# Function and module have the same name; imported lazily, the name could mean the module.
from nsdr.clevrer.download import OFFICIAL_ROOT as OFFICIAL_ROOT, download as download

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
