"""Rendering of scenes with Blender or a fast preview renderer, and exact masks."""
