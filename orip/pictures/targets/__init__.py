"""Targets in photographs: round dots, sheets of coded dots, boards of chequers and tags. Arrays alone, no files.

Positions are pixels, column and row from the outer corner of the upper left pixel.
"""
