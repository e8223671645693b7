"""Refinement of preliminary values: photos and points of a growing block in one rough adjustment."""
