"""The report: one HTML page that holds all it needs, from the solution of a bundle adjustment."""
