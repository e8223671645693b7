"""The kinds of observation, one a module: what it finds in a block, its value and its partials.

A new kind is a module here, which lists its equations as `KINDS`, and a line in
`orip.records.observation_kinds`.
"""
