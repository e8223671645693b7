"""Orientation of parts of a block together: models, strips or single photos that cannot be joined one by one."""
