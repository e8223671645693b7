"""Reconstructions, tracks and control points of OpenSfM and OpenDroneMap."""
