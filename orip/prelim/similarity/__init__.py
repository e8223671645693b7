"""Spatial similarities: joining models and strips, and taking the block to the ground."""
