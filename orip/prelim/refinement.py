"""Refinement of a block's preliminary values: all photos and points in one least squares adjustment, weights robust.

It removes the drift that accumulates as photo after photo is added. Of unknown interior orientations only as much is
estimated as is needed to keep them from distorting the block. Standard deviations are left to the bundle adjustment.
"""

from __future__ import annotations

import math

import numpy as np
from msgspec import Struct

from orip.adjustment.weights import LEAST_WEIGHT, LIMIT_OF_TWO_COMPONENTS
from orip.arrays import BoolArray, FloatArray, IntArray
from orip.prelim.compiled import LARGEST_TURN, kernels
from orip.prelim.rays import CAMERA_CORRECTIONS, ImageRays
from orip.records.camera import Camera
from orip.structs import replace

# An interior orientation that is to be estimated may be off by per cent. Photos that are adjusted without correcting it
# do not fit, and seem to be in the wrong place. A few corrections per camera prevent that: C' = C exp(s),
# x' = x + C b + k (r / C)² x, and y alike. The bundle adjustment starts the camera with them.

EXPECTED = np.array([0.03, 0.02, 0.02, 0.1])
"""A-priori standard deviations of the corrections: they bound what a block does not determine."""


def no_corrections(rays: ImageRays) -> FloatArray:
    """Return corrections of all unknown cameras, array (cameras, `CAMERA_CORRECTIONS`), that are 0."""
    return np.zeros(rays.cameras.unknown.shape)


def corrected(rays: ImageRays, corrections: FloatArray) -> ImageRays:
    """Return the rays with corrected image vectors.

    Parameters
    ----------
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
    correction : array (`CAMERA_CORRECTIONS`,)
    """
    c, dx, dy, a1, a3, *others = camera.parameters
    scale, x, y, radial = correction.tolist()
    return (c * math.exp(scale), dx - c * x, dy - c * y, a1, a3 - radial / (c * c), *others)


def camera_of(rays: ImageRays) -> IntArray:
    """Return the unknown camera (n,) of each ray, -1 for a known one; an empty array where all are known."""
    of_photo = rays.cameras.of_photo
    return of_photo[rays.photo] if len(of_photo) else of_photo


MEDIAN_LENGTH = math.sqrt(2.0 * math.log(2.0))
"""Median length of a residual with two normal components of standard deviation 1."""


ROUGH = 1e-2
"""Relative gain in the weighted square sum below which a system is good enough to grow further."""

_ENOUGH = 0.5
"""Gain in the weighted square sum, over the variance of unit weight, below which nothing is off by much more than its
standard deviation: photos connected with the others by few points hardly affect the whole sum."""

_UPHILL, _UPHILL_STEPS = 10.0, 2
"""Multiple of the weighted square sum up to which uphill steps are taken, and how many of them in succession."""


_MOST_STEPS = 30

_FIRST_DAMPING = 1e-6
"""Small, as the drift of added photos is mostly a bending of strips, whose eigenvalues are small."""

_LEAST_DAMPING = 1e-8
"""Keeps the reduced system regular where nothing holds the block, or a photo."""


class Refined(Struct, frozen=True):
    """A refined block.

    Parameters
    ----------
    rotations : array (p, 3, 3)
    centres : array (p, 3)
    coordinates : array (q, 3)
    corrections : array (cameras, 4)
        Of the unknown cameras.
    weight_factors : array (n,)
        Of the rays; 0 for rays that took no part.
    s0 : float
        Robust scale of the residuals against the a-priori errors; 0 without redundancy.
    """

    rotations: FloatArray
    centres: FloatArray
    coordinates: FloatArray
    corrections: FloatArray
    weight_factors: FloatArray
    s0: float
    iterations: int


def refine(
    rays: ImageRays,
    rotations: FloatArray,
    centres: FloatArray,
    oriented: BoolArray,
    coordinates: FloatArray,
    *,
    corrections: FloatArray | None = None,
    held_points: BoolArray | None = None,
    enough: float = 0.0,
) -> Refined:
    """Adjust photos and points together.

    Parameters
    ----------
    rotations : array (p, 3, 3)
        Photo to ground.
    centres : array (p, 3)
    oriented : array (p,) of bool
        Other photos stay as they are, and their rays take no part.
    coordinates : array (q, 3)
        NaN for a point without a position: its rays take no part.
    corrections : array (cameras, 4) or None
        Of the unknown cameras; 0 unless given.
    held_points : array (q,) of bool or None
        Control that is known and stays. Without any the block keeps its place by damping.
    enough : float
        Relative gain in the weighted square sum at which the iterations end; 0: they go on until nothing is off by much
        more than its standard deviation.

    Notes
    -----
    Gauss-Newton with Marquardt's (1963) damping and weights of the Danish method (Krarup, Juhl and Kubik 1980), whose
    scale is the median of the residuals. Points are eliminated; the reduced system of the photos, ordered by reverse
    Cuthill-McKee (1969), is solved as a band (Brown's 1976 arrangement of a block).
    """
    held_points = np.zeros(len(rays.points), dtype=bool) if held_points is None else held_points
    corrections = no_corrections(rays) if corrections is None else corrections.copy()
    rotations, centres, coordinates = rotations.copy(), centres.copy(), coordinates.copy()
    weights, scale, cameras = np.empty(len(rays.photo)), np.empty(1), rays.cameras
    of_rays = map(np.ascontiguousarray, (rays.photo, rays.point, rays.vectors, rays.error))
    iterations = kernels.refine(
        *of_rays, cameras.of_photo, cameras.unknown, oriented, held_points, _rules(enough),
        rotations, centres, coordinates, corrections, weights, scale,
    )  # fmt: skip
    return Refined(rotations, centres, coordinates, corrections, weights, float(scale[0]), iterations)


def _rules(enough: float) -> FloatArray:
    """Return the numbers of `RefinementRules` in robust_iterations.h."""
    return np.array(
        [
            MEDIAN_LENGTH, LIMIT_OF_TWO_COMPONENTS, LEAST_WEIGHT, LARGEST_TURN, _UPHILL, _UPHILL_STEPS, _MOST_STEPS,
            _FIRST_DAMPING, _LEAST_DAMPING, _ENOUGH, enough, *EXPECTED.tolist(),
        ]
    )  # fmt: skip
