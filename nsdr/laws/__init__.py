"""Judging videos: which law of CLEVRER's world is broken, by which object, in which frame."""

VERSION = 6
"""Of the judgements of proposals: raised when they change."""
