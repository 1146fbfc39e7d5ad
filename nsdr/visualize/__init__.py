"""Images, videos and HTML reports that show what each stage found and why a question got its answer."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
