"""Variance components: the factor by which the a-priori errors of each group of observations have to be multiplied."""

from __future__ import annotations

from typing import Literal

from msgspec import Struct

VarianceGroupKind = Literal["photo", "control", "element", "distance", "direction", "station", "attitude"]

_ELEMENTS = {
    "CAMERA": "observed camera parameters",
    "POINT": "observed point coordinates",
    "THEODOLITE": "observed zero directions",
}


class VarianceComponent(Struct, frozen=True):
    """The a-priori error of a group of observations as the adjustment estimates it.

    Parameters
    ----------
    kind : VarianceGroupKind
    of : str
        The camera of photo points; PHOTO, CAMERA, POINT or THEODOLITE of elements; else empty.
    component : str
        ``xy`` of photo points, ``XY`` or ``Z`` of control points, ``X0 Y0 Z0`` or ``OMEGA PHI KAPPA`` of elements of
        photos, ``direction`` or ``zenith``; else empty.
    number : int
        Observations that the estimate is based on: in use, and with weight factor 1.
    redundancy : float
        Sum of their redundancy numbers.
    factor, sd : float
        Estimated error over given a-priori error, and its standard deviation. NaN where the group has too little
        redundancy, or cannot be told from another one: its a-priori errors stay as they are.
    p : float
        Two-sided probability of a factor as far from 1 by chance if the given errors are right; NaN likewise.
    """

    kind: VarianceGroupKind
    of: str
    component: str
    number: int
    redundancy: float
    factor: float
    sd: float
    p: float

    @property
    def name(self) -> str:
        """Return what the group is called: ``photo points of camera CAM``, ``Z of the control points``."""
        match self.kind:
            case "photo":
                return f"photo points of camera {self.of}"
            case "control":
                return f"{', '.join(self.component)} of the control points"
            case "element" if self.of == "PHOTO":
                return "exposure stations" if self.component.startswith("X0") else "rotations of the photos"
            case "element":
                return _ELEMENTS[self.of]
            case "station":
                return "exposure stations"
            case "attitude":
                return "attitudes of the exposure stations"
            case "distance":
                return "distances"
            case "direction":
                return "zenith angles" if self.component == "zenith" else "directions"
