"""Commands that drive: the drive table, the link to a plate processor, its emulator and the page that shows it."""

from orip.cli.drive import commands, emulator, link, watch

__all__ = ["commands", "emulator", "link", "watch"]
