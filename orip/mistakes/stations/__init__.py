"""Positions and angles of photos, in .STA or .ELE: all misread alike, single ones wrong, of other photos, strips."""
