"""The measurement log (.MEA): read block by block, written while it is measured, and lists of points to measure."""
