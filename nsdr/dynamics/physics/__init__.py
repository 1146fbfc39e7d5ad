"""The physics backend: a planar simulator, its fit to tracks, and the search for the collisions that explain the tracks."""

VERSION = 7
"""Version of the predictions of this backend. It is raised when they change."""
