"""Models of early structure-from-motion programs: Bundler, BAL, and VisualSFM's NVM."""
