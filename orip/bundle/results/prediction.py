"""Where an adjusted photo shows a ground point: the photo coordinates that an adjustment predicts."""

from __future__ import annotations

import numpy as np

from orip.arrays import FloatArray
from orip.geometry.projection import projected_with_partials
from orip.geometry.rotation import rotation_from_angles
from orip.interior.additional_parameters import PARAMETER_SETS, base_of_camera
from orip.interior.distortion import image_polynomial
from orip.interior.image_coordinates import ImageEquation
from orip.records.camera import READOUT, Camera
from orip.records.ground import GroundSystem
from orip.records.names import record_key
from orip.records.results.solution import Solution
from orip.units import RADIANS_PER_DEGREE


def predict_photo_coordinates(
    solution: Solution, photo: str, camera: Camera, xyz: FloatArray, ground: GroundSystem
) -> FloatArray:
    """Return the photo coordinates of ground points by an adjustment's camera and photo.

    Parameters
    ----------
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
    image = projected_with_partials(
        ground.to_local(xyz) - ground.to_local(centre),
        np.broadcast_to(rotation, (len(xyz), 3, 3)),
        np.full(len(xyz), parameters[0]),
        np.full(len(xyz), camera.projection == "equidistant"),
    )
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):  # a point far outside may overflow
        xy = np.stack(_image_equation(solution, camera, parameters).measured(*image.xy.T), axis=1)
    xy[~image.in_front] = np.nan
    return xy


def _image_equation(solution: Solution, camera: Camera, parameters: FloatArray) -> ImageEquation:
    """Return the image equation of a camera with the parameters (12,) and additional parameters of a solution."""
    key = record_key(camera.name)
    values = np.array([found.value for found in solution.additional if record_key(found.camera) == key])
    name, additional = camera.additional_set, None
    if name is not None and len(values) == len(PARAMETER_SETS[name].parameter_names):
        additional = image_polynomial(name, base_of_camera(camera), values)
    x0, y0, *coefficients = parameters[1:READOUT].tolist()
    return ImageEquation(x0, y0, tuple(coefficients), camera.distortion_at == "measured", additional)
