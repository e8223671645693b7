"""The photos of the page: their residuals, their exposure stations, and the rigs that their cameras form.

Each module makes the tables and charts of one subject; the scale of photos is in `orip.report.photo_scale`, as the
drawings need it too.
"""
