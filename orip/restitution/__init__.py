"""Restitution: points, lines and areas from stereo measurements, with standard deviations; their file and drawings."""
