"""Simulation of CLEVRER scenes in Bullet."""
