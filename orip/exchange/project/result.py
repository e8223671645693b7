"""The result of an adjustment in the conventions of another program."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray
from orip.errors import InputError
from orip.exchange.conversion.cameras import ExportedCamera, export_camera
from orip.exchange.conversion.image_axes import UnsuitableCameraError
from orip.exchange.conversion.poses import exchanged_poses
from orip.exchange.conversion.result_figures import error_ellipses, footprint, rotation_vector_covariances
from orip.exchange.format import Conventions
from orip.exchange.project.given import cameras_with_frames, given_control, given_stations, measured_pixels
from orip.exchange.project.rigs import exchanged_exposures, exchanged_rigs
from orip.exchange.sources.names import NamesTable
from orip.geometry.ground_frame import GroundFrame, ground_frame
from orip.geometry.rotation import axes_rotation_from_angle_rates, rotation_from_angles
from orip.records.camera import CAMERA_PARAMETERS, Camera
from orip.records.coded_names import coded
from orip.records.exchanged import ExchangedCamera, ExchangedPhoto, ExchangedPoints, ExchangedProject, ExchangedRays
from orip.records.names import record_key
from orip.records.observation_kinds import PHOTO_POINT
from orip.records.results.solution import Solution
from orip.structs import replace
from orip.units import RADIANS_PER_DEGREE
from orip.wording import agreeing, counted, counted_names
from orip.workflow.project.bundle_state import BundleState

_READOUT = CAMERA_PARAMETERS.index("READOUT")

_LARGE_MISFIT_PX = 0.001
"""Differences of a camera that are worth a note."""


class _Adjusted(Struct, frozen=True):
    """A solution with what it refers to.

    Parameters
    ----------
    cameras : mapping of record_key to Camera
        With adjusted values.
    camera_of_photo : mapping of record_key to record_key
    """

    solution: Solution
    cameras: Mapping[str, Camera]
    camera_of_photo: Mapping[str, str]


def exchanged_result(
    bundle: BundleState, names: NamesTable, conventions: Conventions, *, corrects_distortion: bool = False
) -> ExchangedProject:
    """Return the last solution of a bundle as another program has it; its notes say what is lost.

    Parameters
    ----------
    bundle : BundleState
        With definitions, observations and solutions.
    corrects_distortion : bool
        Measurements are corrected for what the cameras of the format do not hold.

    Raises
    ------
    InputError
        If the bundle has not been adjusted, or the project no longer has one of its photos.
    UnsuitableCameraError
        If a camera has no sensor, or the format has none that comes near enough.
    """
    adjusted = _adjusted(bundle, with_film=conventions.lens is not None and conventions.lens_axes.unit == "mm")
    exported = _cameras(adjusted, names, conventions, accepts_any_fit=corrects_distortion)
    notes = [
        *_notes_on_cameras(exported, conventions, corrects_distortion=corrects_distortion),
        *_notes_on_staleness(bundle),
        *_notes_on_readouts(adjusted, conventions),
    ]
    frame = _local_frame(bundle, adjusted.solution) if conventions.is_cartesian else None
    if frame is not None:
        place = ", ".join(f"{value:.3f}" for value in frame.origin)
        notes.append(f"Coordinates are east, north and up at {place} of {bundle.project.definition.crs}.")
    rays, left_out = _rays(bundle, adjusted, exported, conventions, corrects_distortion=corrects_distortion)
    if left_out:
        notes.append(f"{counted(left_out, 'measurement')} left out, as photo or point was not adjusted.")
    definition = bundle.project.definition
    photos = _photos(adjusted, names, list(exported), conventions, frame)
    if conventions.is_drawn:
        photos = _with_footprints(photos, adjusted, rays)
    heights = adjusted.solution.points.values[:, 2]
    stations, reference, lost = given_stations(bundle, names, frame)
    return ExchangedProject(
        definition.name,
        tuple(
            one.about_principal_point() if conventions.counts_from_principal_point else one.camera
            for one in exported.values()
        ),
        photos,
        _points(bundle, adjusted, names, frame),
        rays,
        (conventions.reading,),
        control=given_control(bundle, names, frame, float(np.median(heights)) if len(heights) else 0.0),
        stations=stations,
        station_reference=reference,
        crs=definition.crs if frame is None else None,
        ground_unit=definition.ground_unit,
        rigs=exchanged_rigs(adjusted.solution, definition.rigs, list(exported), conventions.reading),
        exposures=exchanged_exposures(adjusted.solution, definition.rigs),
        notes=(*notes, *lost),
    )


def _adjusted(bundle: BundleState, *, with_film: bool) -> _Adjusted:
    """Return the solution of a bundle; with film, cameras without a sensor have a frame in its place.

    Raises
    ------
    InputError
        If one of its photos has since been deleted or renamed, or has a camera that is not defined.
    """
    solution = bundle.adjusted
    records = bundle.records
    gone = [name for name in solution.photos.names if record_key(name) not in records.photos]
    if gone:
        message = (
            f"the last adjustment has {counted_names('photo', gone)}, which the project does not have any more; "
            "adjust again with 'orip solve', then repeat the command"
        )
        raise InputError.single(message)
    of_photo = {record_key(name): record_key(records.photos[record_key(name)].camera) for name in solution.photos.names}
    undefined = sorted(
        {records.photos[key].camera for key, camera in of_photo.items() if camera not in records.cameras}
    )
    if undefined:
        message = (
            f"{counted_names('camera', undefined)} of the adjusted photos {agreeing(len(undefined), 'is', 'are')} not "
            "defined; add what is missing, or load a dump that goes with the other stores"
        )
        raise InputError.single(message)
    values = dict(zip(map(record_key, solution.cameras.names), solution.cameras.values.tolist(), strict=True))
    cameras = {
        key: replace(records.cameras[key], parameters=tuple(values.get(key, records.cameras[key].parameters)))
        for key in dict.fromkeys(of_photo.values())
    }
    return _Adjusted(solution, cameras_with_frames(bundle, cameras, of_photo) if with_film else cameras, of_photo)


def _cameras(
    adjusted: _Adjusted, names: NamesTable, conventions: Conventions, *, accepts_any_fit: bool
) -> dict[str, ExportedCamera]:
    found = {}
    for key, camera in adjusted.cameras.items():
        name = names.cameras.get(key, camera.name)
        is_fisheye = camera.projection == "equidistant" and conventions.fisheye_lens is not None
        lens = conventions.fisheye_lens if is_fisheye else conventions.lens
        if lens is None:
            found[key] = ExportedCamera(camera, ExchangedCamera(name, 0, 0, "unsupported", {}))
        else:
            found[key] = export_camera(
                camera,
                name,
                lens,
                conventions.lens_axes,
                conventions.ray_axes,
                terms=conventions.fisheye_terms if is_fisheye else conventions.terms,
                accepts_any_fit=accepts_any_fit,
            )
    return found


def _notes_on_cameras(
    exported: Mapping[str, ExportedCamera], conventions: Conventions, *, corrects_distortion: bool
) -> list[str]:
    done = "; measurements are corrected for that" if corrects_distortion else ""
    found = [
        f"Camera {one.camera.name} is fitted to the model of the format: it differs by up to {one.worst_px:.3f} px"
        f"{done}."
        for one in exported.values()
        if one.worst_px > _LARGE_MISFIT_PX
    ]
    moved = [one.camera.name for one in exported.values() if one.principal_point.any()]
    if conventions.counts_from_principal_point and moved:
        found.append(
            f"The format has no principal point: measurements of {counted_names('camera', moved)} count from it."
        )
    return found


def _notes_on_readouts(adjusted: _Adjusted, conventions: Conventions) -> list[str]:
    found = [camera.name for camera in adjusted.cameras.values() if camera.parameters[_READOUT]]
    if conventions.lens is None or not found:
        return []
    return [
        f"The format has no readout time: photos of {counted_names('camera', found)} are oriented as their middle row."
    ]


def _notes_on_staleness(bundle: BundleState) -> list[str]:
    status = bundle.adjusted.status
    if status == "not_determined":
        return ["The observations do not determine the block."]
    return [] if status in {"converged", "doubtful"} else [f"The adjustment has not converged ({status})."]


def _local_frame(bundle: BundleState, solution: Solution) -> GroundFrame | None:
    definition = bundle.project.definition
    if definition.crs is None:
        return None
    places = solution.points.values if len(solution.points.values) else solution.photos.values[:, :3]
    return ground_frame(definition.crs, definition.ground_unit, np.median(places, axis=0))


def _photos(
    adjusted: _Adjusted, names: NamesTable, cameras: Sequence[str], conventions: Conventions, frame: GroundFrame | None
) -> tuple[ExchangedPhoto, ...]:
    solution = adjusted.solution
    centres = solution.photos.values[:, :3]
    rotations = rotation_from_angles(solution.photos.values[:, 3:] * RADIANS_PER_DEGREE)
    if frame is not None:
        rotations = np.swapaxes(frame.axes_at(centres), -1, -2) @ rotations
        centres = frame.to_local(centres)
    numbers, positions = exchanged_poses(rotations, centres, conventions.reading)
    poses = _pose_covariances(solution, rotations, frame, conventions)
    covariances = poses[:, 3:, 3:]
    found = []
    for row, name in enumerate(solution.photos.names):
        key = record_key(name)
        deviation = solution.photos.sd[row, :3]
        angles = solution.photos.sd[row, 3:]
        is_of_angles = not solution.photo_rotation_sd_about_axes[row] and frame is None
        found.append(
            ExchangedPhoto(
                names.photos.get(key, name),
                cameras.index(adjusted.camera_of_photo[key]),
                tuple(numbers[row].tolist()),
                tuple(positions[row].tolist()),
                _if_known(deviation),
                _known_matrix(covariances[row]),
                _known_matrix(poses[row]),
                _if_known(angles) if is_of_angles else None,
            )
        )
    return tuple(found)


def _known_matrix(covariance: FloatArray) -> tuple[float, ...] | None:
    return tuple(covariance.ravel().tolist()) if np.isfinite(covariance).all() else None


def _pose_covariances(
    solution: Solution, rotations: FloatArray, frame: GroundFrame | None, conventions: Conventions
) -> FloatArray:
    """Return the covariances (n, 6, 6) of rotation vectors and projection centres; NaN where they are not known."""
    angles = solution.photos.values[:, 3:] * RADIANS_PER_DEGREE
    sd = solution.photos.sd * ([1.0] * 3 + [RADIANS_PER_DEGREE] * 3)
    turn = np.broadcast_to(np.eye(3), (len(sd), 3, 3))
    if frame is not None:
        turn = np.swapaxes(frame.axes_at(solution.photos.values[:, :3]), -1, -2)
    about_axes = np.array(solution.photo_rotation_sd_about_axes, dtype=np.bool_)
    by_axes = np.where(about_axes[:, None, None], np.eye(3), axes_rotation_from_angle_rates(angles))
    given = _covariances(sd, solution.photo_correlations)
    return rotation_vector_covariances(rotations, given, turn @ by_axes, turn, conventions.reading)


def _if_known(deviations: FloatArray) -> tuple[float, float, float] | None:
    x, y, z = deviations.tolist()
    return (x, y, z) if np.isfinite(deviations).all() else None


def _with_footprints(
    photos: Sequence[ExchangedPhoto], adjusted: _Adjusted, rays: ExchangedRays
) -> tuple[ExchangedPhoto, ...]:
    """Return photos with the corners of what they show of a level ground, at the height of what they see of it."""
    solution = adjusted.solution
    rotations = rotation_from_angles(solution.photos.values[:, 3:] * RADIANS_PER_DEGREE)
    heights = solution.points.values[:, 2]
    order = np.argsort(rays.photo, kind="stable")
    of_photo = np.split(rays.point[order], np.searchsorted(rays.photo[order], np.arange(1, len(photos))))
    found = []
    for number, photo in enumerate(photos):
        camera = adjusted.cameras[adjusted.camera_of_photo[record_key(solution.photos.names[number])]]
        seen = heights[of_photo[number]]
        corners = (
            footprint(camera, rotations[number], solution.photos.values[number, :3], float(np.median(seen)))
            if len(seen) and camera.sensor is not None
            else None
        )
        found.append(photo if corners is None else replace(photo, footprint=tuple(map(tuple, corners.tolist()))))
    return tuple(found)


def _points(bundle: BundleState, adjusted: _Adjusted, names: NamesTable, frame: GroundFrame | None) -> ExchangedPoints:
    solution = adjusted.solution
    control = {point.name for point in bundle.control.points}
    original = [
        (names.original_mark(name), False) if name in control else names.original_point(name)
        for name in solution.points.names
    ]
    covariance = _covariances(solution.points.sd, solution.point_correlations)
    return ExchangedPoints(
        tuple(name for name, _ in original),
        solution.points.values if frame is None else frame.to_local(solution.points.values),
        np.array([is_track for _, is_track in original], dtype=np.bool_),
        covariance,
        error_ellipses(covariance),
        _residual_lengths(adjusted),
    )


def _covariances(sd: FloatArray, correlations: FloatArray) -> FloatArray:
    """Return the covariances (m, k, k) of k values, NaN where one of the two has no standard deviation.

    Correlations (m, k (k - 1) / 2) are the lower triangle, row by row; without rows there are none.
    """
    deviations = np.where(np.isfinite(sd), sd, np.nan)
    size = deviations.shape[1]
    correlation = np.broadcast_to(np.eye(size), (len(deviations), size, size)).copy()
    if len(correlations):
        i, j = np.tril_indices(size, -1)
        correlation[:, i, j] = correlation[:, j, i] = correlations
    covariance: FloatArray = deviations[:, :, None] * correlation * deviations[:, None, :]
    return covariance


def _residual_lengths(adjusted: _Adjusted) -> FloatArray:
    """Return the mean lengths (m,) of the residuals of points, pixels; NaN where there are none."""
    found = adjusted.solution.residuals
    size = {key: _pixel_size(camera) for key, camera in adjusted.cameras.items()}
    photo, of_photo = coded(found.photo), adjusted.camera_of_photo
    pixel = np.array([size.get(of_photo.get(record_key(name), ""), (1.0, 1.0)) for name in photo.distinct])
    rows = np.flatnonzero(coded(found.kind).where(PHOTO_POINT.name.__eq__))
    axis = coded(found.component)[rows].where("y".__eq__).astype(np.int64)
    # what was disregarded has no weight factor
    used_residual = np.where(np.isfinite(found.weight_factor[rows]), found.residual[rows], np.nan)
    # x and y of a ray follow each other
    squares = np.square(used_residual / pixel.reshape(-1, 2)[photo.codes[rows], axis]).reshape(-1, 2).sum(axis=1)
    place = {name: n for n, name in enumerate(adjusted.solution.points.names)}
    number = coded(found.point)[rows[::2]].numbers(lambda point: place.get(point.split(" ")[0], -1))
    known = (number >= 0) & np.isfinite(squares)
    sums = np.bincount(number[known], np.sqrt(squares[known]), len(place))
    counts = np.bincount(number[known], minlength=len(place))
    return np.asarray(np.where(counts > 0, sums / np.maximum(counts, 1), np.nan))


def _pixel_size(camera: Camera) -> tuple[float, float]:
    sensor = camera.sensor
    return (1.0, 1.0) if sensor is None else (sensor.width / sensor.columns, sensor.height / sensor.rows)


def _rays(
    bundle: BundleState,
    adjusted: _Adjusted,
    exported: Mapping[str, ExportedCamera],
    conventions: Conventions,
    *,
    corrects_distortion: bool,
) -> tuple[ExchangedRays, int]:
    """Return the measurements of what was adjusted, and how many others there are."""
    observed = bundle.observations
    solution = adjusted.solution
    photo_place = {record_key(name): n for n, name in enumerate(solution.photos.names)}
    point_place = {name: n for n, name in enumerate(solution.points.names)}
    photo = coded(observed.photos).numbers(lambda name: photo_place.get(record_key(name), -1))
    point = coded(observed.points).places(point_place)
    kept = (photo >= 0) & (point >= 0)
    photo, point = photo[kept], point[kept]
    image = measured_pixels(bundle, adjusted.cameras, adjusted.camera_of_photo)[kept]
    camera_of_photo = coded([adjusted.camera_of_photo.get(record_key(name), "") for name in solution.photos.names])
    of_ray = camera_of_photo[photo]
    for key, camera in exported.items():
        rows = np.flatnonzero(of_ray.where(key.__eq__))
        image[rows] = camera.rays_of_pixels(image[rows], corrects_distortion=corrects_distortion)
        if conventions.counts_from_principal_point:
            image[rows] -= camera.principal_point
    lost = int((~np.isfinite(image).all(axis=1)).sum())
    if lost:
        message = (
            f"{counted(lost, 'measurement')} cannot be corrected for the distortion: the camera has no direction "
            "there; disregard these measurements"
        )
        raise UnsuitableCameraError(message)
    rays = ExchangedRays(photo, point, image, np.full(len(photo), np.nan), ~observed.disregarded[kept])
    return rays, int((~kept).sum())
