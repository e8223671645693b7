"""Residuals and covariances for programs: residuals.csv, residuals.npz, and a covariance matrix as a file."""

from __future__ import annotations

import csv
import io
import zipfile
import zlib
from collections.abc import Iterator, Sequence
from typing import IO, Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from orip.arrays import FloatArray
from orip.number_text import shortest_texts
from orip.records.coded_names import CodedNames, coded
from orip.records.results.solution import Reliability, Residuals

HEADER = (
    "kind,photo,point,component,observed,residual,a_priori,standard_residual,weight_factor,redundancy_number,w,"
    "adjusted_sd,minimal_detectable_bias,external_reliability\n"
)

ROWS_PER_PIECE = 16384


def residuals_csv_pieces(residuals: Residuals, reliability: Reliability) -> Iterator[str]:
    """Yield residuals.csv in pieces of whole lines, so that millions of rows need little memory.

    The first line is the header; floats are the shortest text that reads back exactly; empty cells stand for NaN.
    """
    yield HEADER
    names = [
        _quoted_names(column) for column in (residuals.kind, residuals.photo, residuals.point, residuals.component)
    ]
    for start in range(0, len(residuals.kind), ROWS_PER_PIECE):
        part = slice(start, start + ROWS_PER_PIECE)
        numbers = (
            residuals.observed,
            residuals.residual,
            residuals.a_priori,
            residuals.standard_residual,
            residuals.weight_factor,
            residuals.redundancy_number,
            residuals.w,
            reliability.adjusted_sd,
            reliability.minimal_detectable_bias,
            reliability.external,
        )
        columns = [
            *(column[part] for column in names),
            *(_number_cells(column[part]) for column in numbers),
        ]
        yield "\n".join(map(",".join, zip(*columns, strict=True))) + "\n"


def _quoted_names(names: Sequence[str]) -> CodedNames:
    column = coded(names)
    return CodedNames(tuple(map(_quoted, column.distinct)), column.codes)


def _quoted(name: str) -> str:
    # RFC 4180: names of points are free text and may well hold a comma
    return '"' + name.replace('"', '""') + '"' if any(mark in name for mark in ',"\r\n') else name


def _number_cells(values: FloatArray) -> list[str]:
    bits = np.ascontiguousarray(values).view(np.int64)  # 0.0 and -0.0 differ, NaN are alike
    if (bits == bits[0]).all():  # as a-priori errors and weight factors mostly are
        return shortest_texts(values[:1], missing="") * len(values)
    return shortest_texts(values, missing="")


# `numpy.load` reads it. Names are numbers from 0 in the lists `photos`, `points` and so on, which are there once.

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


class CovarianceMatrix(NamedTuple):
    """Covariances of n figures.

    Attributes
    ----------
    names : sequence of n str
        ``camera C35.C``, ``photo 102.X0``, ``point CP3.Z``.
    values : array (n,)
    covariance : array (n, n)
        In the products of these units.
    run : str
        Of the adjustment.
    """

    names: Sequence[str]
    units: Sequence[str]
    values: FloatArray
    covariance: FloatArray
    sigma0: float
    run: str


def npz_bytes(matrix: CovarianceMatrix) -> bytes:
    """Return the matrix as an .npz with the arrays names, units, values, covariance, sigma0 and run."""
    file = io.BytesIO()
    np.savez_compressed(
        file, names=np.array(matrix.names, dtype=np.str_), units=np.array(matrix.units, dtype=np.str_),
        values=matrix.values, covariance=matrix.covariance, sigma0=np.array(matrix.sigma0), run=np.array(matrix.run),
    )  # fmt: skip
    return file.getvalue()


def csv_bytes(matrix: CovarianceMatrix) -> bytes:
    """Return the matrix as CSV: name, unit, value, and a column for each figure; numbers with all digits."""
    file = io.StringIO(newline="")
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(["name", "unit", "value", *matrix.names])
    rows = zip(matrix.names, matrix.units, matrix.values.tolist(), matrix.covariance.tolist(), strict=True)
    for name, unit, value, row in rows:
        writer.writerow([name, unit, repr(value), *map(repr, row)])
    return file.getvalue().encode()
