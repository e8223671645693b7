"""Error ellipses: correlations of coordinates against dense matrices, and axes against eigenvectors."""

from __future__ import annotations

import re

import numpy as np
import pytest
from bundle.solving import OFF, noisy, redefined, solved
from support.synthetic_block import synthetic_block

from orip.bundle.results.covariance import covariance, photo_figures
from orip.bundle.results.solution import solution_of
from orip.bundle.unknowns import CONSTANT
from orip.report.drawings.ellipses import drawn_points, ellipse_views, standard_ellipses
from orip.structs import replace

PAIRS = ((0, 1), (0, 2), (1, 2))


@pytest.fixture(scope="module")
def adjusted():
    return solved(redefined(noisy(synthetic_block("convergent", "control"), 5), **OFF))


def test_correlations_are_those_of_the_dense_inverse(adjusted) -> None:
    equations = adjusted.equations
    design = equations.design[equations.active]
    design = design.toarray() if hasattr(design, "toarray") else design
    covariance = np.linalg.inv(design.T @ design)
    sd = np.sqrt(np.diag(covariance))
    found = solution_of(adjusted)
    compared = 0
    for columns, shown in (
        (adjusted.problem.unknowns.photos[:, :3], found.photo_correlations[:, :3]),
        (adjusted.problem.unknowns.points, found.point_correlations),
    ):
        for place, row in zip(columns, shown, strict=True):
            for (a, b), r in zip(PAIRS, row, strict=True):
                if CONSTANT in (place[a], place[b]):
                    assert np.isnan(r)
                    continue
                expected = covariance[place[a], place[b]] / (sd[place[a]] * sd[place[b]])
                # the inverse of a matrix of condition 1e8 or so keeps eight digits
                assert r == pytest.approx(expected, abs=1e-6)
                compared += 1
    assert compared > 60


def test_correlations_of_photos_are_those_of_the_whole_matrix(adjusted) -> None:
    found = solution_of(adjusted).photo_correlations
    for photo, row in enumerate(found):
        matrix = covariance(adjusted, [photo_figures(adjusted, photo)], [photo_figures(adjusted, photo)])
        sd = np.sqrt(np.diag(matrix))
        # the inverse of a matrix of condition 1e8 or so keeps eight digits
        np.testing.assert_allclose(row, (matrix / np.outer(sd, sd))[np.tril_indices(6, -1)], atol=1e-6)


def test_axes_are_the_eigenvectors() -> None:
    random = np.random.default_rng(4)
    root = random.normal(size=(50, 2, 2))
    covariance = root @ root.transpose(0, 2, 1)
    sd = np.sqrt(np.einsum("nii->ni", covariance))
    found = standard_ellipses(sd[:, 0], sd[:, 1], covariance[:, 0, 1] / sd.prod(axis=1))
    values, vectors = np.linalg.eigh(covariance)
    # the smaller eigenvalue is a difference: its digits are those of the larger one
    np.testing.assert_allclose(found.major**2, values[:, 1], rtol=1e-12)
    np.testing.assert_allclose(found.minor**2, values[:, 0], atol=1e-12 * values[:, 1].max())
    across = np.cos(found.angle) * vectors[:, 1, 1] - np.sin(found.angle) * vectors[:, 0, 1]
    np.testing.assert_allclose(across, 0.0, atol=1e-7)


def test_a_constant_coordinate_has_no_ellipse() -> None:
    found = standard_ellipses(np.array([np.nan]), np.array([1.0]), np.array([np.nan]))
    assert np.isnan(found.major).all()


def test_the_drawing_has_an_ellipse_for_each_place_with_deviations(adjusted) -> None:
    found = solution_of(adjusted)
    views = ellipse_views(replace(found, ground_unit="m"))
    assert views is not None
    expected = int(
        np.isfinite(found.points.sd).all(axis=1).sum() + np.isfinite(found.photos.sd[:, :3]).all(axis=1).sum()
    )
    assert [view.picture.count("<ellipse") for view in views.views] == [expected] * 3


def test_the_ellipse_of_a_weak_photo_is_not_cut_off_by_the_frame(adjusted) -> None:
    found = solution_of(adjusted)
    sd = found.photos.sd * np.where(np.arange(len(found.photos.sd)) == 0, 4.0, 1.0)[:, None]
    views = ellipse_views(replace(found, ground_unit="m", photos=replace(found.photos, sd=sd)))
    assert views is not None
    for view in views.views:
        left, top, width, height = map(float, re.search(r'<svg x=.*?viewBox="([^"]+)"', view.picture)[1].split())
        for found in re.finditer(
            r'<ellipse rx="(.+?)" ry="(.+?)".*?translate\((.+?) (.+?)\) rotate\((.+?)\)', view.picture
        ):
            major, minor, x, y, turn = map(float, found.groups())
            across = np.hypot(major * np.cos(np.radians(turn)), minor * np.sin(np.radians(turn)))
            up = np.hypot(major * np.sin(np.radians(turn)), minor * np.cos(np.radians(turn)))
            assert left <= x - across
            assert x + across <= left + width
            assert top <= y - up
            assert y + up <= top + height


def test_a_solution_without_correlations_is_not_drawn(adjusted) -> None:
    assert ellipse_views(replace(solution_of(adjusted), point_correlations=np.empty((0, 3)))) is None


def test_control_is_never_thinned_away(adjusted) -> None:
    found = solution_of(adjusted)
    kinds = ("tie",) * 1000 + ("control",) * 7 + ("check",) * 3
    rows = drawn_points(replace(found, point_kinds=kinds), 110)
    assert set(range(1000, 1010)) <= set(rows.tolist())
    assert len(rows) <= 110
    assert np.ptp(np.diff(rows[rows < 1000])) == 0, "tie points are drawn evenly"
