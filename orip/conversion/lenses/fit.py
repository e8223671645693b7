"""Orip's polynomial fitted to a lens that it does not hold exactly.

With the polynomial at ideal coordinates, measured coordinates are linear in DX, DY, C, C³ A3, C⁵ A5, C⁷ A7, C² P1,
C² P2, C B1 and C B2: one linear least-squares problem.
"""

from __future__ import annotations

import numpy as np

from orip.arrays import FloatArray
from orip.conversion.lenses.polynomial import Polynomial
from orip.interior.distortion import distorted_by_coefficients
from orip.records.project.camera import CAMERA_PARAMETERS

_FITTED = tuple(name for name in CAMERA_PARAMETERS[3:] if name != "A1")
"""A1 does the same as C."""

_POWER = {name: (int(name[1]) if name[0] == "A" else 2 if name[0] == "P" else 1) for name in _FITTED}
"""A coefficient of directions is that of lengths times C to this power."""


def fitted_polynomial(directions: FloatArray, image: FloatArray) -> tuple[Polynomial, FloatArray]:
    """Return the polynomial that comes nearest to a lens, and its residuals.

    Parameters
    ----------
    directions : array (n, 2)
        Over the frame.
    image : array (n, 2)
        Where the lens has them.

    Returns
    -------
    Polynomial, array (n, 2)
        Fitted minus given, in the unit of `image`.
    """
    x, y = directions.T
    by_coefficients = distorted_by_coefficients(x, y)
    columns = [CAMERA_PARAMETERS[3:].index(name) for name in _FITTED]
    design = np.zeros((len(x), 2, 3 + len(columns)))
    design[:, 0, 0] = design[:, 1, 1] = 1.0
    design[:, :, 2] = directions
    design[:, :, 3:] = by_coefficients[:, :, columns]
    rows = design.reshape(len(x) * 2, -1)
    scale = np.linalg.norm(rows, axis=0)
    scaled, *_ = np.linalg.lstsq(rows / scale, image.ravel(), rcond=None)
    found = scaled / scale
    residuals = (rows @ found).reshape(-1, 2) - image
    c = float(found[2])
    coefficients = {name: float(value) / c ** _POWER[name] for name, value in zip(_FITTED, found[3:], strict=True)}
    return Polynomial(c, (float(found[0]), float(found[1])), coefficients), residuals
