"""Continuations of videos by video models, compared with the true future, possible futures and baselines."""

VERSION = 2
"""Version of the scores; `nsdr.io.fingerprint` says when it is raised."""
