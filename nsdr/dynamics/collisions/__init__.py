"""Collisions in observed motion: a temporal network over whole tracks."""
