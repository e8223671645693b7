"""The bundle block adjustment: unknowns, one module per kind of observation, solving, results in the user's names."""

import orip.arrays  # noqa: F401  # before SciPy, so that parts of NumPy can wait
