"""Commands that drive: the drive table, the link to a plate processor, its emulator and the page that shows it."""
