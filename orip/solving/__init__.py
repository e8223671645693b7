"""A block on its way from what is measured and given to its solution: starting values, adjustment, explanation.

Brings together `prelim`, `bundle` and `mistakes`; knows no project and no files.
"""
