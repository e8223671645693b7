"""Least-squares matching of patches: arrays in, arrays out, no files."""
