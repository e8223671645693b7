"""Standard error ellipses of plane coordinates."""

from __future__ import annotations

import numpy as np

from orip.arrays import FloatArray


def error_ellipses(covariance: FloatArray) -> FloatArray:
    """Return semi-major axis, semi-minor axis and direction of the former (radians, from X to Y) of covariances.

    Parameters
    ----------
    covariance : array (m, 3, 3)
        Of X, Y, Z.

    Returns
    -------
    array (m, 3)
        NaN where X or Y has no variance.

    Notes
    -----
    Closed form of the eigenvalues of a symmetric matrix of two rows.
    """
    xx, xy, yy = covariance[:, 0, 0], covariance[:, 0, 1], covariance[:, 1, 1]
    mean, half = 0.5 * (xx + yy), 0.5 * (xx - yy)
    spread = np.hypot(half, xy)
    axes = np.sqrt(np.maximum(np.stack([mean + spread, mean - spread], axis=1), 0.0))
    return np.column_stack([axes, 0.5 * np.arctan2(xy, half)])
