"""A least squares adjustment that takes observations in and out one at a time, for measuring on-line.

The upper triangle of the reduced unknowns, points as rows above it, and which observations are in. Knows neither how
observations are linearised beyond asking the bundle for it, nor projects and files.
"""

from __future__ import annotations

import orip.arrays  # noqa: F401  # before SciPy, so that parts of NumPy can wait
