"""The report on a bundle adjustment: one HTML page that contains everything it needs."""
