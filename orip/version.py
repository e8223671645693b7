"""The version of orip."""

__version__ = "0.1.0"
