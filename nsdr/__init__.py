"""NS-DR: answers questions about videos of colliding objects (CLEVRER, ICLR 2020) over a symbolic scene.

video -> frame parser -> proposals -> tracker -> tracks -> dynamics backend -> scene
question -> question parser -> program;  program + scene -> executor -> answer with its trace

    >>> import nsdr
    >>> pipeline = nsdr.Pipeline.from_pretrained()
    >>> pipeline.answer("video.mp4", "How many collisions happen?").answer

Names load their modules when first used, so `import nsdr` is quick. Use the first of them before torch is imported: they load
torch so that its idle threads sleep (see `nsdr.io.device`).
"""

from typing import Any

import lazy_loader

from nsdr.io.device import passive_threads

__version__ = "1.0.0"

_load, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


def __getattr__(name: str) -> Any:
    """What is loaded when it is first used."""
    with passive_threads():
        return _load(name)
