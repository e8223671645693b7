"""Heights and slopes of terrain models, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from pyproj import CRS

from orip.geometry.height_grid import other_system, surface_at
from orip.records.ground import HeightGrid

TURN = np.array([[0.8, 0.6], [0.6, -0.8]])


def grid_of(height, crs: str | None = None, size: float = 2.0) -> HeightGrid:
    """Return 30 rows and 40 columns of a function of X and Y; pixels lie across the axes."""
    column, row = np.meshgrid(np.arange(40.0) + 0.5, np.arange(30.0) + 0.5)
    back = np.linalg.inv(TURN / size)
    x, y = np.einsum("ij,jkl->ikl", back, np.array([column, row])) + np.array([100.0, 200.0])[:, None, None]
    at = -(TURN / size) @ [100.0, 200.0]
    (a, b), (d, e) = (TURN / size).tolist()
    return HeightGrid(height(x, y), (a, b, float(at[0]), d, e, float(at[1])), crs)


def places(grid: HeightGrid, column, row) -> np.ndarray:
    a, b, c, d, e, f = grid.to_pixels
    return np.linalg.solve([[a, b], [d, e]], np.array([np.subtract(column, c), np.subtract(row, f)])).T


def test_a_plane_is_exact_up_to_the_border():
    grid = grid_of(lambda x, y: 0.3 * x - 0.7 * y + 5.0)
    at = places(grid, [0.0, 0.2, 20.3, 39.9, 40.0], [0.0, 29.9, 11.1, 0.1, 30.0])
    found = surface_at(grid, at)
    assert found.known.all()
    assert np.allclose(found.height, at @ [0.3, -0.7] + 5.0, atol=1e-11)
    assert np.allclose(found.slope, [0.3, -0.7], atol=1e-12)


def test_a_surface_of_the_second_degree_is_exact_away_from_the_border():
    grid = grid_of(lambda x, y: 0.01 * (x - 130.0) ** 2 - 0.02 * (x - 130.0) * (y - 190.0))
    at = places(grid, [2.0, 20.3, 37.5], [2.1, 11.1, 27.0])
    x, y = at.T - np.array([[130.0], [190.0]])
    found = surface_at(grid, at)
    assert np.allclose(found.height, 0.01 * x**2 - 0.02 * x * y, atol=1e-11)
    assert np.allclose(found.slope, np.stack([0.02 * x - 0.02 * y, -0.02 * x], axis=1), atol=1e-11)


def test_slopes_have_no_steps_between_pixels():
    grid = grid_of(lambda x, _: np.random.default_rng(1).normal(size=x.shape))
    column = np.array([1.5, 7.5, 38.5])
    before, after = (surface_at(grid, places(grid, column + off, [4.2, 9.5, 20.1])) for off in (-1e-9, 1e-9))
    assert np.allclose(before.slope, after.slope, atol=1e-7)


def test_nothing_is_known_outside_and_about_holes():
    grid = grid_of(lambda x, _: x)
    grid.heights[10, 10] = np.nan
    at = places(grid, [-0.1, 40.1, 20.0, 10.5, 12.4, 12.6], [5.0, 5.0, 30.1, 10.5, 10.5, 10.5])
    found = surface_at(grid, np.vstack([at, [[1e30, 1e30]]]))
    assert found.known.tolist() == [False, False, False, False, False, True, False]
    assert not found.height[:5].any()


@pytest.mark.parametrize(
    ("own", "project", "message"),
    [
        (None, "EPSG:25832", None),
        ("EPSG:25832", None, None),
        ("EPSG:25832", "EPSG:25832+7837", None),
        ("EPSG:25832+7837", "EPSG:25832+7837", None),
        ("EPSG:25833", "EPSG:25832", "UTM zone 33N"),
        ("EPSG:4326", "EPSG:25832", "WGS 84"),
        ("EPSG:25832+7837", "EPSG:25832", "DHHN2016 height, those of the project above the ellipsoid"),
        ("EPSG:25832+5783", "EPSG:25832+7837", "DHHN92 height, those of the project in DHHN2016 height"),
    ],
)
def test_another_system_than_that_of_the_project_is_named(own, project, message):
    grid = grid_of(lambda x, _: x, None if own is None else CRS.from_user_input(own).to_wkt())
    found = other_system(grid, project)
    assert found is None if message is None else message in found
