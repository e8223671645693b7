"""Three-point resection against published solutions, Grunert's quartic and known truth."""

from __future__ import annotations

import numpy as np
import pytest
from support.prelim_references.three_points import three_point_resection
from support.seen_points import points_seen, rotation_of, seen

VIEWS = [
    (0.0, 0.0, 0.0),
    (3.0, -5.0, 170.0),
    (90.0, 0.0, 0.0),
    (0.0, 90.0, 0.0),
    (40.0, -90.0, 0.0),
    (180.0, 10.0, -70.0),
]


def solve(vectors, points):
    found = three_point_resection(np.array(vectors, dtype=float)[None], np.array(points, dtype=float)[None])
    return found.rotations[0][found.valid[0]], found.centres[0][found.valid[0]]


def distances(points, centres):
    return np.linalg.norm(np.asarray(points)[None] - centres[:, None], axis=2)


def test_four_solutions_of_fischler_and_bolles():
    """Fischler and Bolles (1981): an equilateral triangle of side 2 sqrt(3), all angles with the cosine 5/8."""
    radius = 2.0
    turns = np.radians([90.0, 210.0, 330.0])
    triangle = np.column_stack([radius * np.cos(turns), radius * np.sin(turns), np.zeros(3)])
    # seen from straight above at the distance 4
    vectors = triangle - [0.0, 0.0, np.sqrt(12.0)]
    rotations, centres = solve(vectors, triangle)
    found = np.sort(distances(triangle, centres), axis=1)
    assert np.allclose(found[np.argsort(found[:, 0])], [[1, 4, 4], [1, 4, 4], [1, 4, 4], [4, 4, 4]], atol=1e-12)
    assert np.allclose(rotations @ np.swapaxes(rotations, 1, 2), np.eye(3), atol=1e-12)


def grunert_distances(cos_a, cos_b, cos_g, a2, b2, c2):
    """Return the positive distances by the quartic as reviewed by Haralick, Lee, Ottenberg and Nölle (1994)."""
    p, q, r = (a2 - c2) / b2, (a2 + c2) / b2, c2 / b2
    quartic = [
        (p - 1.0) ** 2 - 4.0 * r * cos_a**2,
        4.0 * (p * (1.0 - p) * cos_b - (1.0 - q) * cos_a * cos_g + 2.0 * r * cos_a**2 * cos_b),
        2.0 * (p**2 - 1.0 + 2.0 * p**2 * cos_b**2 + 2.0 * (b2 - c2) / b2 * cos_a**2 - 4.0 * q * cos_a * cos_b * cos_g
               + 2.0 * (b2 - a2) / b2 * cos_g**2),
        4.0 * (-p * (1.0 + p) * cos_b + 2.0 * a2 / b2 * cos_g**2 * cos_b - (1.0 - q) * cos_a * cos_g),
        (1.0 + p) ** 2 - 4.0 * a2 / b2 * cos_g**2,
    ]  # fmt: skip
    found = []
    for root in np.roots(quartic):
        v = root.real
        if abs(root.imag) < 1e-7 and v > 0.0:
            u = ((-1.0 + p) * v**2 - 2.0 * p * cos_b * v + 1.0 + p) / (2.0 * (cos_g - v * cos_a))
            s = np.sqrt(b2 / (1.0 + v**2 - 2.0 * v * cos_b))
            if u > 0.0:
                found.append([s, u * s, v * s])
    return np.array(sorted(found)).reshape(-1, 3)


@pytest.mark.slow
def test_all_solutions_are_those_of_grunerts_quartic():
    generator = np.random.default_rng(1)
    counts = np.zeros(5, dtype=int)
    for _ in range(300):
        rotation, centre = rotation_of(*generator.uniform(-180.0, 180.0, 3)), generator.normal(0.0, 5.0, 3)
        points = points_seen(generator, 3, rotation, centre, 100.0, 150.0, (10.0, 30.0))
        vectors = seen(points, rotation, centre, 100.0)
        unit = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
        sides = [np.sum((points[i] - points[j]) ** 2) for i, j in ((1, 2), (0, 2), (0, 1))]
        expected = grunert_distances(unit[1] @ unit[2], unit[0] @ unit[2], unit[0] @ unit[1], *sides)
        _, centres = solve(vectors, points)
        found = distances(points, centres)
        counts[len(found)] += 1
        # roots of a quartic lose half of the digits where two of them come close
        for solution in found:
            assert np.abs(expected - solution).max(axis=1).min() < 1e-4
        for solution in expected:
            assert np.abs(found - solution).max(axis=1).min() < 1e-4
    assert counts[1:].min() > 0


@pytest.mark.parametrize("view", VIEWS)
def test_truth_is_among_the_solutions_in_any_attitude(view):
    generator = np.random.default_rng(2)
    rotation, centre = rotation_of(*view), np.array([1000.0, -500.0, 200.0])
    points = np.stack([points_seen(generator, 3, rotation, centre, 50.0, 36.0, (80.0, 120.0)) for _ in range(200)])
    vectors = np.stack([seen(point, rotation, centre, 50.0) for point in points])
    found = three_point_resection(vectors, points)
    error = np.where(found.valid, np.linalg.norm(found.centres - centre, axis=2), np.inf)
    nearest = error.argmin(axis=1)
    # the worst of many triangles, thin ones among them, lose some five of sixteen digits
    assert np.median(error.min(axis=1)) < 1e-9
    assert error.min(axis=1).max() < 1e-4
    assert np.median(np.abs(found.rotations[np.arange(200), nearest] - rotation).max(axis=(1, 2))) < 1e-11


def test_every_solution_sees_the_points_ahead_in_their_directions():
    generator = np.random.default_rng(3)
    points, vectors = generator.normal(0.0, 3.0, (500, 3, 3)), generator.normal(0.0, 20.0, (500, 3, 3))
    vectors[:, :, 2] = -50.0
    found = three_point_resection(vectors, points)
    in_photo = (points[:, None] - found.centres[:, :, None]) @ found.rotations
    unit = vectors / np.linalg.norm(vectors, axis=2, keepdims=True)
    in_photo /= np.linalg.norm(in_photo, axis=3, keepdims=True)
    assert found.valid.sum() > 500
    assert np.abs(in_photo - unit[:, None])[found.valid].max() < 1e-6
    assert np.linalg.det(found.rotations[found.valid]) == pytest.approx(1.0)


def test_points_on_one_line_or_images_in_one_place_have_no_solution():
    line = [[0.0, 0.0, 0.0], [1.0, 1.0, 0.0], [3.0, 3.0, 0.0]]
    triangle = [[10.0, 0.0, -50.0], [0.0, 10.0, -50.0], [-10.0, 0.0, -50.0]]
    assert not len(solve(triangle, line)[1])
    assert not len(solve(triangle, [[1.0, 2.0, 3.0]] * 3)[1])
    assert not len(solve([triangle[0], triangle[0], triangle[1]], triangle)[1])


def test_no_triples_at_all():
    assert three_point_resection(np.empty((0, 3, 3)), np.empty((0, 3, 3))).valid.shape == (0, 4)
