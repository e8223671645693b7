"""Hypotheses about what was meant: the block with one mistake corrected, and the warning if that explains the misfit.

One module a kind of mistake; `order` lists them in the order in which they are tried.
"""
