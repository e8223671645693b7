"""A block on its way from what is measured and given to its solution, and what follows from a solution.

Starting values, adjustment and explanation, from `prelim`, `bundle` and `mistakes`; then new preliminary values and the
differences from another solution. Knows no project and no files.
"""
