"""The judge of videos: which law of its world is broken, by which objects and in which frames."""

VERSION = 7
"""Version of the judgements of proposals. It is raised when they change."""
