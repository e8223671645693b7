"""Photos of rigs: their elements from exposures and mountings, and the starting values of these."""
