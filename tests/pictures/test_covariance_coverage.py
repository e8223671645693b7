"""Do the 95 % regions of adjusted points hold the true ones in 95 of 100 cases? Blocks from rendered photos.

A tie point of matching is any place of the surface, so that only its height above the plane has a true value: an
interval. Check points are measured as an operator would, with normal errors: regions in space. The photos are details
of large ones: the patches of small photos with a wide angle are no longer affine to each other. The tie points lie so
far apart that their patches do not overlap, as those that are selected for a block.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from numpy.typing import NDArray
from pictures.rendered_plane import RenderedPlane, render
from scipy.stats import chi2

from orip import Block, Camera, ControlPoints, PhotoPoints, Photos, Solution
from orip.images.matching.least_squares import Fate, MatchSettings, Windows, match_rays
from orip.pictures.matching.tracks import HALF, cut_windows, in_window

SIDE, PHOTOS, TIES = 320, 5, 5
C, FOCAL = 100.0, 10.0
"""mm; times the side."""
MARK_ERROR, CONTROL_ERROR = 0.1, 0.05
"""Pixels; texels."""
LIMIT = chi2.ppf(0.95, (1, 2, 3))


def rendered(random: np.random.Generator) -> RenderedPlane:
    return render(PHOTOS, SIDE, random, noise=3.0, focal=FOCAL)


def block(plane: RenderedPlane, random: np.random.Generator) -> Solution:
    """Adjust a block: matched tie points T, and measured points G of which every second one is a check point."""
    size = 1.4 * SIDE
    grid = np.array([(x, y) for y in (0.36, 0.5, 0.64) for x in (0.36, 0.5, 0.64)]) * size
    photo, name, xy, error = (list(part) for part in zip(*matched(plane, random), strict=True))
    for number in range(PHOTOS):
        places = plane.pixels(number, grid) + MARK_ERROR * random.standard_normal(grid.shape)
        photo += [f"P{number}"] * len(grid)
        name += [f"G{at}" for at in range(len(grid))]
        xy += list(places)
        error += [np.full(2, MARK_ERROR)] * len(grid)
    ground = np.column_stack([grid[:, 0], -grid[:, 1], np.zeros(len(grid))])
    given = ground + CONTROL_ERROR * random.standard_normal(ground.shape)
    sign = np.where(np.arange(len(grid)) % 2, -1.0, 1.0)
    control = ControlPoints([f"G{at}" for at in range(len(grid))], given, (sign * CONTROL_ERROR)[:, None])
    sensor = {"columns": SIDE, "rows": SIDE, "width": C / FOCAL, "height": C / FOCAL}
    names = [f"P{number}" for number in range(PHOTOS)]
    points = PhotoPoints(photo, name, np.array(xy), np.array(error) * C / FOCAL / SIDE)
    return Block([Camera("C", c=C, sensor=sensor)], Photos(names, "C"), points, control).adjust()


def matched(
    plane: RenderedPlane, random: np.random.Generator
) -> Iterator[tuple[str, str, NDArray[np.float64], NDArray[np.float64]]]:
    """Yield photo, point, pixels and errors of rays, matched from features that are about a pixel off."""
    ticks = np.linspace(0.36, 0.64, TIES) * 1.4 * SIDE
    places = np.array([(x, y) for x in ticks for y in ticks]) + random.uniform(-3.0, 3.0, (TIES**2, 2))
    point, photo = (part.ravel() for part in np.indices((len(places), PHOTOS)))
    true = np.array([plane.pixels(k, places[p][None])[0] for p, k in zip(point, photo, strict=True)])
    inside = (np.abs(true - SIDE / 2) < SIDE / 2 - HALF).all(axis=1)
    inside &= np.bincount(point, weights=inside)[point] >= 2
    photo, true, number = photo[inside], true[inside], point[inside]
    point = np.unique(number, return_inverse=True)[1]
    shape = np.array([plane.partials(k, places[p]) for p, k in zip(number, photo, strict=True)])
    first = np.flatnonzero(np.diff(point, prepend=-1))[point]
    start = true + 0.7 * random.standard_normal(true.shape)
    affine = shape @ np.linalg.inv(shape[first]) + 0.05 * random.standard_normal(shape.shape)
    pixels = np.zeros((len(photo), 2 * HALF + 1, 2 * HALF + 1), dtype=np.uint8)
    for k, grey in enumerate(plane.photos):
        pixels[photo == k] = cut_windows(grey, start[photo == k])
    found = match_rays(Windows(point, pixels, in_window(start), affine), MatchSettings())
    place = start + found.centre - in_window(start)
    error = np.sqrt(np.diagonal(found.covariance, axis1=1, axis2=2))
    for ray in np.flatnonzero(found.fate == Fate.MATCHED).tolist():
        yield f"P{photo[ray]}", f"T{number[ray]}", place[ray], error[ray]


def inside(count: int, first_seed: int) -> tuple[float, float, int, int]:
    """Return which part of the regions of tie points and of check points hold the true ones, and their numbers."""
    ties, checks = [], []
    for seed in range(first_seed, first_seed + count):
        random = np.random.default_rng(seed)
        solution = block(rendered(random), random)
        for name in solution.points:
            point, at = solution.points[name], name[1:]
            if name[0] == "T":
                ties.append(point.coordinates[2] ** 2 / point.covariance[2, 2] < LIMIT[0])
            elif int(at) % 2:
                x, y = np.array([0.36, 0.5, 0.64])[[int(at) % 3, int(at) // 3]] * 1.4 * SIDE
                off = point.coordinates - (x, -y, 0.0)
                checks.append(off @ np.linalg.solve(point.covariance, off) < LIMIT[2])
    return float(np.mean(ties)), float(np.mean(checks)), len(ties), len(checks)


def test_regions_of_points_are_of_about_the_right_size() -> None:
    ties, _, count, _ = inside(1, 1)
    assert count > 15
    assert ties > 0.75


@pytest.mark.long
def test_regions_of_points_hold_what_they_say() -> None:
    ties, checks, of_ties, _ = inside(100, 100)
    assert of_ties > 2000
    assert 0.93 <= ties <= 0.97
    assert 0.92 <= checks <= 0.98  # 400 of them: two standard errors
