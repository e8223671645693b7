"""Nested dissection of the reduced unknowns (George 1973): Helmert's blocking, with separators on several levels."""
