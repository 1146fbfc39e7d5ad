"""From tracks to rollouts: observed, future and counterfactual motion and collisions; the backends and their registry."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

VERSION = 7
"""Version of what all backends share, and of scenes made from predictions. It is raised when results change."""
