"""`orip online`."""

from orip.cli.online.commands import register

__all__ = ["register"]
