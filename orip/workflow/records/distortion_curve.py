"""The distortion curve of a camera: its polynomial over the radius, and the form that it was given in."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray
from orip.errors import UsageError
from orip.interior.distortion import curve_from_polynomial, isp_from_polynomial
from orip.interior.mounting import frame_corners
from orip.records.names import near_names, record_key
from orip.records.project.camera import RADIAL_PLACES, Camera
from orip.workflow.project.state import ProjectState

DistortionForm = Literal["polynomial", "isp", "curve"]

_RADII = 61


class DistortionCurve(Struct, frozen=True):
    """Radial distortion of a camera.

    Parameters
    ----------
    camera : str
    form : {"polynomial", "isp", "curve"}
        How it was given.
    bundle : str
        The bundle whose last adjustment the polynomial comes from; empty: as the store has it.
    coefficients : (A1, A3, A5, A7, A9)
    isp : (R0, A1, A2, A3) or None
        The same curve in the form of the ISP regulations; None where it has none.
    radius, distortion : arrays (n,)
        The polynomial, mm.
    given_radius, given : arrays (k,)
        Points of the curve that it was given as, mm; none in other forms.
    residual : array (k,)
        Polynomial minus given, mm.
    """

    camera: str
    form: DistortionForm
    bundle: str
    coefficients: tuple[float, ...]
    isp: tuple[float, float, float, float] | None
    radius: FloatArray
    distortion: FloatArray
    given_radius: FloatArray
    given: FloatArray
    residual: FloatArray


def distortion_curve(
    state: ProjectState, name: str, largest_radius: float | None = None, *, is_stored: bool = False
) -> DistortionCurve:
    """Return the distortion curve of a camera: adjusted, if it was, or as its store has it.

    Parameters
    ----------
    state : ProjectState
        With definitions and solutions.
    name : str
    largest_radius : float or None
        mm; None: to the corner of the frame that is farthest from the principal point, and to all given points.
    is_stored : bool
        Even if it was adjusted, as the store has it.

    Raises
    ------
    InputError
        If the project has no stores yet.
    UsageError
        If there is no such camera, or nothing tells how far its photos reach.
    """
    state.require_initialised()
    cameras = state.records.cameras
    camera = cameras.get(record_key(name))
    if camera is None:
        message = f"there is no camera {name}; {near_names(name, (camera.name for camera in cameras.values()))}"
        raise UsageError(message)
    bundle, coefficients = "", camera.parameters[RADIAL_PLACES]
    if not is_stored:
        bundle, coefficients = _adjusted(state, camera) or (bundle, coefficients)
    points = np.array(camera.distortion_curve or (), dtype=np.float64).reshape(-1, 2)
    reach = largest_radius if largest_radius is not None else _reach(camera, points[:, 0])
    if not 0.0 < reach < np.inf:
        message = f"the extent of photos of camera {camera.name} is not known; give the radius in mm with --radius"
        raise UsageError(message)
    radius = np.linspace(0.0, reach, _RADII)
    form: DistortionForm = "isp" if camera.distortion_isp else "curve" if camera.distortion_curve else "polynomial"
    return DistortionCurve(
        camera.name, form, bundle, coefficients, (not bundle and camera.distortion_isp) or _isp(coefficients),
        radius, curve_from_polynomial(coefficients, radius),
        points[:, 0], points[:, 1], curve_from_polynomial(coefficients, points[:, 0]) - points[:, 1],
    )  # fmt: skip


def _adjusted(state: ProjectState, camera: Camera) -> tuple[str, tuple[float, ...]] | None:
    """Return the bundle that adjusted a camera's radial distortion, the last one of several, and the polynomial."""
    for bundle in reversed(state.bundles):
        solution = state.solution(bundle)
        if solution is None or solution.status not in {"converged", "doubtful"}:
            continue
        for row, name in enumerate(solution.cameras.names):
            if (
                record_key(name) == record_key(camera.name)
                and np.isfinite(solution.cameras.sd[row, RADIAL_PLACES]).any()
            ):
                return bundle, tuple(solution.cameras.values[row, RADIAL_PLACES].tolist())
    return None


def _isp(coefficients: Sequence[float]) -> tuple[float, float, float, float] | None:
    try:
        return isp_from_polynomial(coefficients)
    except ValueError:
        return None


def _reach(camera: Camera, given: FloatArray) -> float:
    """Return the largest radius (mm) on the frame, or of the points of the curve; 0 where there is neither."""
    largest = float(given.max(initial=0.0))
    corners = frame_corners(camera)
    if corners is not None:
        farthest = np.maximum(*(np.abs(corner - camera.parameters[1:3]) for corner in corners))
        largest = max(largest, float(np.hypot(*farthest)))
    return largest
