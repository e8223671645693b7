"""Residual vectors: those of residuals.csv, photo by photo, and their means with a test for a pattern."""

from __future__ import annotations

import numpy as np
import pytest
from report.sample_pages import sample
from scipy.stats import chi2

from orip.report.drawings.residual_vectors import cell_means
from orip.report.report_input import PhotoVectors, photo_vectors

LOW, HIGH = np.array([-18.0, -12.0]), np.array([18.0, 12.0])


def scattered(systematic: float, count: int = 2000) -> PhotoVectors:
    """Return points all over the frame whose residuals are random, and systematic to the right in its right half."""
    random = np.random.default_rng(8)
    xy = random.uniform(LOW, HIGH, (count, 2))
    residual = random.normal(0.0, 0.003, (count, 2))
    residual[xy[:, 0] > 0.0, 0] += systematic
    return PhotoVectors("P", xy, residual, np.ones(count, dtype=bool))


def test_every_photo_point_is_in_its_photo() -> None:
    solution = sample("small_frame_block").solution
    residuals, found = solution.residuals, photo_vectors(solution.residuals)
    assert set(found) == set(solution.photos.names)
    expected = {
        (photo, residuals.observed[row], residuals.residual[row], residuals.residual[row + 1])
        for row, (kind, photo, component) in enumerate(
            zip(residuals.kind, residuals.photo, residuals.component, strict=True)
        )
        if kind == "photo" and component == "x"
    }
    assert {
        (name, xy[0], *residual)
        for name, vectors in found.items()
        for xy, residual in zip(vectors.xy, vectors.residual, strict=True)
    } == expected
    assert sum(int((~vectors.sound).sum()) for vectors in found.values()) == 2, "the two blunders of the sample"


def test_means_are_those_of_each_cell() -> None:
    found = scattered(0.0)
    means = cell_means([found], LOW, HIGH)
    assert means is not None
    assert len(means.count) == 24, "cells are square: 6 times 4 of 6 mm"
    assert means.count.sum() == 2000
    for centre, mean, count in zip(means.centre, means.mean, means.count, strict=True):
        inside = (np.abs(found.xy - centre) <= 3.0).all(axis=1)
        assert inside.sum() == count
        np.testing.assert_allclose(mean, found.residual[inside].mean(axis=0), atol=1e-15)


def test_chance_is_told_from_a_pattern() -> None:
    by_chance, systematic = (cell_means([scattered(size)], LOW, HIGH) for size in (0.0, 0.001))
    assert by_chance is not None
    assert systematic is not None
    assert by_chance.p > 0.01
    assert systematic.p < 1e-6


def test_the_probability_is_that_of_chi_square() -> None:
    found = scattered(0.0004)
    means = cell_means([found], LOW, HIGH)
    assert means is not None
    statistic = (means.count[:, None] * means.mean**2).sum() / np.mean(found.residual**2)
    assert means.p == pytest.approx(chi2.sf(statistic, 48), rel=1e-9)


def test_what_is_down_weighted_has_no_part_in_means() -> None:
    found = scattered(0.0, 40)
    found.residual[7] = 9.9
    found.sound[7] = False
    means = cell_means([found], LOW, HIGH)
    assert means is not None
    assert np.abs(means.mean).max() < 0.02
    assert cell_means([], LOW, HIGH) is None
