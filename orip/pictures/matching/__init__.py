"""The mathematics of tie points: features compared, joined to tracks and selected, and windows to match them by.

Arrays in, arrays out: no files, no projects.
"""
