"""Commands for the whole project: making it, its state, running it, its stores as text."""

from orip.cli.project import adjust_source, export_toml, init, new, run, status, stores

__all__ = ["adjust_source", "export_toml", "init", "new", "run", "status", "stores"]
