"""Digitised fiducial marks, taken from plate coordinates to the fiducial system."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from orip.geometry.plane import PlaneTransformation
from orip.model.camera import Mark
from orip.model.measurement import MeasuredMarks

FloatArray = NDArray[np.float64]


def fiducials_from_plate(marks: MeasuredMarks, arrangement: Literal["corners", "midsides"]) -> tuple[Mark, ...]:
    """Return fiducial marks with the origin at their mean and the x axis nearest to the plate's x direction.

    Parameters
    ----------
    marks : MeasuredMarks
        Four marks that are not disregarded, plate mm.
    arrangement : {"corners", "midsides"}
        Midsides: the x axis goes through the two marks nearest to the plate's x direction. Corners: through the middles
        of the left and the right side.

    Raises
    ------
    ValueError
        Unless there are exactly four marks around their mean.

    Notes
    -----
    The rule of ORIPROGRAM (Dueholm 1989, menu 1.4.1.1); for corners the middle of the sides is this program's reading.
    """
    used = ~marks.disregarded
    plate = marks.measured[used]
    if len(plate) != 4:
        message = f"{len(plate)} marks; exactly four are needed, one in each corner or in the middle of each side"
        raise ValueError(message)
    centred = plate - plate.mean(axis=0)
    left, right = _ends_of_x_axis(centred, arrangement)
    direction = right - left
    cosine, sine = direction / np.hypot(*direction)
    turn = PlaneTransformation(np.array([[cosine, sine], [-sine, cosine]]), np.zeros(2))
    names = [name for name, use in zip(marks.names, used, strict=True) if use]
    return tuple(Mark(name, float(x), float(y)) for name, (x, y) in zip(names, turn.apply(centred), strict=True))


def _ends_of_x_axis(centred: FloatArray, arrangement: str) -> tuple[FloatArray, FloatArray]:
    by_x = centred[np.argsort(centred[:, 0], kind="stable")]
    if arrangement == "midsides":
        return by_x[0], by_x[3]
    return by_x[:2].mean(axis=0), by_x[2:].mean(axis=0)
