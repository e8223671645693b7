"""Records of the stores: the text of orip.toml applied to them, edits by commands, and the way back to the text."""
