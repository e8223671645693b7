"""Commands that list and edit the records of the stores: cameras, tick marks, photos, templates, bundles, models."""

from orip.cli.records import camera_plot, commands

__all__ = ["camera_plot", "commands"]
