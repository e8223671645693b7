"""Positions and attitudes of GNSS and INS as other programs write them, a module for each format."""
