"""The coordinate frames of mapping and navigation, and the rotations between them.

All are right-handed; rotations R take components in the first frame to those in the second, x₂ = R x₁.

| frame | origin | axes |
|---|---|---|
| inertial (i) | centre of the earth | as e at time zero, from when on it does not turn |
| earth-centred, earth-fixed (e) | centre of the earth | x to the Greenwich meridian, z the earth's axis |
| local level (l) | a place | east, north, up along the ellipsoid's normal |
| wander azimuth (w) | a place | up, and y turned from north by the wander angle, counter-clockwise seen from above |
| body (b) | the vehicle | front, right, down; roll, pitch, heading turn it from north, east, down |
| mapping (m) | that of the projection | easting, northing, height: the project's `crs` (`orip.geometry.ground_frame`) |
| photo | the projection centre | x right, y up in the picture, z to the back of the camera |

Places are longitude, latitude (radians) and height (m), as in `orip.geometry.ground_ellipsoid`.
"""

from __future__ import annotations

import numpy as np

from orip.arrays import FloatArray
from orip.geometry.ground_ellipsoid import geocentric_from_geographic, place_axes
from orip.geometry.rotation import rotation_from_navigation

EARTH_RATE = 7.292115e-5
"""Rotation of the earth, radians per second (WGS 84, NIMA TR8350.2)."""

_PHOTO_FROM_BODY = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
"""Of a camera that looks down with the top of its picture forward."""


def _turns_about_up(angles: FloatArray) -> FloatArray:
    """Return the rotations (n, 3, 3) of the axes by angles (n,) counter-clockwise about z."""
    sine, cosine, zero, one = np.sin(angles), np.cos(angles), np.zeros_like(angles), np.ones_like(angles)
    rows = [[cosine, sine, zero], [-sine, cosine, zero], [zero, zero, one]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def earth_from_inertial(seconds: FloatArray) -> FloatArray:
    """Return the rotations (n, 3, 3) from i to e at times (n,) after those axes were the same."""
    return _turns_about_up(EARTH_RATE * np.asarray(seconds, dtype=np.float64))


def local_from_earth(geographic: FloatArray) -> FloatArray:
    """Return the rotations (n, 3, 3) from e to l at places (n, 3)."""
    return place_axes(geographic)


def wander_from_local(angles: FloatArray) -> FloatArray:
    """Return the rotations (n, 3, 3) from l to w by wander angles (n,), radians."""
    return _turns_about_up(np.asarray(angles, dtype=np.float64))


def changes_of_wander(geographic: FloatArray) -> FloatArray:
    """Return the changes (n - 1,) of the wander angle between places (n, 3) of a path: -Δλ sin φ at the middle.

    The w-frame is not turned about up on the way, while the direction of north is (Schwarz and Wei 1994).
    """
    longitude, latitude = np.unwrap(geographic[:, 0]), geographic[:, 1]
    return -np.diff(longitude) * np.sin((latitude[1:] + latitude[:-1]) / 2.0)


def local_from_body(angles: FloatArray) -> FloatArray:
    """Return the rotations (n, 3, 3) from b to l by roll, pitch and heading (n, 3), radians."""
    return np.asarray(rotation_from_navigation(angles) @ _PHOTO_FROM_BODY)


def local_coordinates(geographic: FloatArray, origin: FloatArray, semi_axes: tuple[float, float]) -> FloatArray:
    """Return east, north and up (n, 3), metres, of places (n, 3) from an origin (3,): e to l with its shift."""
    e = geocentric_from_geographic(np.vstack([origin, geographic]), semi_axes)
    return np.asarray((e[1:] - e[0]) @ local_from_earth(origin[None])[0].T)


# Angles of terrestrial photos (Kraus 1997): R = Rz(alpha) Rx(90 degrees + zeta) Rz(kappa) from photo to ground. With
# all of them zero the camera is upright and looks horizontally to +Y.


def terrestrial_from_rotation(rotations: FloatArray) -> FloatArray:
    """Return alpha, zeta and kappa (n, 3), radians, of rotations (n, 3, 3) from photo to ground.

    Straight up or down, where alpha and kappa turn about the same axis, kappa is zero.
    """
    cosine = np.hypot(rotations[:, 2, 0], rotations[:, 2, 1])
    zeta = np.arctan2(-rotations[:, 2, 2], cosine)
    is_upright = cosine > 1e-12
    alpha = np.where(
        is_upright,
        np.arctan2(rotations[:, 0, 2], -rotations[:, 1, 2]),
        np.arctan2(rotations[:, 1, 0], rotations[:, 0, 0]),
    )
    kappa = np.where(is_upright, np.arctan2(rotations[:, 2, 0], rotations[:, 2, 1]), 0.0)
    return np.stack([alpha, zeta, kappa], axis=1)


def rotation_from_terrestrial(angles: FloatArray) -> FloatArray:
    """Return rotations (n, 3, 3) from photo to ground by alpha, zeta and kappa (n, 3), radians."""
    (sa, sz, sk), (ca, cz, ck) = np.sin(angles).T, np.cos(angles).T
    rows = [
        [ca * ck + sa * sz * sk, -ca * sk + sa * sz * ck, sa * cz],
        [sa * ck - ca * sz * sk, -sa * sk - ca * sz * ck, -ca * cz],
        [cz * sk, cz * ck, -sz],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def terrestrial_rates(angles: FloatArray) -> FloatArray:
    """Return what small rotations about the ground axes change of alpha, zeta and kappa: an array (n, 3, 3).

    Singular straight up and down.
    """
    alpha, zero, one = angles[:, 0], np.zeros(len(angles)), np.ones(len(angles))
    about = np.stack(
        [
            np.stack([zero, zero, one], axis=-1),
            np.stack([np.cos(alpha), np.sin(alpha), zero], axis=-1),
            rotation_from_terrestrial(angles)[:, :, 2],
        ],
        axis=-1,
    )
    return np.linalg.inv(about)
