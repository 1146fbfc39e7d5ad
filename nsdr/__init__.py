"""NS-DR: answers questions about videos of colliding objects (CLEVRER, ICLR 2020) over a symbolic scene.

video -> frame parser -> proposals -> tracker -> tracks -> dynamics backend -> scene
question -> question parser -> program;  program + scene -> executor -> answer with its trace

    >>> import nsdr
    >>> pipeline = nsdr.Pipeline.from_pretrained()
    >>> pipeline.answer("video.mp4", "How many collisions happen?").answer

Names load their modules when first used, so `import nsdr` is quick. Import it before torch: it lets torch's idle threads
sleep, which must be set before torch loads (see `nsdr.io.device`).
"""

import lazy_loader

from nsdr.io.device import wait_passively

__version__ = "1.0.0"

wait_passively()

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
