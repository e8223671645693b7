"""`orip archive`."""
