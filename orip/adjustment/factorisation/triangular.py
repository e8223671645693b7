"""Systems of equations with a lower triangle, by LAPACK itself.

Small blocks have hundreds of systems of some unknowns, which take less time than the checks of SciPy's
`solve_triangular`.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import lapack

from orip.arrays import FloatArray


def solve_lower(lower: FloatArray, right: FloatArray, *, transposed: bool = False) -> FloatArray:
    """Return L^-1 or L^-T times vectors.

    Parameters
    ----------
    lower : array (m, m)
        L; what stands above its diagonal is not read, and need not be finite.
    right : array (m,) or (m, k)
    transposed : bool
        Whether L^-T is wanted.

    Raises
    ------
    ValueError
        If a vector is not finite.
    numpy.linalg.LinAlgError
        If an element of the diagonal is zero.
    """
    finite = np.asarray_chkfinite(right)
    if not finite.size:
        return np.zeros(finite.shape)
    if lower.flags.f_contiguous:
        found, info = lapack.dtrtrs(lower, finite, lower=1, trans=int(transposed))
    else:  # LAPACK has columns where NumPy has rows
        found, info = lapack.dtrtrs(lower.T, finite, lower=0, trans=int(not transposed))
    if info != 0:
        message = f"element {info} of the diagonal is zero"
        raise np.linalg.LinAlgError(message)
    return np.asarray(found)
