"""Cameras, markers, lenses, tie points and reference tables of Agisoft Metashape and PhotoScan."""
