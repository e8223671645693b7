"""`orip online`."""
