"""Orientations, cameras and points of MicMac: the XML of its first version and of MMVII."""
