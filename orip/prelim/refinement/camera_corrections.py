"""Approximate corrections of the cameras' interior orientation while a block grows.

An interior orientation that is to be estimated may be off by per cent. Photos that are adjusted without correcting it
do not fit, and seem to be in the wrong place. A few corrections per camera prevent that: C' = C exp(s),
x' = x + C b + k (r / C)² x, and y alike. The bundle adjustment starts the camera with them.
"""

from __future__ import annotations

import math

import numpy as np

from orip.arrays import FloatArray, IntArray
from orip.prelim.rays.image_rays import CAMERA_CORRECTIONS, ImageRays
from orip.records.project.camera import Camera
from orip.structs import replace

EXPECTED = np.array([0.03, 0.02, 0.02, 0.1])
"""A-priori standard deviations of the corrections: they bound what a block does not determine."""


def no_corrections(rays: ImageRays) -> FloatArray:
    """Return corrections of all unknown cameras, array (cameras, `CAMERA_CORRECTIONS`), that are 0."""
    return np.zeros(rays.cameras.unknown.shape)


def corrected(rays: ImageRays, corrections: FloatArray) -> ImageRays:
    """Return the rays with corrected image vectors.

    Parameters
    ----------
    rays : ImageRays
    corrections : array (cameras, `CAMERA_CORRECTIONS`)
    """
    if not corrections.any():
        return rays
    # the last row, index -1, is that of known cameras
    scale, right, up, radial = np.vstack([corrections, np.zeros(CAMERA_CORRECTIONS)])[camera_of(rays)].T
    x, y, z = rays.vectors.T
    factor = 1.0 + radial * (x * x + y * y) / (z * z)
    vectors = np.column_stack([factor * x - right * z, factor * y - up * z, z * np.exp(scale)])
    return replace(rays, vectors=vectors)


def parameters_with(camera: Camera, correction: FloatArray) -> tuple[float, ...]:
    """Return the parameters of a camera whose image vectors are the corrected ones, to first order.

    Parameters
    ----------
    camera : Camera
    correction : array (`CAMERA_CORRECTIONS`,)
    """
    c, dx, dy, a1, a3, *others = camera.parameters
    scale, x, y, radial = correction.tolist()
    return (c * math.exp(scale), dx - c * x, dy - c * y, a1, a3 - radial / (c * c), *others)


def camera_of(rays: ImageRays) -> IntArray:
    """Return the unknown camera (n,) of each ray, -1 for a known one; an empty array where all are known."""
    of_photo = rays.cameras.of_photo
    return of_photo[rays.photo] if len(of_photo) else of_photo


def by_corrections(rays: ImageRays) -> FloatArray:
    """Return the partials (n, 2, `CAMERA_CORRECTIONS`) of residuals, computed minus measured, by corrections.

    Those by the first are the computed coordinates themselves; the factor 1 is returned for them. 0 for corrections
    that are known; an empty array where all cameras are known.
    """
    camera = camera_of(rays)
    partials = np.zeros((len(camera), 2, CAMERA_CORRECTIONS))
    if len(camera):
        x, y, z = rays.vectors.T
        radial = (x * x + y * y) / (z * z)
        partials[:, :, 0] = 1.0
        partials[:, 0, 1] = partials[:, 1, 2] = z
        partials[:, 0, 3], partials[:, 1, 3] = -radial * x, -radial * y
        # the last row is that of known cameras
        unknown = np.vstack([rays.cameras.unknown, np.zeros(CAMERA_CORRECTIONS, dtype=bool)])
        partials *= unknown[camera, None, :]
    return partials
