"""Variance components of groups of observations."""
