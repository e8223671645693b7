"""A solution as tables: columns with names and units, for data frames and other programs."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING, Any, Literal, Protocol, get_args

import numpy as np
from msgspec import Struct
from msgspec.structs import asdict
from numpy.typing import NDArray

from orip.arrays import FloatArray
from orip.bundle.results.compared_points import AXES, COMPARED_KINDS, ComparedPoints, compared_points
from orip.bundle.verdict import headline, sigma0_test
from orip.errors import OripError, UnknownNameError
from orip.number_text import HUGE, MISSING
from orip.records.observation_kinds import unit_of_observation
from orip.records.results.solution import Blunder, IterationPass, Residuals, Solution
from orip.records.results.tests import GroupTest
from orip.wording import counted

if TYPE_CHECKING:
    import pandas as pd

TableName = Literal["cameras", "photos", "points", "residuals", "control", "check", "groups", "blunders", "iterations"]

Words = NDArray[np.object_]
"""Texts (n,)."""


class Table(Struct, frozen=True):
    """A table: columns of equal length by their headings, and the units of those that have one."""

    columns: Mapping[str, Sequence[Any] | NDArray[Any]]
    units: Mapping[str, str] = {}


def html_table(columns: Mapping[str, Sequence[Any] | NDArray[Any]], caption: str, most: int = 20) -> str:
    """Return a table for a notebook: the first rows, and how many were left out."""
    number = len(next(iter(columns.values()), ()))
    head = "".join(f"<th>{escape(heading)}</th>" for heading in columns)
    rows = zip(*(values[:most] for values in columns.values()), strict=True)
    body = "".join(f"<tr>{''.join(f'<td>{escape(_shown(value))}</td>' for value in row)}</tr>" for row in rows)
    more = f"<p>{number - most} more rows; <code>to_dataframe</code> has all</p>" if number > most else ""
    return (
        f"<table><caption>{escape(caption)}</caption><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>{more}"
    )


def _shown(value: object) -> str:
    if not isinstance(value, float):
        return str(value)
    if math.isnan(value):
        return MISSING
    return f"{value:.4f}" if 1e-3 <= abs(value) < HUGE or value == 0.0 else f"{value:.4g}"


def estimates_table(
    names: Sequence[str], parameters: Sequence[str], values: FloatArray, sd: FloatArray, units: Sequence[str]
) -> Table:
    """Return name, values, and deviations with an s before the name of each."""
    found = {name: values[:, place] for place, name in enumerate(parameters)}
    found |= {f"s{name}": sd[:, place] for place, name in enumerate(parameters)}
    return Table({"name": list(names), **found}, dict(zip(found, (*units, *units), strict=True)))


class ObservationResiduals(Struct, frozen=True):
    """The residuals of n observation components, column by column; each array has the shape (n,).

    Parameters
    ----------
    kind : array of str
        "photo", "control", "element", "distance", "direction" and so on.
    photo : array of str
        Empty where none is concerned.
    point : array of str
        Point, or the name of what was observed.
    component : array of str
        Which part of it: "x", "y", "X" and so on.
    unit : array of str
        Unit of `observed`, `residual` and `a_priori`: "mm", the ground unit or "degrees"; empty for pure numbers.
    observed : array
    residual : array
        Adjusted minus observed.
    a_priori : array
        A-priori error, the standard deviation that was expected.
    standard_residual : array
        Size of the residual over the a-priori error.
    weight_factor : array
        Below 1: down-weighted; NaN: disregarded.
    redundancy_number : array
        From 0 (nothing checks the observation) to 1; NaN: disregarded.
    w : array
        Normalised residual, the statistic of data snooping; NaN where the redundancy number is too small.
    """

    kind: Words
    photo: Words
    point: Words
    component: Words
    unit: Words
    observed: FloatArray
    residual: FloatArray
    a_priori: FloatArray
    standard_residual: FloatArray
    weight_factor: FloatArray
    redundancy_number: FloatArray
    w: FloatArray

    def __len__(self) -> int:
        return len(self.kind)

    def table(self) -> Table:
        """Return the residuals as a table: a row for each component."""
        return Table(asdict(self))

    def _repr_html_(self) -> str:
        return html_table(self.table().columns, counted(len(self), "observation component"))

    def __repr__(self) -> str:
        columns = ", ".join(self.__struct_fields__)
        return f"<{counted(len(self), 'observation component')}: {columns}>"


class HasTable(Protocol):
    """What can be shown as a table."""

    def table(self) -> Table:
        """Return it."""


def residuals_of(found: Residuals, ground_unit: str) -> ObservationResiduals:
    """Return the residuals of a solution with their units."""
    known: dict[tuple[str, str], str] = {}
    units = []
    for pair in zip(found.kind, found.component, strict=True):
        if pair not in known:
            known[pair] = unit_of_observation(*pair, ground_unit)
        units.append(known[pair])
    columns = asdict(found)
    words = {name: _words(values) for name, values in columns.items() if not isinstance(values, np.ndarray)}
    return ObservationResiduals(unit=_words(units), **{**columns, **words})


def data_frame(what: TableName, solution: Solution, tables: Mapping[str, HasTable]) -> pd.DataFrame:
    """Return a table of a solution, see `orip.Solution.to_dataframe`."""
    pandas = _pandas()
    if what not in get_args(TableName):
        raise UnknownNameError(what, "table", get_args(TableName))
    table = tables[what].table() if what in tables else _further_table(what, solution)
    frame = pandas.DataFrame(dict(table.columns))
    if table.units:
        frame = frame.set_index("name")
        frame.attrs["units"] = dict(table.units)
    return frame


def _further_table(what: TableName, solution: Solution) -> Table:
    """Return a table that has no object of its own."""
    if what == "control" or what == "check":
        return _compared_table(compared_points(solution, what), solution.ground_unit)
    rows: Sequence[Struct] = {
        "groups": solution.groups, "blunders": solution.blunders, "iterations": solution.iterations
    }[what]  # fmt: skip
    fields = {"groups": GroupTest, "blunders": Blunder, "iterations": IterationPass}[what].__struct_fields__
    return Table({name: [getattr(row, name) for row in rows] for name in fields})


def _compared_table(points: ComparedPoints, unit: str) -> Table:
    columns: dict[str, Any] = {"name": list(points.names), "rays": points.rays}
    units: dict[str, str] = {}
    for heading, values, own in (
        ("d{}", points.difference, unit), ("s{}", points.sd, unit), ("given_s{}", points.given_sd, unit),
        ("w{}", points.w, ""),
    ):  # fmt: skip
        columns |= {heading.format(axis): values[:, place] for place, axis in enumerate(AXES)}
        units |= {heading.format(axis): own for axis in AXES if own}
    return Table({**columns, "image": points.image, "doubted": points.doubted}, {**units, "image": "mm"})


def solution_html(solution: Solution) -> str:
    """Return what a notebook shows of a solution: the verdict, key figures, control and check points."""
    figures = {
        "status": solution.status.replace("_", " "), "sigma0": f"{solution.sigma0:.4f}",
        "redundancy": solution.redundancy, "observations": solution.observations, "unknowns": solution.unknowns,
        "photos": len(solution.photos.names), "points": len(solution.points.names), "run": solution.run or MISSING,
    }  # fmt: skip
    _level, sentence = headline(solution, 0, sigma0_test(solution))
    parts = [
        f"<p><b>{escape(sentence)}</b></p>",
        html_table({"": list(figures), " ": [str(value) for value in figures.values()]}, f"Bundle {solution.bundle}"),
    ]
    for kind in COMPARED_KINDS:
        points = compared_points(solution, kind)
        if len(points):
            columns = {**_compared_table(points, solution.ground_unit).columns}
            shown = {name: values for name, values in columns.items() if not name.startswith("given")}
            parts.append(html_table(shown, f"{kind.capitalize()} points ({solution.ground_unit}; image in mm)"))
    return "".join(parts)


def _words(values: Any) -> Words:
    found = np.empty(len(values), dtype=object)
    found[:] = values
    return found


def _pandas() -> Any:
    try:
        import pandas as pd
    except ImportError:
        message = "to_dataframe needs pandas, which is not installed; run 'pip install pandas', or use the arrays"
        raise OripError(message) from None
    return pd
