"""residuals.npz: what residuals.csv has, as arrays; of blocks with so many observations that text would be slow.

`numpy.load` reads it. Names are numbers from 0 in the lists `photos`, `points` and so on, which are there once.
"""

from __future__ import annotations

import io
import zipfile
import zlib
from collections.abc import Iterator
from typing import IO, Any, cast

import numpy as np
from numpy.typing import NDArray

from orip.records.coded_names import coded
from orip.records.results.solution import Reliability, Residuals

_SAMPLE, _GAIN = 1 << 14, 0.5
"""Bytes by which it is judged whether an array compresses, and to which part it has to: measured and adjusted numbers
lose a sixth, and would take longer than all else that is written."""

_LEVEL = 1
_SINGLE = np.dtype(np.float32)
"""Seven digits, for what is a statistic of a residual; what has a unit keeps all of its digits."""


def residuals_npz_pieces(residuals: Residuals, reliability: Reliability) -> Iterator[bytes | memoryview]:
    """Yield the bytes of residuals.npz, array by array; equal residuals give equal bytes."""
    written = _Appended()
    with zipfile.ZipFile(cast("IO[bytes]", written), "w", compresslevel=_LEVEL) as archive:
        for name, values in _arrays(residuals, reliability):
            head, data = _npy(values)
            archive.compression = zipfile.ZIP_DEFLATED if _compresses(head, data) else zipfile.ZIP_STORED
            is_huge = len(data) > zipfile.ZIP64_LIMIT // 2
            with archive.open(f"{name}.npy", "w", force_zip64=is_huge) as stream:  # of 1980: no clock goes in
                stream.write(head)
                stream.write(data)
            yield from written.taken()
    yield from written.taken()


def _arrays(residuals: Residuals, reliability: Reliability) -> Iterator[tuple[str, NDArray[Any]]]:
    for name in ("kind", "photo", "point", "component"):
        column = coded(getattr(residuals, name)).without_unused()
        yield f"{name}s", np.array(column.distinct, dtype=np.str_)
        yield name, column.codes.astype(np.min_scalar_type(max(len(column.distinct) - 1, 0)))
    for name in ("observed", "residual", "a_priori"):
        yield name, getattr(residuals, name)
    for name in ("standard_residual", "weight_factor", "redundancy_number", "w"):
        yield name, getattr(residuals, name).astype(_SINGLE)
    yield "adjusted_sd", reliability.adjusted_sd.astype(_SINGLE)
    yield "minimal_detectable_bias", reliability.minimal_detectable_bias.astype(_SINGLE)
    yield "external_reliability", reliability.external.astype(_SINGLE)


def _npy(values: NDArray[Any]) -> tuple[bytes, memoryview]:
    """Return head and content of an array's file."""
    stream, values = io.BytesIO(), np.ascontiguousarray(values)
    np.lib.format.write_array_header_1_0(stream, np.lib.format.header_data_from_array_1_0(values))
    return stream.getvalue(), values.view(np.uint8).data


def _compresses(head: bytes, data: memoryview) -> bool:
    sample = (head + bytes(data[:_SAMPLE]))[:_SAMPLE]
    return len(zlib.compress(sample, _LEVEL)) < _GAIN * len(sample)


class _Appended:
    """A stream that only grows: what is written can be taken away, as it is, before the rest comes."""

    def __init__(self) -> None:
        self._pieces: list[bytes | memoryview] = []

    def taken(self) -> list[bytes | memoryview]:
        """Return what has been written since it was taken last."""
        pieces, self._pieces = self._pieces, []
        return pieces

    def write(self, data: bytes | memoryview) -> int:
        """Append bytes."""
        self._pieces.append(data)
        return len(data)

    def flush(self) -> None:
        """Do nothing: there is no buffer."""
