"""The physics backend: a planar simulator, its fit to tracks, and the search for the collisions that explain them."""

VERSION = 6
"""Of this backend's predictions: raised when they change."""
