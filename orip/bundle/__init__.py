"""The bundle block adjustment: unknowns, one module per kind of observation, solving, results in the user's names."""
