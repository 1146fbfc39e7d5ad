"""Constants of Bullet's engine, the same in every world."""

ERROR_REDUCTION = 0.08
"""Bullet's default error reduction parameter (ERP): the fraction of a penetration that is corrected per step."""
CONTACT_THRESHOLD = 0.02
"""Bullet handles a contact if the gap is below this share of the smaller of the hulls' angular motion discs."""
MIN_REBOUND_SPEED = 0.2
"""Approach speed (world units/s) below which Bullet applies no restitution."""
HULL_MARGIN_WORLD = 0.001
"""Bullet's collision margin around every convex hull (world units)."""
