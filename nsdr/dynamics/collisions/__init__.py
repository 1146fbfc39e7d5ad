"""Collisions in observed motion: a temporal network over whole tracks."""

from nsdr.dynamics.collisions.network import CollisionNetwork, CollisionNetworkConfig, TrackCollisionDetector

__all__ = ["CollisionNetwork", "CollisionNetworkConfig", "TrackCollisionDetector"]
