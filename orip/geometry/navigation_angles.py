"""Roll, pitch and heading to rotations of photos.

Roll, pitch and heading (radians) turn the axes front, right, down to north, east, down: R = Rz(heading) Ry(pitch)
Rx(roll), the convention of navigation (heading clockwise from true north). They refer to the ellipsoid's normal and to
true north at the place.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from orip.arrays import FloatArray

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
