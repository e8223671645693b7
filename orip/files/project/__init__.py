"""orip.toml: its text to a checked project definition, and the definition back to its text.

Every fault of the text is kept with its line, and reported with what is allowed.
"""
