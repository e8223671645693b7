"""Commands for the whole project: making it, its state, running it, its stores as text."""
