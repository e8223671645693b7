"""Rotations between photo and ground: omega, phi, kappa, small rotations, and roll, pitch and heading."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from orip.arrays import FloatArray, Number

# The matrix takes photo axes to ground axes, R = Rx(omega) Ry(phi) Rz(kappa), right-handed; angles are radians.
# Nothing here has a singular case except the angles themselves, which are only a way of writing R down.

_GIMBAL_LOCK = 1e-9
"""Below this cosine of phi omega and kappa turn about the same axis, and kappa is written as zero."""

_SMALL_ANGLE = 1e-2
"""Half of an angle below which a series of two terms is exact."""


def rotated(
    rotation: Sequence[float] | Sequence[Number], x: Number, y: Number, z: Number
) -> tuple[Number, Number, Number]:
    """Return R (x, y, z): photo axes to ground axes.

    Parameters
    ----------
    rotation : 9 floats, or arrays (n,)
        R row by row.
    x, y, z : floats, or arrays (n,)
    """
    r11, r12, r13, r21, r22, r23, r31, r32, r33 = rotation
    return r11 * x + r12 * y + r13 * z, r21 * x + r22 * y + r23 * z, r31 * x + r32 * y + r33 * z


def rotated_back(
    rotation: Sequence[float] | Sequence[Number], x: Number, y: Number, z: Number
) -> tuple[Number, Number, Number]:
    """Return R^T (x, y, z): ground axes to photo axes; parameters as of `rotated`."""
    r11, r12, r13, r21, r22, r23, r31, r32, r33 = rotation
    return r11 * x + r21 * y + r31 * z, r12 * x + r22 * y + r32 * z, r13 * x + r23 * y + r33 * z


def rotation_from_angles(angles: FloatArray) -> FloatArray:
    """Return R = Rx(omega) Ry(phi) Rz(kappa).

    Parameters
    ----------
    angles : array (..., 3)
        omega, phi, kappa in radians.

    Returns
    -------
    array (..., 3, 3)
        Photo to ground.
    """
    so, sp, sk = np.moveaxis(np.sin(angles), -1, 0)
    co, cp, ck = np.moveaxis(np.cos(angles), -1, 0)
    rows = [
        [cp * ck, -cp * sk, sp],
        [co * sk + so * sp * ck, co * ck - so * sp * sk, -so * cp],
        [so * sk - co * sp * ck, so * ck + co * sp * sk, co * cp],
    ]
    return _matrices(rows)


def _matrices(rows: Sequence[Sequence[FloatArray]]) -> FloatArray:
    """Return matrices (..., 3, 3) of elements (...), row by row."""
    matrices = np.empty((*np.shape(rows[0][0]), 3, 3))
    for number, row in enumerate(rows):
        for column, elements in enumerate(row):
            matrices[..., number, column] = elements
    return matrices


def angles_from_rotation(rotation: FloatArray) -> FloatArray:
    """Return omega, phi, kappa (radians) of R = Rx Ry Rz; phi in [-pi/2, pi/2], kappa = 0 at phi = ±pi/2.

    `rotation` is an array (..., 3, 3), the result (..., 3).
    """
    r = rotation
    cosine = np.hypot(r[..., 1, 2], r[..., 2, 2])
    omega = np.arctan2(-r[..., 1, 2], r[..., 2, 2])
    phi = np.arctan2(r[..., 0, 2], cosine)
    kappa = np.arctan2(-r[..., 0, 1], r[..., 0, 0])
    locked = cosine < _GIMBAL_LOCK
    locked_omega = np.arctan2(np.sign(phi) * r[..., 1, 0], r[..., 1, 1])
    return np.stack([np.where(locked, locked_omega, omega), phi, np.where(locked, 0.0, kappa)], axis=-1)


def cross_matrix(vectors: FloatArray) -> FloatArray:
    """Return the matrices [a]x with [a]x b = a × b.

    `vectors` is an array (..., 3), the result (..., 3, 3).
    """
    result = np.zeros((*vectors.shape, 3))
    result[..., 0, 1], result[..., 0, 2] = -vectors[..., 2], vectors[..., 1]
    result[..., 1, 0], result[..., 1, 2] = vectors[..., 2], -vectors[..., 0]
    result[..., 2, 0], result[..., 2, 1] = -vectors[..., 1], vectors[..., 0]
    return result


def rotation_about_axes(delta: FloatArray) -> FloatArray:
    """Return Exp([delta]x), the rotation by |delta| about the direction of delta (Rodrigues' formula).

    Parameters
    ----------
    delta : array (..., 3)
        Rotation vector about the ground axes, radians.

    Returns
    -------
    array (..., 3, 3)
    """
    angle = np.linalg.norm(delta, axis=-1)[..., None, None]
    k = cross_matrix(delta)
    # np.sinc keeps both quotients exact down to a zero angle
    sine = np.sinc(angle / np.pi)
    versine = 0.5 * np.sinc(angle / (2.0 * np.pi)) ** 2
    return np.asarray(np.eye(3) + sine * k + versine * (k @ k))


def rotation_vectors_with_partials(rotations: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return delta with R = Exp([delta]x), the inverse of `rotation_about_axes`, and how a small rotation changes it.

    Parameters
    ----------
    rotations : array (..., 3, 3)

    Returns
    -------
    vectors : array (..., 3)
        Radians, of a length up to pi.
    partials : array (..., 3, 3)
        D with delta of Exp([epsilon]x) R = delta + D epsilon.
    """
    trace = np.trace(rotations, axis1=-2, axis2=-1)
    scalar, vector = _unit_quaternions(rotations, trace)
    sine = np.linalg.norm(vector, axis=-1)
    half = np.arctan2(sine, scalar)
    # np.sinc keeps the quotient half / sin(half) exact down to a zero angle
    vectors = 2.0 * vector / np.sinc(half / np.pi)[..., None]
    near = half < _SMALL_ANGLE
    safe = np.where(near, 1.0, half)
    bend = np.where(near, (1.0 / 12.0) * (1.0 + half**2 / 15.0), (1.0 - safe / np.tan(safe)) / (4.0 * safe**2))
    k = cross_matrix(vectors)
    return vectors, np.eye(3) - 0.5 * k + bend[..., None, None] * (k @ k)


def _unit_quaternions(rotations: FloatArray, trace: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return scalar (...) and vector (..., 3) of unit quaternions, the scalar not negative."""
    r = rotations
    skew = np.stack([r[..., 2, 1] - r[..., 1, 2], r[..., 0, 2] - r[..., 2, 0], r[..., 1, 0] - r[..., 0, 1]], axis=-1)
    # the columns are 4 q_k (q_0, q_1, q_2, q_3): that of the largest component has no cancellation
    columns = np.empty((*r.shape[:-2], 4, 4))
    columns[..., 0, 0] = 1.0 + trace
    columns[..., 0, 1:] = columns[..., 1:, 0] = skew
    columns[..., 1:, 1:] = r + np.swapaxes(r, -1, -2) + (1.0 - trace)[..., None, None] * np.eye(3)
    largest = np.argmax(np.diagonal(columns, axis1=-2, axis2=-1), axis=-1)
    chosen = np.take_along_axis(columns, largest[..., None, None], axis=-2)[..., 0, :]
    chosen = chosen / np.linalg.norm(chosen, axis=-1, keepdims=True)
    chosen = np.where(chosen[..., :1] < 0.0, -chosen, chosen)
    return chosen[..., 0], chosen[..., 1:]


def axes_rotation_from_angle_rates(angles: FloatArray) -> FloatArray:
    """Return J with delta = J (d omega, d phi, d kappa): columns are the rotation axes of the three angles.

    `angles` is an array (..., 3), the result (..., 3, 3); its determinant is cos(phi).
    """
    so, co = np.sin(angles[..., 0]), np.cos(angles[..., 0])
    sp, cp = np.sin(angles[..., 1]), np.cos(angles[..., 1])
    one, zero = np.ones_like(so), np.zeros_like(so)
    rows = [[one, zero, sp], [zero, co, -so * cp], [zero, so, co * cp]]
    return _matrices(rows)


def angle_rates_from_axes_rotation(angles: FloatArray) -> FloatArray:
    """Return the inverse of `axes_rotation_from_angle_rates`; grows without bound towards phi = ±pi/2.

    `angles` is an array (..., 3), the result (..., 3, 3).
    """
    so, co = np.sin(angles[..., 0]), np.cos(angles[..., 0])
    tp, cp = np.tan(angles[..., 1]), np.cos(angles[..., 1])
    one, zero = np.ones_like(so), np.zeros_like(so)
    rows = [[one, so * tp, -co * tp], [zero, co, so], [zero, -so / cp, co / cp]]
    return _matrices(rows)


def angles_between(one: FloatArray, other: FloatArray) -> FloatArray:
    """Return the angles (...), radians, of the rotations that take rotation matrices (..., 3, 3) to other ones."""
    trace = np.einsum("...ij,...ij->...", one, other)
    return np.asarray(np.arccos(np.clip(0.5 * (trace - 1.0), -1.0, 1.0)))


# Roll, pitch and heading (radians) turn the axes front, right, down to north, east, down: R = Rz(heading) Ry(pitch)
# Rx(roll), the convention of navigation (heading clockwise from true north). They refer to the ellipsoid's normal and
# to true north at the place.

_NED_TO_ENU = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])

_MOUNTS = {
    "body": np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]),
    "gimbal": np.array([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]),
}
"""Photo axes (x to the right, y up in the picture, z to the back of the camera) to front, right, down.

Of a camera that looks down with the top of the picture forward (body), and of one that looks forward (gimbal).
"""


def rotation_from_navigation(angles: FloatArray, mount: Literal["body", "gimbal"] = "body") -> FloatArray:
    """Return the rotations from photo axes to east, north, up.

    Parameters
    ----------
    angles : array (n, 3)
        Roll, pitch, heading, radians.
    mount : {"body", "gimbal"}
        body: the angles are those of the vehicle, and the camera looks down with the top of the picture forward.
        gimbal: the angles are those of the camera, which looks forward at pitch 0 and down at pitch -90 degrees.

    Returns
    -------
    array (n, 3, 3)
    """
    (sr, sp, sh), (cr, cp, ch) = np.sin(angles).T, np.cos(angles).T
    rows = [
        [cp * ch, sr * sp * ch - cr * sh, cr * sp * ch + sr * sh],
        [cp * sh, sr * sp * sh + cr * ch, cr * sp * sh - sr * ch],
        [-sp, sr * cp, cr * cp],
    ]
    to_ned = np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
    return np.asarray(_NED_TO_ENU @ to_ned @ _MOUNTS[mount])


def navigation_from_rotation(rotations: FloatArray) -> FloatArray:
    """Return roll, pitch and heading (n, 3), radians, of rotations (n, 3, 3) from photo axes to east, north, up.

    Those of the vehicle (body), the inverse of `rotation_from_navigation`. At a pitch of 90 degrees roll and heading
    turn about the same axis: only their difference counts there.
    """
    to_ned = _NED_TO_ENU.T @ rotations @ _MOUNTS["body"].T
    roll = np.arctan2(to_ned[:, 2, 1], to_ned[:, 2, 2])
    pitch = -np.arcsin(np.clip(to_ned[:, 2, 0], -1.0, 1.0))
    heading = np.arctan2(to_ned[:, 1, 0], to_ned[:, 0, 0])
    return np.stack([roll, pitch, heading], axis=1)


def looking_along(direction: FloatArray, roll: float) -> FloatArray:
    """Return the rotation (3, 3), photo to ground, of a camera that looks along a direction, its y axis upwards.

    Parameters
    ----------
    direction : array (3,)
        Of length 1.
    roll : float
        Turn of the camera about its axis, radians.
    """
    up = np.array([0.0, 1.0, 0.0]) if abs(direction[2]) > 1.0 - 1e-9 else np.array([0.0, 0.0, 1.0])
    right = np.cross(direction, up)
    right /= np.linalg.norm(right)
    axes = np.column_stack([right, np.cross(-direction, right), -direction])
    return np.asarray(axes @ rotation_from_angles(np.array([[0.0, 0.0, roll]]))[0])
