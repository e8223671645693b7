"""LAPACK's Cholesky factorisation of bands without Python's lock, so that threads can work at the same time.

SciPy's own wrappers keep the lock; it offers the routines themselves to compiled code in `scipy.linalg.cython_lapack`.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cython_lapack

from orip.arrays import FloatArray

_name_of_capsule = ctypes.PYFUNCTYPE(ctypes.c_char_p, ctypes.py_object)(("PyCapsule_GetName", ctypes.pythonapi))
_pointer_in_capsule = ctypes.PYFUNCTYPE(ctypes.c_void_p, ctypes.py_object, ctypes.c_char_p)(
    ("PyCapsule_GetPointer", ctypes.pythonapi)
)


def _routine(name: str, arguments: int) -> Callable[..., None]:
    """Return a routine of LAPACK with so many arguments, all of which are pointers."""
    capsule = cython_lapack.__pyx_capi__[name]
    address = _pointer_in_capsule(capsule, _name_of_capsule(capsule))
    return ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * arguments)(address)


_FACTORISE, _SOLVE = _routine("dpbtrf", 6), _routine("dtbtrs", 11)

_INTEGER = np.intc if b", int *" in _name_of_capsule(cython_lapack.__pyx_capi__["dpbtrf"]) else np.int64
"""SciPy may have been built with a LAPACK of long integers; the name of a routine's capsule has its types."""


def factorise_in_place(band: FloatArray) -> int:
    """Replace a band (n, w + 1), in LAPACK's lower storage by columns, by its factor L; return LAPACK's `info`."""
    count, stored = band.shape
    info = _number(0)
    _call(_FACTORISE, _letter("L"), _number(count), _number(stored - 1), band, _number(stored), info)
    return int(info)


def solve_in_place(band: FloatArray, vectors: FloatArray, trans: str) -> None:
    """Replace vectors (k, n) by L^-1 of them, or for "T" by L^-T of them, with L in a band (n, w + 1)."""
    count, stored = band.shape
    if vectors.size:
        _call(
            _SOLVE, _letter("L"), _letter(trans), _letter("N"), _number(count), _number(stored - 1),
            _number(len(vectors)), band, _number(stored), vectors, _number(count), _number(0),
        )  # fmt: skip


def _number(value: int) -> NDArray[Any]:
    return np.array(value, dtype=_INTEGER)


def _letter(value: str) -> NDArray[Any]:
    return np.array(value.encode())


def _call(routine: Callable[..., None], *arguments: NDArray[Any]) -> None:
    assert all(array.flags.c_contiguous for array in arguments), "a routine of LAPACK takes whole arrays"
    routine(*(array.ctypes.data for array in arguments))
