"""Tracks to rollouts: motion and collisions, observed, future and counterfactual; the backends and their registry."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

VERSION = 5
"""Of what backends share, such as the collisions of a recording, and of scenes made of predictions: raised when they change."""
