"""Commands of the exchange with other programs."""
