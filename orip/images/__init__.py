"""The images of photos: which file is whose, its pixels whole, by regions and as tiles, and matching of its patches."""

TILE_FOLDER = ".orip-tiles"
"""Of a project, for what is kept of its images between runs; it may be deleted at any time."""
