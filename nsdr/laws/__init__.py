"""Judging videos: which law of CLEVRER's world is broken, by which object, in which frame."""
