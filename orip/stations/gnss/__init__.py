"""From the observations of GNSS receivers to positions: what is in the files, RTKLIB, and what can be trusted of it."""
