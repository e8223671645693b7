"""From the ground to the block and back: what control gives, a datum where there is none, the project's coordinates."""
