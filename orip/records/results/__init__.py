"""Results of an adjustment in the user's names and units, tests and stations among them."""
