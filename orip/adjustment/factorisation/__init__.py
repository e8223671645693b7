"""Solving normal equations: points eliminated, Cholesky of a band with a border, what is undetermined removed."""
