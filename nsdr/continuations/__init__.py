"""Continuations of videos by video models, beside what really follows, what could follow, and simple predictions."""

VERSION = 2
"""Of the scores; `nsdr.io.fingerprint` says when to raise it."""
