"""Commands of the adjustment: preliminary values, solving, its results, report, gates and comparison."""

from orip.cli.adjust import check, compare, prelim, report, results, solve, update

__all__ = ["check", "compare", "prelim", "report", "results", "solve", "update"]
