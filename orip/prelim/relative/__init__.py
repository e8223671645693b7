"""Relative orientation of two photos without initial values, from the points common to them."""
