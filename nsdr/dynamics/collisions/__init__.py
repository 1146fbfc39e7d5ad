"""Collisions in observed motion: a temporal network over whole tracks."""

from nsdr.dynamics.collisions.detector import TrackCollisionDetector
from nsdr.dynamics.collisions.network import CollisionNetwork, CollisionNetworkConfig

__all__ = ["CollisionNetwork", "CollisionNetworkConfig", "TrackCollisionDetector"]
