"""Commands that measure through the plate processor, and what they print."""
