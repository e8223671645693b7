"""residuals.csv: a row per observation component, for programs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

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
