"""Tracks, in which many photo points are wrong: which of them other photos confirm."""
