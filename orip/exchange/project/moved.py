"""An imported block moved to its control points, and what is said of that."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray, rows_of_groups
from orip.errors import InputError
from orip.exchange.conversion.cameras import ConvertedCamera, directions_of_pixels
from orip.exchange.conversion.control_datum import ControlDatum, ControlRays, ObservedCentres, control_datum
from orip.exchange.conversion.ground import LocalGround, local_ground_at, said_of_ground
from orip.exchange.conversion.reprojection import Reprojection
from orip.geometry.ground_frame import GroundFrame, ground_frame
from orip.records.exchanged import ExchangedProject
from orip.structs import replace


def datum_of_control(
    project: ExchangedProject, cameras: Sequence[ConvertedCamera], pixels: FloatArray, found: Reprojection
) -> ControlDatum | None:
    """Return how the block has to be moved to its control; None where it may stay, or where that is not known.

    Parameters
    ----------
    project : ExchangedProject
        With control and stations in its own system.
    pixels : array (k, 2)
        Of the rays, as orip counts them.
    """
    if project.control_crs or not project.control:
        return None
    rays = _control_rays(project, cameras, pixels, found)
    centres = found.centres[np.isfinite(found.centres).all(axis=1)]
    known = project.points.coordinates[np.isfinite(project.points.coordinates).all(axis=1)]
    if not len(centres) or not len(known):
        return None
    distance = float(np.median(np.linalg.norm(known - np.median(centres, axis=0), axis=1)))
    return control_datum(rays, _observed_centres(project, found), distance)


def _control_rays(
    project: ExchangedProject, cameras: Sequence[ConvertedCamera], pixels: FloatArray, found: Reprojection
) -> ControlRays:
    """Return the rays to points with three known coordinates that are not check points."""
    full = {
        point.name: point.coordinates
        for point in project.control
        if None not in point.coordinates and not any(error is not None and error < 0.0 for error in point.errors)
    }
    targets = np.full((len(project.points.names), 3), np.nan)
    for name, place in project.points.marks.items():
        if name in full:
            targets[place] = full[name]
    rays = project.rays
    rows = np.flatnonzero(np.isfinite(targets[rays.point]).all(axis=1) & rays.is_active)
    tangents = np.full((len(rows), 2), np.nan)
    camera_of_ray = np.array([photo.camera for photo in project.photos], dtype=np.int64)[rays.photo[rows]]
    for converted, own in zip(cameras, rows_of_groups(camera_of_ray, len(cameras)), strict=True):
        if own.size:
            tangents[own] = directions_of_pixels(converted.camera, pixels[rows[own]])
    vectors = np.column_stack([tangents, np.full(len(rows), -1.0)])
    ground = np.einsum("nij,nj->ni", found.rotations[rays.photo[rows]], vectors)
    sound = np.isfinite(ground).all(axis=1) & np.isfinite(found.centres[rays.photo[rows]]).all(axis=1)
    rows, ground = rows[sound], ground[sound]
    return ControlRays(
        found.centres[rays.photo[rows]],
        ground / np.linalg.norm(ground, axis=1, keepdims=True),
        np.unique(rays.point[rows], return_inverse=True)[1].astype(np.int64),
        targets[rays.point[rows]],
    )


def _observed_centres(project: ExchangedProject, found: Reprojection) -> ObservedCentres:
    """Return the projection centres with an observed position that has weight."""
    place = {photo.name: row for row, photo in enumerate(project.photos)}
    used = [
        station
        for station in project.stations
        if not project.station_reference.crs
        and station.has_position
        and min(station.position_error) > 0.0
        and station.photo in place
        and np.isfinite(found.centres[place[station.photo]]).all()
    ]
    return ObservedCentres(
        found.centres[[place[station.photo] for station in used]].reshape(-1, 3),
        np.array([station.position for station in used], dtype=np.float64).reshape(-1, 3),
        np.array([station.position_error for station in used], dtype=np.float64).reshape(-1, 3),
    )


class GroundOfControl(Struct, frozen=True):
    """A system of east, north and up in the middle of control points, and the way from there to where they are given.

    Parameters
    ----------
    local : array (n, 3)
        Control points with X and Y in that system; NaN for those without a height.
    crs : str
        The system of the project: that of the control points; empty: the local one.
    frame : GroundFrame or None
        Of `crs`.
    ground : LocalGround or None
        Where control points are in longitude and latitude.
    """

    local: FloatArray
    crs: str
    frame: GroundFrame | None
    ground: LocalGround | None


def placed_at_control(
    project: ExchangedProject, cameras: Sequence[ConvertedCamera], pixels: FloatArray, found: Reprojection
) -> tuple[ExchangedProject, Reprojection, ControlDatum | None, list[str]]:
    """Return a block that had a frame and scale of its own in the system of its control points.

    Where the control points do not tell how it lies in theirs, photos and points stay as they are.
    """
    there = _ground_of_control(project)
    if there is None:
        return project, found, None, []
    local = tuple(
        replace(point, coordinates=(x, y, None if point.coordinates[2] is None else z))
        for point, (x, y, z) in zip(project.control, there.local.tolist(), strict=True)
    )
    own = replace(project, control=local, control_crs="", stations=())
    datum, left_out = _robust_datum(own, cameras, pixels, found)
    if datum is None:
        said = (
            "The reconstruction has a frame and scale of its own, and no three control points tell how it lies in "
            "their system: it stays as it is."
        )
        return project, found, None, [said]
    lost = ["Positions of the photos are in a frame that no file describes: left out."] if project.stations else []
    result = replace(
        own,
        control=project.control if there.crs else local,
        crs=there.crs or None,
        ground_unit="m",
        notes=(
            *project.notes,
            *lost,
            *([] if there.ground is None else said_of_ground(there.ground, project.control_crs)),
        ),
    )
    result, moved = moved_block(result, found, datum)
    if there.frame is not None:
        centres = there.frame.to_project(moved.centres)
        moved = replace(moved, centres=centres, rotations=there.frame.axes_at(centres) @ moved.rotations)
        result = replace(
            result, points=replace(result.points, coordinates=there.frame.to_project(result.points.coordinates))
        )
    named = project.control_named or "the control points"
    said = (
        f"The reconstruction has a frame and scale of its own: it was placed by its control points in the system of "
        f"{named}{f' ({there.crs})' if there.crs else ''}, scaled by {datum.similarity.scale:.4g}; the rays to them "
        f"are {_degrees(datum.misfit_after)} off (RMS)."
    )
    without = [f"Control point {left_out} does not fit the others and had no part in that."] if left_out else []
    return result, moved, datum, [said, *without]


def _ground_of_control(project: ExchangedProject) -> GroundOfControl | None:
    """Return the ground of control points in a known system; None where there are none."""
    given = np.array(
        [[np.nan if value is None else value for value in point.coordinates] for point in project.control]
    ).reshape(-1, 3)
    full = given[np.isfinite(given).all(axis=1)]
    if not len(full):
        return None
    middle = np.median(full, axis=0)
    with contextlib.suppress(InputError):  # no map projection, or in another unit
        frame = ground_frame(project.control_crs, "m", middle)
        return GroundOfControl(frame.to_local(given), project.control_crs, frame, None)
    ground = local_ground_at(middle, project.control_crs)
    return GroundOfControl(
        ground.from_crs(np.where(np.isfinite(given), given, middle), project.control_crs), "", None, ground
    )


def _robust_datum(
    project: ExchangedProject, cameras: Sequence[ConvertedCamera], pixels: FloatArray, found: Reprojection
) -> tuple[ControlDatum | None, str]:
    """Return the datum of all control points, else the best one of all but one, whose name follows."""
    if not _has_plane(project):
        return None, ""
    whole = datum_of_control(project, cameras, pixels, found)
    if whole is not None or len(project.control) > _MOST_LEFT_OUT:
        return whole, ""
    tried = []
    for point in project.control:
        control = tuple(other for other in project.control if other is not point)
        others = replace(project, control=control)
        datum = datum_of_control(others, cameras, pixels, found) if _has_plane(others) else None
        if datum is not None:
            tried.append((datum.misfit_after, point.name, datum))
    if not tried:
        return None, ""
    _, name, datum = min(tried, key=lambda one: one[0])
    return datum, name


def _has_plane(project: ExchangedProject) -> bool:
    """Return whether measured control points are three and not on one line: else a rotation about it stays free."""
    measured = {project.points.names[row] for row in np.unique(project.rays.point[project.rays.is_active]).tolist()}
    places = np.array(
        [one.coordinates for one in project.control if one.name in measured and None not in one.coordinates],
        dtype=np.float64,
    ).reshape(-1, 3)
    if len(places) < 3:
        return False
    along, across, _ = np.linalg.svd(places - places.mean(axis=0), compute_uv=False)
    return bool(across > _LEAST_BREADTH * along)


_LEAST_BREADTH = 0.02
"""Of control points beside their line, in its length."""

_MOST_LEFT_OUT = 50
"""Control points of which each one is left out in turn."""


def moved_block(
    project: ExchangedProject, found: Reprojection, datum: ControlDatum
) -> tuple[ExchangedProject, Reprojection]:
    """Return a project whose points, and the reprojection whose photos, are in the system of the control points."""
    similarity = datum.similarity
    points = replace(project.points, coordinates=similarity.apply(project.points.coordinates))
    return (
        replace(project, points=points),
        replace(found, rotations=similarity.rotation @ found.rotations, centres=similarity.apply(found.centres)),
    )


def said_of_datum(datum: ControlDatum, unit: str) -> list[str]:
    """Return sentences about how the block was moved, and about heights in two systems."""
    before, after, turned = (_degrees(angle) for angle in (datum.misfit_before, datum.misfit_after, datum.turned))
    moved = (
        f"The block was not where its control points are: the rays to them were {before} off (RMS). Photos and points "
        f"were moved by {datum.moved:.3g} {unit} (median), turned by {turned} and scaled by "
        f"{datum.similarity.scale:.4g}; {after} remain."
    )
    if not datum.height_step:
        return [moved]
    way = "higher" if datum.height_step > 0.0 else "lower"
    return [
        moved,
        (
            f"The observed positions of the photos are {abs(datum.height_step):.3g} {unit} {way} than the control "
            f"points say (standard deviation {datum.height_step_sd:.2g} {unit}); apart from that they agree: the "
            "heights refer to different zero levels (ellipsoid, geoid, take-off point, phone GPS). The control points "
            "count; the common error of the positions is an unknown, [[antenna]] in orip.toml. If the heights of the "
            "control points are the wrong ones, correct them in the source and import it again."
        ),
    ]


def _degrees(angle: float) -> str:
    return f"{np.degrees(angle):.2g}°"
