"""Control points, check points and distances that were probably mistaken."""
