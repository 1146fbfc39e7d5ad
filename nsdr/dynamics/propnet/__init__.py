"""Propagation networks (PropNet): on ground-plane states, and on patches as in the paper."""

VERSION = 1
"""Version of the predictions of these backends. It is raised when they change."""
