"""Spatial similarity against published values, scipy and exact data."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from orip.geometry.rotation import rotation_about_axes
from orip.geometry.similarity import (
    Similarity,
    fit_similarities,
    fit_similarity,
    several,
    similarity_with_partials,
)

STATIONS = np.array(
    [
        [4157222.543, 664789.307, 4774952.099, 4157870.237, 664818.678, 4775416.524],
        [4149043.336, 688836.443, 4778632.188, 4149691.049, 688865.785, 4779096.588],
        [4172803.511, 690340.078, 4758129.701, 4173451.354, 690369.375, 4758594.075],
        [4177148.376, 642997.635, 4760764.800, 4177796.064, 643026.700, 4761228.899],
        [4137012.190, 671808.029, 4791128.215, 4137659.549, 671837.337, 4791592.531],
        [4146292.729, 666952.887, 4783859.856, 4146940.228, 666982.151, 4784324.099],
        [4138759.902, 702670.738, 4785552.196, 4139407.506, 702700.227, 4786016.645],
    ]
)
"""Seven stations in Württemberg, local and WGS 84 (Grafarend and Awange 2003, J. Geodesy 77: 66-76)."""


def random_similarity(generator: np.random.Generator) -> Similarity:
    rotation = Rotation.random(rng=generator).as_matrix()
    return Similarity(float(np.exp(generator.normal())), rotation, generator.normal(0.0, 5.0, 3))


def test_datum_transformation_of_grafarend_and_awange():
    fit = fit_similarity(STATIONS[:, :3], STATIONS[:, 3:])
    # to the digits that were published
    assert fit.scale == pytest.approx(1.00000558251985, abs=1e-13)
    assert np.allclose(fit.shift, [641.8804, 68.6553, 416.3982], atol=5e-5)


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("count", [3, 4, 12])
def test_exact_points_give_the_similarity_back(seed, count):
    generator = np.random.default_rng(seed)
    truth, source = random_similarity(generator), generator.normal(0.0, 2.0, (count, 3))
    fit = fit_similarity(source, truth.apply(source))
    # rounding of a triangle that is some ten times longer than wide
    assert fit.scale == pytest.approx(truth.scale, rel=1e-10)
    assert np.allclose(fit.rotation, truth.rotation, atol=1e-10)
    assert np.allclose(fit.shift, truth.shift, atol=1e-9)
    assert np.linalg.det(fit.rotation) == pytest.approx(1.0, abs=1e-13)


@pytest.mark.parametrize("seed", range(5))
def test_rotation_is_that_of_scipy_and_all_is_the_least_squares_solution(seed):
    generator = np.random.default_rng(seed)
    truth, source = random_similarity(generator), generator.normal(0.0, 2.0, (8, 3))
    target = truth.apply(source) + generator.normal(0.0, 0.05, (8, 3))
    weights = generator.uniform(0.2, 3.0, 8)
    fit = fit_similarity(source, target, weights)
    x = source - np.average(source, axis=0, weights=weights)
    big = target - np.average(target, axis=0, weights=weights)
    assert np.allclose(fit.rotation, Rotation.align_vectors(big, x, weights)[0].as_matrix(), atol=1e-9)

    def residuals(p):
        turned = source @ Rotation.from_rotvec(p[4:]).as_matrix().T
        return (np.sqrt(weights)[:, None] * (p[0] * turned + p[1:4] - target)).ravel()

    start = np.concatenate([[1.0], truth.shift, Rotation.from_matrix(truth.rotation).as_rotvec()])
    found = least_squares(residuals, start, xtol=1e-15, ftol=1e-15, gtol=1e-15).x
    # numerical partials there leave some 1e-8
    assert np.allclose([fit.scale, *fit.shift], found[:4], atol=1e-6)


def test_points_that_fit_only_mirrored_are_not_reflected():
    source = np.random.default_rng(4).normal(size=(6, 3))
    target = source * [1.0, 1.0, -1.0]
    assert np.linalg.det(fit_similarity(source, target).rotation) == pytest.approx(1.0)


def test_points_in_a_plane_are_no_mirror_image():
    source = np.array([[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [4.0, 3.0, 0.0], [0.0, 3.0, 0.0]])
    # a quarter turn about Z, doubled, shifted by (10, 20, 30): (x, y) -> (10 - 2 y, 20 + 2 x)
    target = np.array([[10.0, 20.0, 30.0], [10.0, 28.0, 30.0], [4.0, 28.0, 30.0], [4.0, 20.0, 30.0]])
    fit = fit_similarity(source, target)
    assert fit.scale == pytest.approx(2.0)
    assert np.allclose(fit.rotation, [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]], atol=1e-13)
    assert np.allclose(fit.shift, [10.0, 20.0, 30.0], atol=1e-12)


def test_points_on_a_line_are_refused():
    line = np.outer([0.0, 1.0, 2.0, 5.0], [1.0, 2.0, 3.0])
    with pytest.raises(ValueError, match="on one line"):
        fit_similarity(line, line + 7.0)
    with pytest.raises(ValueError, match="2 common points, 3 are needed"):
        fit_similarity(line[:2], line[:2])


def test_samples_on_a_line_are_left_out():
    generator = np.random.default_rng(1)
    source = generator.normal(size=(5, 3, 3))
    source[2] = np.outer([0.0, 1.0, 2.0], [1.0, 0.0, 0.0])
    truth = random_similarity(generator)
    fits = fit_similarities(source, truth.apply(source))
    assert fits.scale == pytest.approx(np.full(4, truth.scale))
    assert np.allclose(fits.apply(source[0])[3], truth.apply(source[0]), atol=1e-9)


def test_inverse_and_composition():
    generator = np.random.default_rng(2)
    first, second = random_similarity(generator), random_similarity(generator)
    xyz = generator.normal(size=(4, 3))
    assert np.allclose(first.inverse().apply(first.apply(xyz)), xyz, atol=1e-12)
    assert np.allclose(second.after(first).apply(xyz), second.apply(first.apply(xyz)), atol=1e-10)


def test_unknowns_move_scale_shift_and_rotation():
    truth = random_similarity(np.random.default_rng(3))
    change = np.array([0.1, 1.0, 2.0, 3.0, 0.01, -0.02, 0.03])
    moved = several([truth]).moved(change[None]).one(0)
    assert moved.scale == pytest.approx(truth.scale * np.exp(0.1))
    assert np.allclose(moved.shift, truth.shift + np.array([1.0, 2.0, 3.0]))
    assert np.allclose(moved.rotation, rotation_about_axes(change[4:]) @ truth.rotation)
    xyz = np.array([[1.0, 2.0, 3.0]])
    assert np.allclose(similarity_with_partials(several([truth]), xyz).value[0], truth.apply(xyz))
