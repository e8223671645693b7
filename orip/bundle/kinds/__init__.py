"""The kinds of observation, one a module: what it finds in a block, its value and its partials.

`all_kinds` lists them; a new kind is a module here and a line there.
"""
