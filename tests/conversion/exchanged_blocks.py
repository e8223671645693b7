"""A small block as another program would have it, in a reading of its poses; and cameras of several formulas."""

from __future__ import annotations

import numpy as np

from orip.exchange.conversion.poses import exchanged_poses
from orip.geometry.rotation import rotation_from_angles
from orip.records.exchanged import (
    ExchangedCamera,
    ExchangedPhoto,
    ExchangedPoints,
    ExchangedProject,
    ExchangedRays,
    PoseReading,
)

PINHOLE = ExchangedCamera(
    "1", 4000, 3000, "opencv", {"fx": 3000.0, "fy": 3000.0, "cx": 2010.0, "cy": 1490.0}, "PINHOLE"
)

OBLIQUE = np.array(
    [[0.3, -0.2, 0.1], [-0.4, 0.25, 1.2], [0.1, 0.5, -2.0], [0.35, 0.1, 2.9], [-0.2, -0.45, 0.4], [0.0, 0.3, 0.8]]
)
"""Omega, phi, kappa of photos that look down and to all sides, radians."""


def block(reading: PoseReading, angles: np.ndarray = OBLIQUE, noise_px: float = 0.0) -> ExchangedProject:
    """Return photos 100 above a field of points, measured with `PINHOLE`, their poses written as the reading says."""
    rng = np.random.default_rng(20)
    points = np.column_stack([rng.uniform(-60.0, 60.0, (60, 2)), rng.uniform(-8.0, 8.0, 60)])
    rotations = rotation_from_angles(angles)
    # a photo that looks to the side stands on the other one, so that it sees the field
    centres = 100.0 * rotations[:, :, 2] * np.array([1.0, 1.0, 0.0]) + np.array([0.0, 0.0, 100.0])
    numbers, positions = exchanged_poses(rotations, centres, reading)
    photos = tuple(
        ExchangedPhoto(f"{n}.jpg", 0, tuple(numbers[n]), tuple(positions[n]), key=n) for n in range(len(angles))
    )
    photo, point = (a.ravel() for a in np.meshgrid(np.arange(len(angles)), np.arange(len(points)), indexing="ij"))
    u = np.einsum("nji,nj->ni", rotations[photo], points[point] - centres[photo])
    image = 3000.0 * np.column_stack([-u[:, 0] / u[:, 2], u[:, 1] / u[:, 2]]) + np.array([2010.0, 1490.0])
    assert (u[:, 2] < 0.0).all()
    image += rng.normal(0.0, noise_px, image.shape) if noise_px else 0.0
    count = len(photo)
    return ExchangedProject(
        "",
        (PINHOLE,),
        photos,
        ExchangedPoints(tuple(map(str, range(len(points)))), points, np.ones(len(points), dtype=np.bool_)),
        ExchangedRays(photo, point, image, np.full(count, np.nan), np.ones(count, dtype=np.bool_)),
        (reading,),
    )
