"""Fiducial and tick marks that were probably mistaken."""
