"""Commands that measure through the plate processor, and what they print."""

from orip.cli.digitise import commands

__all__ = ["commands"]
