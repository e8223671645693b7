"""A solution as tables: columns with names and units, for data frames and other programs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np
from msgspec import Struct
from msgspec.structs import asdict
from numpy.typing import NDArray

from orip.api.estimates import AdjustedCameras
from orip.arrays import FloatArray
from orip.errors import OripError, UnknownNameError
from orip.records.observations.observation_kinds import unit_of_observation
from orip.records.project.camera import CAMERA_UNITS
from orip.records.project.photo import PHOTO_PARAMETERS
from orip.records.results.solution import Residuals, Solution
from orip.wording import counted

if TYPE_CHECKING:
    import pandas as pd

TableName = Literal["cameras", "photos", "points", "residuals"]
_AXES = ("X", "Y", "Z")

Words = NDArray[np.object_]
"""Texts (n,)."""


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

    def __repr__(self) -> str:
        columns = ", ".join(self.__struct_fields__)
        return f"<{counted(len(self), 'observation component')}: {columns}>"


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


def data_frame(
    what: TableName, solution: Solution, cameras: AdjustedCameras, residuals: ObservationResiduals
) -> pd.DataFrame:
    """Return a table of a solution, see `orip.Solution.to_dataframe`."""
    pandas = _pandas()
    if what not in get_args(TableName):
        raise UnknownNameError(what, "table", get_args(TableName))
    if what == "residuals":
        return pandas.DataFrame(asdict(residuals))
    if what == "cameras":
        return pandas.DataFrame(_camera_columns(cameras))
    columns, units = _estimate_columns(what, solution)
    frame = pandas.DataFrame(columns).set_index("name")
    frame.attrs["units"] = units
    return frame


def _estimate_columns(
    what: Literal["photos", "points"], solution: Solution
) -> tuple[dict[str, Any], Mapping[str, str]]:
    """Return name, values, deviations (an s before the name of each), and what else is known; and the units."""
    ground = solution.ground_unit
    names: tuple[str, ...]
    units: tuple[str, ...]
    if what == "points":
        estimates, names, units = solution.points, _AXES, (ground,) * 3
        further: dict[str, Any] = {"kind": list(solution.point_kinds), "rays": solution.point_rays.tolist()}
    else:
        estimates, names, units = solution.photos, PHOTO_PARAMETERS, (*(ground,) * 3, *("degrees",) * 3)
        further = {"rotations_about_axes": list(solution.photo_rotation_sd_about_axes)}
    values = {name: estimates.values[:, place] for place, name in enumerate(names)}
    deviations = {f"s{name}": estimates.sd[:, place] for place, name in enumerate(names)}
    columns = {"name": list(estimates.names), **values, **deviations, **further}
    return columns, dict(zip((*values, *deviations), (*units, *units), strict=True))


def _camera_columns(cameras: AdjustedCameras) -> dict[str, Any]:
    rows = [
        (camera.name, parameter, value, deviation, CAMERA_UNITS.get(parameter, ""))
        for camera in cameras.values()
        for parameter, value, deviation in zip(
            camera.parameter_names, camera.parameters.tolist(), camera.deviations.tolist(), strict=True
        )
    ]
    headings = ("camera", "parameter", "value", "deviation", "unit")
    return {heading: [row[place] for row in rows] for place, heading in enumerate(headings)}


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
