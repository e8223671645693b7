"""From a trajectory of GNSS and INS to exposure stations: interpolation, events and photos, strips, the ground."""
