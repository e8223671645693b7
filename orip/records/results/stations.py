"""The exposure stations of a solution with their residuals, and what an update of values has replaced."""

from __future__ import annotations

from typing import Literal, TypeAlias

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray
from orip.records.coded_names import coded
from orip.records.observation_kinds import ATTITUDE, CONSTANT_ATTITUDE, CONSTANT_STATION, STATION
from orip.records.results.solution import Exposure, Solution

POSITION_KINDS = (STATION.name, CONSTANT_STATION.name)
ATTITUDE_KINDS = (ATTITUDE.name, CONSTANT_ATTITUDE.name)


class StationResiduals(Struct, frozen=True):
    """Positions or attitudes of n stations, in the order of time as far as that is known.

    Parameters
    ----------
    residual, weight_factor, w : arrays (n, 3)
        Of X, Y, Z or of the three angles; as in `Residuals`.
    a_priori : array (n, 3)
    """

    exposures: tuple[Exposure, ...]
    residual: FloatArray
    a_priori: FloatArray
    weight_factor: FloatArray
    w: FloatArray

    def __len__(self) -> int:
        """Return the number of stations."""
        return len(self.exposures)


def station_residuals(solution: Solution, what: Literal["position", "attitude"]) -> StationResiduals:
    """Return the residuals of positions or attitudes of stations, a row for each."""
    kinds = POSITION_KINDS if what == "position" else ATTITUDE_KINDS
    residuals = solution.residuals
    rows: dict[str, list[int]] = {}
    for row in np.flatnonzero(coded(residuals.kind).where(lambda kind: kind in kinds)).tolist():
        rows.setdefault(residuals.photo[row], []).append(row)
    known = {exposure.photo: exposure for exposure in solution.exposures}
    whole = [(known.get(photo, Exposure(photo, "", np.nan)), three) for photo, three in rows.items() if len(three) == 3]
    whole.sort(key=lambda item: np.nan_to_num(item[0].time, nan=np.inf))
    index = np.array([three for _, three in whole], dtype=np.int64).reshape(-1, 3)
    return StationResiduals(
        exposures=tuple(exposure for exposure, _ in whole),
        residual=residuals.residual[index],
        a_priori=residuals.a_priori[index],
        weight_factor=residuals.weight_factor[index],
        w=residuals.w[index],
    )


Kept: TypeAlias = "float | tuple[Kept, ...] | None"
"""The value of a field: a number, none, or several."""


class RecordBefore(Struct, frozen=True):
    """A camera or photo before an update.

    Parameters
    ----------
    fields : tuple of (str, Kept)
        The fields that the update has changed, as they were.
    updated : str
        `record_digest` of the record that the update has made.
    """

    name: str
    fields: tuple[tuple[str, Kept], ...]
    updated: str


class TextBefore(Struct, frozen=True):
    """BUNDLE.PRE before an update.

    Parameters
    ----------
    text : str or None
        None: there was none.
    updated : str
        Digest of the file that the update has made.
    """

    text: str | None
    updated: str


class BeforeUpdate(Struct, frozen=True):
    """What the last update replaced: records, or the text of a bundle's preliminary points.

    Parameters
    ----------
    what : {"cameras", "photos", "points"}
    bundle, run : str
        The adjustment that the update took its values from.
    """

    what: Literal["cameras", "photos", "points"]
    bundle: str
    run: str
    records: tuple[RecordBefore, ...] = ()
    text: TextBefore | None = None
