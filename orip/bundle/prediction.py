"""Where an adjusted photo shows a ground point: the photo coordinates that an adjustment predicts."""

from __future__ import annotations

import numpy as np

from orip.arrays import FloatArray
from orip.bundle.kinds.additional_parameter import base_of_camera
from orip.geometry.perspective import perspective_with_partials
from orip.geometry.rotation import rotation_from_angles
from orip.interior.additional_parameters import PARAMETER_SETS, additional_with_partials
from orip.interior.distortion import correction_with_partials, distortion_with_partials
from orip.records.camera import Camera
from orip.records.ground import GroundSystem
from orip.records.names import record_key
from orip.records.solution import Solution
from orip.units import RADIANS_PER_DEGREE

_NEWTON_STEPS = 20
_NEWTON_TOLERANCE_MM = 1e-9


def predict_photo_coordinates(
    solution: Solution, photo: str, camera: Camera, xyz: FloatArray, ground: GroundSystem
) -> FloatArray:
    """Return the photo coordinates of ground points by an adjustment's camera and photo.

    Parameters
    ----------
    solution : Solution
    photo : str
        A photo of the solution.
    camera : Camera
        Its camera; parameter values are taken from the solution.
    xyz : array (n, 3)
        Ground points, the project's coordinates.
    ground : GroundSystem
        Of the project; where its origin is does not matter.

    Returns
    -------
    array (n, 2)
        mm; NaN for a point behind the camera, or where the distortion polynomial images nothing.
    """
    cameras = {record_key(name): row for row, name in enumerate(solution.cameras.names)}
    photos = {record_key(name): row for row, name in enumerate(solution.photos.names)}
    parameters = solution.cameras.values[cameras[record_key(camera.name)]]
    orientation = solution.photos.values[photos[record_key(photo)]]
    centre = orientation[None, :3]
    rotation = rotation_from_angles(orientation[None, 3:] * RADIANS_PER_DEGREE)
    rotation = np.swapaxes(ground.axes_at(centre), 1, 2) @ rotation
    image = perspective_with_partials(
        ground.to_local(xyz) - ground.to_local(centre),
        np.broadcast_to(rotation, (len(xyz), 3, 3)),
        np.full(len(xyz), parameters[0]),
    )
    of_set = [each.value for each in solution.additional if record_key(each.camera) == record_key(camera.name)]
    distorted = _measured_at if camera.distortion_at == "measured" else _distorted
    xy = distorted(image.xy, parameters, camera, np.array(of_set))
    xy[~image.in_front] = np.nan
    return xy


def _distorted(ideal: FloatArray, parameters: FloatArray, camera: Camera, of_set: FloatArray) -> FloatArray:
    """Return photo coordinates of ideal ones, for a polynomial given at these."""
    place = parameters[1:3] + ideal
    return place + distortion_with_partials(ideal, parameters[3:]).value + _deformation(place, camera, of_set)[0]


def _measured_at(ideal: FloatArray, parameters: FloatArray, camera: Camera, of_set: FloatArray) -> FloatArray:
    """Return the photo coordinates that the correction of a polynomial given at them takes to the ideal ones."""
    xy = parameters[1:3] + ideal
    missed = np.full(len(xy), np.inf)
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):  # a point far outside may run away
        for _ in range(_NEWTON_STEPS):
            corrected = correction_with_partials(xy - parameters[1:3], parameters[3:])
            deformation, by_xy = _deformation(xy, camera, of_set)
            misfit = corrected.value - deformation - ideal
            missed = np.abs(misfit).max(axis=1, initial=0.0)
            if not (missed >= _NEWTON_TOLERANCE_MM).any():
                break
            xy = xy - _solved(corrected.by_xy - by_xy, misfit)
    xy[~(missed < _NEWTON_TOLERANCE_MM)] = np.nan
    return xy


def _deformation(place: FloatArray, camera: Camera, of_set: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return what a camera's parameter set adds at places (n, 2), and its partials (n, 2, 2) by them."""
    if camera.additional_set is None or len(of_set) != len(PARAMETER_SETS[camera.additional_set].parameter_names):
        return np.zeros_like(place), np.zeros((len(place), 2, 2))
    found = additional_with_partials(camera.additional_set, place, base_of_camera(camera), of_set)
    return found.value, found.by_xy


def _solved(matrix: FloatArray, right: FloatArray) -> FloatArray:
    """Return the solutions of n systems of two equations; not finite where there is none."""
    determinant = matrix[:, 0, 0] * matrix[:, 1, 1] - matrix[:, 0, 1] * matrix[:, 1, 0]
    x = matrix[:, 1, 1] * right[:, 0] - matrix[:, 0, 1] * right[:, 1]
    y = matrix[:, 0, 0] * right[:, 1] - matrix[:, 1, 0] * right[:, 0]
    return np.stack([x, y], axis=1) / determinant[:, None]
