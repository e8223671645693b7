"""Files: one format per module; text in, text out, and the record stores."""
