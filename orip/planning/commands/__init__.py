"""The commands of `orip plan`."""
