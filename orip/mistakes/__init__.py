"""What was probably mistaken when something was typed, named or measured: units, names, signs, the order of photos.

A module a mistake, which declares its words and what follows from it (`mistake`), with its signs before the adjustment
and in its result, and what is tried. `checks` and `order` have a line for each, which says what is looked for first;
`hypothesis` says what it is to try one, and `explanation` puts the answers together.
"""
