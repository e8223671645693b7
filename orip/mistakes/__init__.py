"""What was probably mistaken when something was typed, named or measured: units, names, signs, the order of photos.

A module a mistake, with its signs before the adjustment and in its result, what is tried, and its words. `checks` and
`order` say which are looked for first, `hypothesis` what it is to try one, and `explanation` puts the answers together.
"""
