"""What was computed: interior orientations, preliminary values and the solution of a bundle adjustment.

With a solution go the tests of its groups of observations, its figures by name, and the gates that they have to pass.
"""
