"""From inertial data and GNSS positions to a trajectory with attitudes: alignment, smoothing, and its files."""
