"""Listings for people: interior orientation, preliminary values, adjusted values, residuals, errors."""
