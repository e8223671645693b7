"""What is drawn of a result: points and photos with their standard deviations, error ellipses."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from orip.arrays import FloatArray
from orip.records.exchanged import ExchangedProject, PoseReading

READING = PoseReading("y_up", "to_ground", "omega_phi_kappa", "degree")
"""Rotations as orip has them."""

POINT_COLUMNS = ("X", "Y", "Z", "sX", "sY", "sZ", "semi_major", "semi_minor", "direction", "residual_px")
PHOTO_COLUMNS = ("X0", "Y0", "Z0", "sX0", "sY0", "sZ0", "OMEGA", "PHI", "KAPPA")

_CORNERS = 36
_OF_EXTENT = 0.01


@dataclass(frozen=True, slots=True)
class Layer:
    """A table of places: their names, and numbers (n, k) by columns, the first three of which are coordinates."""

    name: str
    columns: tuple[str, ...]
    names: tuple[str, ...]
    values: FloatArray


def point_layer(project: ExchangedProject) -> Layer:
    """Return points; standard deviations in ground units, the direction of the major axis in degrees from X to Y."""
    points = project.points
    nothing = np.full((len(points.names), 3), np.nan)
    deviations = nothing if points.covariance is None else np.sqrt(np.einsum("nii->ni", points.covariance))
    ellipse = nothing if points.ellipse is None else points.ellipse * [1.0, 1.0, 180.0 / math.pi]
    residual = nothing[:, 0] if points.residual is None else points.residual
    return Layer(
        "points", POINT_COLUMNS, points.names, np.column_stack([points.coordinates, deviations, ellipse, residual])
    )


def photo_layer(project: ExchangedProject) -> Layer:
    """Return photos that are oriented: projection centres and angles in degrees."""
    photos = [photo for photo in project.photos if photo.position and photo.rotation]
    rows = [[*photo.position, *(photo.position_deviation or [math.nan] * 3), *photo.rotation] for photo in photos]
    values = np.array(rows, dtype=np.float64).reshape(-1, len(PHOTO_COLUMNS))
    return Layer("photos", PHOTO_COLUMNS, tuple(photo.name for photo in photos), values)


def magnification(points: Layer) -> float:
    """Return the power of ten by which error ellipses are drawn larger: to about a hundredth of the block."""
    axes = points.values[:, POINT_COLUMNS.index("semi_major")]
    axes = axes[np.isfinite(axes) & (axes > 0.0)]
    if not axes.size:
        return 1.0
    extent = float(np.ptp(points.values[:, :2], axis=0).max())
    wanted = _OF_EXTENT * extent / float(np.median(axes))
    return 10.0 ** round(math.log10(wanted)) if wanted > 0.0 else 1.0


def ellipses(points: Layer, factor: float) -> list[tuple[str, FloatArray]]:
    """Return the outlines (37, 2), closed, of the error ellipses that are known, by the names of the points."""
    angles = np.linspace(0.0, 2.0 * math.pi, _CORNERS + 1)
    found = []
    start = POINT_COLUMNS.index("semi_major")
    for name, row in zip(points.names, points.values, strict=True):
        major, minor, direction = row[start : start + 3]
        if not np.isfinite(major):
            continue
        cosine, sine = math.cos(math.radians(direction)), math.sin(math.radians(direction))
        along, across = factor * major * np.cos(angles), factor * minor * np.sin(angles)
        outline = np.column_stack([along * cosine - across * sine, along * sine + across * cosine]) + row[:2]
        found.append((name, outline))
    return found
