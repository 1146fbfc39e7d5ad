"""Propagation networks (PropNet): on ground-plane states, and on patches as in the paper."""

from nsdr.dynamics.propnet.layers import PropNet
from nsdr.dynamics.propnet.patch_model import PatchModel, PatchModelConfig
from nsdr.dynamics.propnet.patch_predictor import PatchPredictor
from nsdr.dynamics.propnet.state_model import StateModel, StateModelConfig
from nsdr.dynamics.propnet.state_predictor import StatePredictor

__all__ = [
    "PatchModel",
    "PatchModelConfig",
    "PatchPredictor",
    "PropNet",
    "StateModel",
    "StateModelConfig",
    "StatePredictor",
]

VERSION = 1
"""Of these backends' predictions: raised when they change."""
