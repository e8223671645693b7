"""Poses as other programs write them, and orip's rotation R (photo axes to ground axes) and projection centre X0.

Most vision programs have camera axes x right, y down, z forward; with D = diag(1, -1, -1) orip's axes are those times
D. D is its own inverse.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from orip.arrays import FloatArray
from orip.geometry.rotation import angles_from_rotation, rotation_about_axes, rotation_from_angles
from orip.records.exchanged import AngleUnit, ExchangedPhoto, PoseReading, RotationForm
from orip.structs import replace

_TURNED = np.diag([1.0, -1.0, -1.0])
_RADIANS = {"radian": 1.0, "degree": np.pi / 180.0, "gon": np.pi / 200.0}

_ANGLES: tuple[RotationForm, ...] = ("omega_phi_kappa", "phi_omega_kappa")

_EXCHANGED = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
"""Exchanges X and Y and turns Z: a rotation, its own inverse."""


def orip_poses(photos: Sequence[ExchangedPhoto], reading: PoseReading) -> tuple[FloatArray, FloatArray]:
    """Return R (n, 3, 3) and X0 (n, 3) of n photos; NaN where a photo has none.

    Notes
    -----
    Matrices that are not quite orthogonal, as printed digits leave them, are replaced by the nearest rotations.
    """
    rotations = np.full((len(photos), 3, 3), np.nan)
    centres = np.full((len(photos), 3), np.nan)
    turned = [n for n, photo in enumerate(photos) if photo.rotation]
    placed = [n for n, photo in enumerate(photos) if photo.position]
    if turned:
        given = _matrices(np.array([photos[n].rotation for n in turned], dtype=np.float64), reading)
        to_ground = given if reading.sense == "to_ground" else np.swapaxes(given, -1, -2)
        rotations[turned] = to_ground @ camera_axes(reading)
    if placed:
        centres[placed] = np.array([photos[n].position for n in placed], dtype=np.float64)
    if reading.position == "translation":
        centres = -_camera_rotations(rotations, reading, centres)
    return rotations, centres


def exchanged_poses(rotations: FloatArray, centres: FloatArray, reading: PoseReading) -> tuple[FloatArray, FloatArray]:
    """Return rotations (n, 9), (n, 4) or (n, 3) and positions (n, 3) as a reading says, of orip's R and X0.

    A quaternion has w >= 0.
    """
    to_ground = rotations @ camera_axes(reading)
    to_camera = np.swapaxes(to_ground, -1, -2)
    position = centres
    if reading.position == "translation":
        position = -(to_camera @ centres[:, :, None])[:, :, 0]
    return _numbers(to_ground if reading.sense == "to_ground" else to_camera, reading), position


def camera_axes(reading: PoseReading) -> FloatArray:
    """Return the rotation (3, 3) between a reading's camera axes and orip's, its own inverse."""
    return _TURNED if reading.camera_axes == "y_down" else np.eye(3)


def camera_to_ground_vectors(rotations: FloatArray, reading: PoseReading) -> FloatArray:
    """Return the rotation vectors (n, 3), radians, from a reading's camera axes to the ground, of orip's R."""
    return rotation_vectors(rotations @ camera_axes(reading))


def other_readings(reading: PoseReading) -> tuple[PoseReading, ...]:
    """Return a reading and those that it is easily mistaken for, itself first.

    R or its transpose, each with y down or up; of angles omega-phi-kappa or phi-omega-kappa, too, in degrees, gon or
    radians.
    """
    is_angles = reading.form in _ANGLES
    forms: tuple[RotationForm, ...] = _ANGLES if is_angles else (reading.form,)
    units: tuple[AngleUnit, ...] = ("degree", "gon", "radian") if is_angles else (reading.unit,)
    found = [
        replace(reading, camera_axes=axes, sense=sense, form=form, unit=unit)
        for form in forms
        for unit in units
        for sense in ("to_ground", "to_camera")
        for axes in ("y_up", "y_down")
    ]
    return tuple(dict.fromkeys([reading, *found]))


def described_reading(reading: PoseReading) -> str:
    """Return a reading in words."""
    axes = "y down, z forward" if reading.camera_axes == "y_down" else "y up, z backward"
    sense = "ground to camera" if reading.sense == "to_camera" else "camera to ground"
    unit = {"radian": "radians", "degree": "degrees", "gon": "gon"}[reading.unit]
    form = {
        "matrix": "rotation matrix",
        "quaternion": "quaternion",
        "rotation_vector": "rotation vector",
        "omega_phi_kappa": f"omega, phi, kappa in {unit}",
        "phi_omega_kappa": f"phi, omega, kappa in {unit}",
    }[reading.form]
    return f"{form}, {sense}; camera axes x right, {axes}"


def _camera_rotations(rotations: FloatArray, reading: PoseReading, translation: FloatArray) -> FloatArray:
    """Return translations in the camera's axes turned to the ground."""
    to_ground = rotations @ camera_axes(reading)
    turned: FloatArray = (to_ground @ translation[:, :, None])[:, :, 0]
    return turned


def _matrices(numbers: FloatArray, reading: PoseReading) -> FloatArray:
    if reading.form == "matrix":
        return _nearest_rotations(numbers.reshape(-1, 3, 3))
    if reading.form == "quaternion":
        return rotations_from_quaternions(numbers)
    if reading.form == "rotation_vector":
        return rotation_about_axes(numbers)
    angles = numbers * _RADIANS[reading.unit]
    if reading.form == "omega_phi_kappa":
        return rotation_from_angles(angles)
    return _from_phi_omega_kappa(angles)


def _numbers(matrices: FloatArray, reading: PoseReading) -> FloatArray:
    if reading.form == "matrix":
        return matrices.reshape(-1, 9)
    if reading.form == "quaternion":
        return quaternions_from_rotations(matrices)
    if reading.form == "rotation_vector":
        return rotation_vectors(matrices)
    is_common = reading.form == "omega_phi_kappa"
    angles = angles_from_rotation(matrices) if is_common else _to_phi_omega_kappa(matrices)
    return np.asarray(angles / _RADIANS[reading.unit])


def rotations_from_quaternions(quaternions: FloatArray) -> FloatArray:
    """Return the rotation matrices (n, 3, 3) of Hamilton quaternions (n, 4), w first, of any length but 0."""
    length = np.linalg.norm(quaternions, axis=1)
    w, x, y, z = (quaternions / np.where(length > 0.0, length, np.nan)[:, None]).T
    rows = [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def quaternions_from_rotations(rotations: FloatArray) -> FloatArray:
    """Return Hamilton quaternions (n, 4), w first and not negative, of rotation matrices (n, 3, 3).

    Each row of the symmetric 4 by 4 matrix 4 q q^T is q times one of its elements; the row of the largest element
    loses no digits (Shepperd, Journal of Guidance and Control 1978).
    """
    r = rotations
    trace = np.einsum("nii->n", r)
    squares = np.stack([trace, r[:, 0, 0], r[:, 1, 1], r[:, 2, 2]], axis=1) * np.array([1.0, 2.0, 2.0, 2.0])
    squares[:, 1:] -= trace[:, None]
    squares += 1.0
    differences = np.stack([r[:, 2, 1] - r[:, 1, 2], r[:, 0, 2] - r[:, 2, 0], r[:, 1, 0] - r[:, 0, 1]], axis=1)
    products = np.zeros((len(r), 4, 4))
    products[:, np.arange(4), np.arange(4)] = squares
    products[:, 0, 1:] = products[:, 1:, 0] = differences
    for i, j in ((0, 1), (0, 2), (1, 2)):
        products[:, i + 1, j + 1] = products[:, j + 1, i + 1] = r[:, i, j] + r[:, j, i]
    chosen = products[np.arange(len(r)), squares.argmax(axis=1)]
    unit = chosen / np.linalg.norm(chosen, axis=1, keepdims=True)
    return np.asarray(unit * np.where(unit[:, :1] < 0.0, -1.0, 1.0))


def rotation_vectors(rotations: FloatArray) -> FloatArray:
    """Return rotation vectors (n, 3), axis times angle (radians), of rotation matrices (n, 3, 3)."""
    quaternions = quaternions_from_rotations(rotations)
    sine = np.linalg.norm(quaternions[:, 1:], axis=1)
    angle = 2.0 * np.arctan2(sine, quaternions[:, 0])
    # for small angles the vector is twice the quaternion's
    factor = np.where(sine > 0.0, angle / np.where(sine > 0.0, sine, 1.0), 2.0)
    return np.asarray(quaternions[:, 1:] * factor[:, None])


def _from_phi_omega_kappa(angles: FloatArray) -> FloatArray:
    """Return Ry(phi) Rx(omega) Rz(kappa) of angles (n, 3) omega, phi, kappa.

    With X and Y exchanged and Z turned, Ry becomes Rx, Rx becomes Ry and Rz turns the other way.
    """
    omega, phi, kappa = angles.T
    other = rotation_from_angles(np.stack([phi, omega, -kappa], axis=1))
    return np.asarray(_EXCHANGED @ other @ _EXCHANGED)


def _to_phi_omega_kappa(matrices: FloatArray) -> FloatArray:
    phi, omega, kappa = angles_from_rotation(_EXCHANGED @ matrices @ _EXCHANGED).T
    return np.stack([omega, phi, -kappa], axis=1)


def _nearest_rotations(matrices: FloatArray) -> FloatArray:
    """Return the rotations nearest to matrices (n, 3, 3); a matrix that mirrors becomes NaN."""
    left, _, right = np.linalg.svd(np.where(np.isfinite(matrices), matrices, 0.0))
    rotations: FloatArray = left @ right
    rotations[np.linalg.det(rotations) < 0.0] = np.nan
    return rotations
