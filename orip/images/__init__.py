"""The images of photos: which file is whose, its pixels whole, by regions and as tiles, and matching of its patches."""
