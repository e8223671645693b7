"""Exposure stations from the files of GNSS and INS."""
