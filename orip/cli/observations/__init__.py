"""Commands for what is measured: reading the measurement log, listing observations and editing them."""
