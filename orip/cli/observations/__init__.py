"""Commands for what is measured: reading the measurement log, listing observations and editing them."""

from orip.cli.observations import commands, measure

__all__ = ["commands", "measure"]
