"""Intersection of all points of a block at once from oriented photos."""
