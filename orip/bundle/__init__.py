"""The bundle block adjustment: unknowns, one module per kind of observation, solving, results in the user's names."""

from orip import arrays as arrays  # before SciPy, so that parts of NumPy can wait
