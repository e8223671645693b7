"""The mathematics of tie points: features compared, joined to tracks, selected, and matched by least squares.

Arrays in, arrays out: no files, no projects.
"""
