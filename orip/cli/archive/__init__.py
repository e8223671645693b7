"""`orip archive`."""

from orip.cli.archive.commands import register

__all__ = ["register"]
