"""A block while it is measured: its measurements, its first photos, its values, and the system that they are in."""
