"""Features of videos: the networks that make them, their extraction, and the files that hold them."""

VERSION = 4
"""Of the features of a video: raised when they change."""
