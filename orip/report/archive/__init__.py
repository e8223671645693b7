"""The page that shows an archive as a whole; each project has a report of its own."""
