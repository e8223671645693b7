"""The drawings of the page: the block in three dimensions, error ellipses, residual vectors, and SVG for them."""
