"""Commands of the adjustment: preliminary values, solving, its results, report, gates and comparison."""
