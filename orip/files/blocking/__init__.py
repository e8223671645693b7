"""The partitioned store of photo points: a file for each sub-block, read by whoever computes it."""
