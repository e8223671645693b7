"""Commands of the exchange with other programs."""

from orip.cli.exchange import import_project

__all__ = ["import_project"]
