"""The bundle adjustment from the stores to the stores: preliminary values, solution, gates, results, report."""
