"""Rigs that are not as they are said to be."""
