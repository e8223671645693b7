"""Observations in groups that may be wrong together, the tests of each group, and the verdict on them."""
