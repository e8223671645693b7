"""The kinds of observation: their names, the units of their components, and points that are measured more than once."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final, Literal

import numpy as np
from msgspec import Struct

from orip.arrays import BoolArray, IntArray
from orip.records.camera import CAMERA_UNITS
from orip.records.coded_names import CodedNames, coded
from orip.records.definition import ANTENNA_UNITS, RATES
from orip.records.figures import FIGURE_LENGTHS, FIGURE_TILTS
from orip.records.measurement import PhotoObservations
from orip.records.names import places_of_names, record_key
from orip.records.photo import PHOTO_PARAMETERS
from orip.records.rig import OFFSET

# Stores, residuals.csv and result.json name a kind by `ObservationKind.name`; listings, the report and messages take
# label and unit from here. The equations of a kind are in its module of `orip.bundle.kinds`. A new kind is a line here
# and a module there.


ObservedIn = Literal["mm", "ground unit", "degrees", "pure number", "unit of the unknown"]

GROUND_UNKNOWNS: Final = frozenset({*PHOTO_PARAMETERS[:3], *OFFSET, "X", "Y", "Z", *FIGURE_LENGTHS})
"""Unknowns in the ground unit: projection centres, offsets on rigs, points and lengths of figures."""

ANGULAR_UNKNOWNS: Final = frozenset({*PHOTO_PARAMETERS[3:], "R", *FIGURE_TILTS})
"""Unknowns in degrees: rotations of photos, zero directions of theodolite sets and tilts of figures."""


class ObservationKind(Struct, frozen=True):
    """A kind of observation.

    Parameters
    ----------
    name : str
        As it is stored.
    label : str
        As it is written before the name of an observation.
    observed_in : str
        Its unit, or how the unit follows.
    """

    name: str
    label: str
    observed_in: ObservedIn

    def unit(self, component: str, ground_unit: str) -> str:
        """Return the unit of an observation component of this kind; empty for a pure number.

        Parameters
        ----------
        component : str
            As in residuals.csv, e.g. ``x``, ``Z0``, ``EBNER.1``.
        ground_unit : str
            The project's.
        """
        match self.observed_in:
            case "ground unit":
                return ground_unit
            case "pure number":
                return ""
            case "unit of the unknown":
                return unit_of_unknown(component, ground_unit)
            case "mm" | "degrees":
                return self.observed_in


_ALL: list[ObservationKind] = []


def _listed(name: str, label: str, observed_in: ObservedIn) -> ObservationKind:
    _ALL.append(ObservationKind(name, label, observed_in))
    return _ALL[-1]


PHOTO_POINT: Final = _listed("photo", "photo point", "mm")
CONTROL_POINT: Final = _listed("control", "control point", "ground unit")
ADDITIONAL_PARAMETER: Final = _listed("additional", "additional parameter", "pure number")
ELEMENT: Final = _listed("element", "element", "unit of the unknown")
CONSTANT_ELEMENT: Final = _listed("constant element", "constant element", "unit of the unknown")
DISTANCE: Final = _listed("distance", "distance", "ground unit")
CONSTANT_DISTANCE: Final = _listed("constant distance", "constant distance", "ground unit")
DIRECTION: Final = _listed("direction", "direction", "degrees")
LINE: Final = _listed("line", "point on a line", "ground unit")
PLANE: Final = _listed("plane", "point on a plane", "ground unit")
CYLINDER: Final = _listed("cylinder", "point on a cylinder", "ground unit")
HEIGHT: Final = _listed("height", "equal height", "ground unit")
GIVEN_DIRECTION: Final = _listed("given direction", "given direction", "degrees")
TERRAIN: Final = _listed("terrain", "height on terrain", "ground unit")
STATION: Final = _listed("station", "station", "ground unit")
ATTITUDE: Final = _listed("attitude", "attitude", "degrees")
CONSTANT_STATION: Final = _listed("constant station", "constant station", "ground unit")
CONSTANT_ATTITUDE: Final = _listed("constant attitude", "constant attitude", "degrees")
DIFFERENCE: Final = _listed("difference", "station difference", "unit of the unknown")
ANTENNA_PARAMETER: Final = _listed("antenna", "antenna parameter", "unit of the unknown")
MOTION: Final = _listed("motion", "motion", "unit of the unknown")
MOUNTING: Final = _listed("mounting", "mounting of camera", "unit of the unknown")

OBSERVATION_KINDS: Final[Mapping[str, ObservationKind]] = MappingProxyType({kind.name: kind for kind in _ALL})
"""All kinds by name, in the order of their lines above, in which residuals are listed."""


def unit_of_observation(kind: str, component: str, ground_unit: str) -> str:
    """Return the unit of an observation component by the name of its kind; see `ObservationKind.unit`."""
    return OBSERVATION_KINDS[kind].unit(component, ground_unit)


def unit_of_unknown(unknown: str, ground_unit: str) -> str:
    """Return the unit of an unknown such as ``C``, ``A3``, ``Z0``, ``KAPPA``, ``X``, ``R``; empty for a pure number."""
    if unknown in GROUND_UNKNOWNS:
        return ground_unit
    if unknown in ANGULAR_UNKNOWNS:
        return "degrees"
    if unknown in RATES:
        return "degrees/s"
    if unknown in ANTENNA_UNITS:  # velocities of photos are called as drifts are
        return ANTENNA_UNITS[unknown].format(ground=ground_unit)
    return CAMERA_UNITS.get(unknown, "")


def measured_before(photo: IntArray, point: IntArray) -> IntArray:
    """Return how often the point of each of n measurements was measured in that photo before.

    Parameters
    ----------
    photo, point : arrays (n,) of int
        Numbers from 0.

    Returns
    -------
    array (n,) of int
        0 for the first measurement.
    """
    both = photo * (point.max(initial=0) + 1) + point
    # mostly measured in this order, in which a stable sort leaves what is there; without places it is quicker
    ordered = np.sort(both, kind="stable")
    if (ordered[1:] != ordered[:-1]).all():
        return np.zeros(len(both), dtype=np.int64)
    order = np.argsort(both, kind="stable")
    first = np.flatnonzero(np.diff(both[order], prepend=-1))
    before = np.empty(len(both), dtype=np.int64)
    before[order] = np.arange(len(both)) - np.repeat(first, np.diff(np.append(first, len(both))))
    return before


def observed_before(observations: PhotoObservations) -> IntArray:
    """Return how often each of n photo observations was measured before, as `measured_before`; photos by their keys."""
    number: dict[str, int] = {}
    photo = coded(observations.photos).numbers(lambda name: number.setdefault(record_key(name), len(number)))
    return measured_before(photo, coded(observations.points).codes.astype(np.int64))


def measurement_name(point: str, before: int) -> str:
    """Return what a measurement of a point is called: ``17``, and ``17 (2)`` for the second one in its photo.

    Names of points have no blanks, so no point is called so.
    """
    return f"{point} ({before + 1})" if before else point


def point_of_measurement(name: str) -> str:
    """Return the point that a measurement of `measurement_name` is of; any other name as it is."""
    if not name.endswith(")"):
        return name
    point, _, number = name.rpartition(" (")
    return point if point and number.removesuffix(")").isdigit() else name


def places_of_measured(measured: CodedNames, points: tuple[str, ...]) -> IntArray:
    """Return the place among points of each different name (m,) of measurements; -1 where it has none."""
    place = CodedNames(measured.distinct, np.arange(len(measured.distinct))).places_among(points)
    for other in np.flatnonzero(place < 0).tolist():  # measured twice in a photo, or no point
        place[other] = places_of_names(points).get(point_of_measurement(measured.distinct[other]), -1)
    return place


def photos_per_point(photo: IntArray, point: IntArray, chosen: BoolArray, points: int) -> IntArray:
    """Return in how many photos each point (points,) is measured by the chosen ones of n photo points."""
    if not chosen.all():
        photo, point = photo[chosen], point[chosen]
    before = measured_before(photo, point)
    return np.bincount(point[before == 0] if before.any() else point, minlength=points)


_GROUP_OF_ELEMENTS = {"X": "point", "Y": "point", "Z": "point", "R": "theodolite set"}
"""What an element belongs to by its component; photos have their own column, all others are of cameras."""


def named_observation(kind: str, photo: str, point: str, component: str = "") -> str:
    """Return what an observation of a kind is called; a given element by its component: ``Z0 of photo 101``."""
    if kind == "photo":
        return f"photo {photo} point {point}"
    if kind in {ELEMENT.name, CONSTANT_ELEMENT.name}:
        group = "photo" if photo else _GROUP_OF_ELEMENTS.get(component, "camera")
        return f"{component} of {group} {photo or point}".strip()
    return " ".join(part for part in (OBSERVATION_KINDS[kind].label, photo, point) if part)
