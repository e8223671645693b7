"""Mistakes that an adjustment shows by itself, without another adjustment.

Contradicting control, points under a wrong number, observations or errors in another unit, a mirrored plane object.
"""
