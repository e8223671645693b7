"""Photos of points, computed from the formulas of docs/conventions.md without orip's geometry."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from orip.prelim.rays import ImageRays


def rotation_of(omega: float, phi: float, kappa: float) -> np.ndarray:
    """Return R = Rx(omega) Ry(phi) Rz(kappa), photo to ground; degrees."""
    return Rotation.from_euler("XYZ", [omega, phi, kappa], degrees=True).as_matrix()


def seen(points: np.ndarray, rotation: np.ndarray, centre: np.ndarray, principal_distance: float) -> np.ndarray:
    """Return the image vectors (n, 3) of points that all lie in front of the camera."""
    in_photo = (points - centre) @ rotation
    assert (in_photo[:, 2] < 0.0).all()
    return in_photo * (-principal_distance / in_photo[:, 2:])


def points_seen(
    generator: np.random.Generator, count: int, rotation: np.ndarray, centre: np.ndarray, principal_distance: float,
    frame: float, distances: tuple[float, float],
) -> np.ndarray:  # fmt: skip
    """Return points (count, 3) all over the frame (mm, its side) at distances along the camera's axis."""
    xy = generator.uniform(-frame / 2.0, frame / 2.0, (count, 2))
    vectors = np.column_stack([xy, np.full(count, -principal_distance)]) / principal_distance
    return centre + generator.uniform(*distances, (count, 1)) * (vectors @ rotation.T)


def with_noise(generator: np.random.Generator, vectors: np.ndarray, noise_mm: float) -> np.ndarray:
    """Return image vectors with noise in x and y."""
    noise = generator.normal(0.0, noise_mm, (len(vectors), 3))
    noise[:, 2] = 0.0
    return vectors + noise


def rays_of(
    points: np.ndarray, rotations: np.ndarray, centres: np.ndarray, principal_distance: float, frame: float,
    generator: np.random.Generator, noise_mm: float, error_mm: float = 0.005,
) -> ImageRays:  # fmt: skip
    """Return the rays of all points that fall within the photos' frame (mm, its side), in random order."""
    photo, point, vectors = [], [], []
    for index, (rotation, centre) in enumerate(zip(rotations, centres, strict=True)):
        ahead = np.flatnonzero(((points - centre) @ rotation)[:, 2] < 0.0)
        found = seen(points[ahead], rotation, centre, principal_distance)
        inside = np.abs(found[:, :2]).max(axis=1) < frame / 2.0
        photo.append(np.full(int(inside.sum()), index))
        point.append(ahead[inside])
        vectors.append(found[inside])
    order = generator.permutation(sum(map(len, photo)))
    noisy = with_noise(generator, np.concatenate(vectors)[order], noise_mm)
    return ImageRays(
        photos=tuple(f"P{index}" for index in range(len(centres))),
        points=tuple(f"{index}" for index in range(len(points))),
        photo=np.concatenate(photo)[order],
        point=np.concatenate(point)[order],
        xy=noisy[:, :2],
        vectors=noisy,
        error=np.full(len(order), error_mm),
    )
