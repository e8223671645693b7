"""Plane transformations against solutions found in other ways."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.linalg import orthogonal_procrustes

from orip.geometry.plane import IDENTITY, MARKS_NEEDED, PARAMETERS, PlaneTransformation, fit_plane_transformation

SQUARE = np.array([[-12.0, -18.0], [12.0, -18.0], [12.0, 18.0], [-12.0, 18.0]])


def from_parameters(x0, y0, ro, sk, sx, sy):
    """Write the parameters out as docs/conventions.md does."""
    matrix = [[sx * np.cos(ro), -sy * np.sin(ro + sk)], [sx * np.sin(ro), sy * np.cos(ro + sk)]]
    return PlaneTransformation(np.array(matrix), np.array([x0, y0]))


def noisy_marks(seed, count=7):
    generator = np.random.default_rng(seed)
    measured = generator.uniform(0.0, 200.0, (count, 2))
    truth = from_parameters(3.0, -7.0, 0.3, 0.01, 1.002, 0.998)
    return measured, truth.apply(measured) + generator.normal(0.0, 0.02, (count, 2))


@pytest.mark.parametrize("seed", range(5))
def test_affine_is_the_least_squares_solution(seed):
    measured, given_xy = noisy_marks(seed)
    fit = fit_plane_transformation("A", measured, given_xy)
    design = np.column_stack([measured, np.ones(len(measured))])
    expected = np.linalg.lstsq(design, given_xy, rcond=None)[0]
    assert np.allclose(fit.matrix, expected[:2].T, atol=1e-12)
    assert np.allclose(fit.shift, expected[2], atol=1e-10)


@pytest.mark.parametrize("seed", range(5))
def test_conform_is_the_least_squares_solution(seed):
    measured, given_xy = noisy_marks(seed)
    fit = fit_plane_transformation("C", measured, given_xy)
    # X = x0 + a x - c y, Y = y0 + c x + a y: linear in a, c, x0, y0
    x, y = measured.T
    one, zero = np.ones_like(x), np.zeros_like(x)
    design = np.vstack([np.column_stack([x, -y, one, zero]), np.column_stack([y, x, zero, one])])
    a, c, x0, y0 = np.linalg.lstsq(design, given_xy.T.ravel(), rcond=None)[0]
    assert np.allclose(fit.matrix, [[a, -c], [c, a]], atol=1e-12)
    assert np.allclose(fit.shift, [x0, y0], atol=1e-10)


@pytest.mark.parametrize("seed", range(5))
def test_conform_without_scale_is_the_procrustes_rotation(seed):
    measured, given_xy = noisy_marks(seed)
    fit = fit_plane_transformation("W", measured, given_xy)
    rotation, _ = orthogonal_procrustes(measured - measured.mean(axis=0), given_xy - given_xy.mean(axis=0))
    assert np.allclose(fit.matrix, rotation.T, atol=1e-12)
    assert np.allclose(fit.apply(measured).mean(axis=0), given_xy.mean(axis=0), atol=1e-10)
    assert np.linalg.det(fit.matrix) == pytest.approx(1.0, abs=1e-14)


def test_example_worked_by_hand():
    # plate turned by 90 degrees and shifted by (110, 95): (x, y) -> (y - 95, 110 - x)
    plate = np.array([[110.0, 95.0], [110.0, 105.0], [90.0, 95.0], [90.0, 105.0]])
    photo = np.array([[0.0, 0.0], [10.0, 0.0], [0.0, 20.0], [10.0, 20.0]])
    for kind in ("A", "C", "W"):
        fit = fit_plane_transformation(kind, plate, photo)
        assert np.allclose(fit.matrix, [[0.0, 1.0], [-1.0, 0.0]], atol=1e-13)
        assert np.allclose(fit.shift, [-95.0, 110.0], atol=1e-11)
        assert np.degrees(fit.rotation_and_skew[0]) == pytest.approx(-90.0, abs=1e-10)


def test_four_fiducials_with_one_reading_off_leave_a_quarter_of_it_in_each_affine_residual():
    # hat matrix of a rectangle: 1/4 (1 + 1 + 1) = 3/4, so each corner keeps 1/4 of the error, signs alternating
    measured = SQUARE.copy()
    measured[0, 0] += 0.040
    fit = fit_plane_transformation("A", measured, SQUARE)
    residuals = fit.apply(measured) - SQUARE
    # exact except for the scale 1 - 0.0008 that the error brings along
    assert np.allclose(residuals[:, 0], [0.010, -0.010, 0.010, -0.010], rtol=2e-3)


def test_scale_of_shrunk_film_is_found_by_a_and_c_and_not_by_w():
    fits = {kind: fit_plane_transformation(kind, SQUARE * 0.999, SQUARE) for kind in ("A", "C", "W")}
    assert fits["A"].scales == pytest.approx((1.0 / 0.999, 1.0 / 0.999), rel=1e-13)
    assert fits["C"].scales == pytest.approx((1.0 / 0.999, 1.0 / 0.999), rel=1e-13)
    assert fits["W"].scales == pytest.approx((1.0, 1.0), rel=1e-15)


@given(
    st.floats(-500.0, 500.0), st.floats(-500.0, 500.0), st.floats(-3.14, 3.14), st.floats(-1.0, 1.0),
    st.floats(0.2, 5.0), st.floats(0.2, 5.0),
)  # fmt: skip
def test_parameters_come_back(x0, y0, ro, sk, sx, sy):
    transformation = from_parameters(x0, y0, ro, sk, sx, sy)
    assert transformation.scales == pytest.approx((sx, sy), rel=1e-12)
    found_ro, found_sk = transformation.rotation_and_skew
    assert found_ro == pytest.approx(ro, abs=1e-12)
    assert found_sk == pytest.approx(sk, abs=1e-12)
    fit = fit_plane_transformation("A", SQUARE, transformation.apply(SQUARE))
    assert np.allclose(fit.matrix, transformation.matrix, atol=1e-11)
    assert np.allclose(fit.shift, transformation.shift, atol=1e-10)


@given(st.floats(-3.14, 3.14), st.floats(-1.5, 1.5), st.floats(0.5, 2.0), st.floats(0.5, 2.0))
def test_inverse_and_product_undo_each_other(ro, sk, sx, sy):
    transformation = from_parameters(5.0, -3.0, ro, sk, sx, sy)
    there_and_back = transformation.inverse().after(transformation)
    assert np.allclose(there_and_back.matrix, np.eye(2), atol=1e-12)
    assert np.allclose(there_and_back.shift, 0.0, atol=1e-11)
    assert np.allclose(transformation.inverse().apply(transformation.apply(SQUARE)), SQUARE, atol=1e-11)


def test_product_applies_the_first_one_first():
    first, second = from_parameters(1.0, 2.0, 0.3, 0.0, 2.0, 2.0), from_parameters(-4.0, 0.0, -1.0, 0.1, 1.0, 3.0)
    assert np.allclose(second.after(first).apply(SQUARE), second.apply(first.apply(SQUARE)), atol=1e-12)
    assert np.array_equal(IDENTITY.apply(SQUARE), SQUARE)


def test_film_upside_down_is_mirrored_with_a_skew_of_180_degrees():
    fit = fit_plane_transformation("A", SQUARE * [1.0, -1.0], SQUARE)
    assert fit.mirrored
    assert np.degrees(fit.rotation_and_skew[1]) == 180.0
    assert not fit_plane_transformation("A", SQUARE, SQUARE).mirrored


@pytest.mark.parametrize("kind", ["A", "C", "W"])
def test_fewest_marks_fit_exactly_and_one_fewer_is_refused(kind):
    count = MARKS_NEEDED[kind]
    truth = from_parameters(5.0, 6.0, 0.2, 0.0, 1.0, 1.0)
    fit = fit_plane_transformation(kind, SQUARE[:count], truth.apply(SQUARE[:count]))
    assert np.allclose(fit.apply(SQUARE), truth.apply(SQUARE), atol=1e-12)
    assert PARAMETERS[kind] <= 2 * count
    with pytest.raises(ValueError, match=f"{count - 1} marks, {count} are needed"):
        fit_plane_transformation(kind, SQUARE[: count - 1], SQUARE[: count - 1])


@pytest.mark.parametrize("noise", [0.0, 0.005])
@pytest.mark.parametrize("swap", [False, True])
def test_marks_on_one_line_do_not_make_an_affine_orientation_even_with_measuring_errors(noise, swap):
    generator = np.random.default_rng(1)
    line = np.outer(np.linspace(-1.0, 1.0, 5), [80.0, 60.0]) + 100.0
    on_line = line + noise * generator.normal(size=line.shape)
    spread = generator.uniform(-100.0, 100.0, line.shape)
    pair = (spread, on_line) if swap else (on_line, spread)
    with pytest.raises(ValueError, match="on one line"):
        fit_plane_transformation("A", *pair)


@pytest.mark.parametrize("kind", ["A", "C", "W"])
@pytest.mark.parametrize("swap", [False, True])
def test_marks_in_one_place_do_not_make_an_orientation(kind, swap):
    # 0.1 is no binary number: the mean of three is off by the last digit, and the extent is not exactly zero
    place = np.full((3, 2), 0.1)
    pair = (SQUARE[:3], place) if swap else (place, SQUARE[:3])
    with pytest.raises(ValueError, match="in one place"):
        fit_plane_transformation(kind, *pair)


@pytest.mark.parametrize("kind", ["A", "C", "W"])
def test_marks_whose_names_are_interchanged_so_that_nothing_is_left_have_no_orientation(kind):
    given_xy = np.array([[1.0, 1.0], [-1.0, -1.0], [1.0, 1.0], [-1.0, -1.0]])
    if kind == "A":
        given_xy[:, 1] += np.array([0.0, 1.0, 2.0, 1.0])
    with pytest.raises(ValueError, match="arranged"):
        fit_plane_transformation(kind, SQUARE, given_xy)


@settings(max_examples=300)
@given(
    st.sampled_from(["A", "C", "W"]),
    st.lists(st.tuples(*[st.floats(allow_nan=False)] * 4), min_size=0, max_size=5),
)
@example("C", [(0.0, 0.0, 0.0, 0.0), (0.0, 2.2e-311, 0.0, 1.0)])
def test_any_marks_are_fitted_invertibly_or_refused(kind, rows):
    marks = np.array(rows, dtype=float).reshape(-1, 4)
    try:
        fit = fit_plane_transformation(kind, marks[:, :2], marks[:, 2:])
    except ValueError:
        return
    assert np.isfinite(fit.matrix).all()
    assert np.isfinite(fit.inverse().matrix).all()
