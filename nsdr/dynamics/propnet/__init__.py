"""Propagation networks (PropNet): on ground-plane states, and on patches as in the paper."""

VERSION = 1
"""Of these backends' predictions: raised when they change."""
