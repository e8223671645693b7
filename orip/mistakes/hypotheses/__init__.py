"""Hypotheses of what was meant: the block with one mistake undone, and what to say if that explains the misfit.

One module a kind of mistake; `order` lists them in the order in which they are tried.
"""
