"""Archives of many projects: the order of their adjustment, what is kept of each, and what differs between two runs."""
