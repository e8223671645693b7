"""Commands of the exchange with other programs."""

from orip.cli.exchange import export_project, import_project

__all__ = ["export_project", "import_project"]
