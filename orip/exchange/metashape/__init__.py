"""Cameras, markers and lenses of Agisoft Metashape and PhotoScan, as XML."""
