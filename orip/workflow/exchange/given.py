"""Control and observed positions of photos as another program has them: in the frame of the exported result."""

from __future__ import annotations

import numpy as np

from orip.arrays import FloatArray
from orip.exchange.names_table import NamesTable
from orip.geometry.ground_frame import GroundFrame
from orip.records.names import record_key
from orip.records.observations.control import ControlPoint
from orip.records.observations.station import NOT_GIVEN, Station, StationReference
from orip.structs import replace
from orip.wording import counted
from orip.workflow.project.bundle_state import BundleState


def given_control(
    bundle: BundleState, names: NamesTable, frame: GroundFrame | None, height: float
) -> tuple[ControlPoint, ...]:
    """Return the control points of a project.

    Parameters
    ----------
    bundle : BundleState
    names : NamesTable
    frame : GroundFrame or None
        None: coordinates stay those of the project. Else X and Y of a point without one of them are left out.
    height : float
        Of the project, at which points without a height are taken to the frame.
    """
    points = [
        replace(point, name=names.original_mark(point.name))
        for point in bundle.state.texts.control.value.points
        if frame is None or None not in point.coordinates[:2]
    ]
    if frame is None or not points:
        return tuple(points)
    places = [[height if value is None else value for value in point.coordinates] for point in points]
    return tuple(
        replace(point, coordinates=(x, y, None if point.coordinates[2] is None else z))
        for point, (x, y, z) in zip(points, frame.to_local(np.array(places)).tolist(), strict=True)
    )


def given_stations(
    bundle: BundleState, names: NamesTable, frame: GroundFrame | None
) -> tuple[tuple[Station, ...], StationReference, tuple[str, ...]]:
    """Return the observed positions of photos, what they refer to, and sentences about what is left out.

    Those in another system than the project's are left out, as are angles where the frame is not the project's system.
    """
    control = bundle.state.texts.control.value
    reference = control.station_reference
    given = [station for station in control.stations if station.has_position]
    if reference.crs and given:
        notes = (f"{counted(len(given), 'observed position')} of photos in {reference.crs} left out.",)
        return (), StationReference(), notes
    stations = [replace(one, photo=names.photos.get(record_key(one.photo), one.photo)) for one in given]
    if frame is None or not stations:
        return tuple(stations), StationReference(navigation=reference.navigation), ()
    places: FloatArray = frame.to_local(np.array([station.position for station in stations]))
    moved = [
        replace(station, position=(x, y, z), angles=NOT_GIVEN, angle_error=NOT_GIVEN, covariance=None)
        for station, (x, y, z) in zip(stations, places.tolist(), strict=True)
    ]
    return tuple(moved), StationReference(), ()
