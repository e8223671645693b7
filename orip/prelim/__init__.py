"""Preliminary values: relative orientation, bridging, strip connection, absolute orientation, resection, and the chain."""
