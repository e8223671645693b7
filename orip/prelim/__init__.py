"""Preliminary values: relative orientation, bridging, connection, absolute orientation, resection, and the chain."""
