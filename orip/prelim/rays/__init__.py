"""The rays of a block: all photo points measured in full, sorted by photo, and thinned where there are many."""
