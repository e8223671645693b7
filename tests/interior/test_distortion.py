"""The camera's distortion: by hand at a point, backwards, in both arguments, and from other forms."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from orip.interior.distortion import (
    corrected_with_partials,
    curve_from_polynomial,
    distorted_with_partials,
    isp_from_polynomial,
    polynomial_from_curve,
    polynomial_from_isp,
    remove_distortion,
)
from orip.records.camera import CAMERA_PARAMETERS

SMALL_FORMAT = np.array([1e-3, -8e-5, 6e-8, -2e-11, 3e-14, 3e-5, -2e-5, 4e-4, -3e-4])
"""Some 0.3 mm of distortion in the corner of a 24 x 36 mm frame: A1 A3 A5 A7 A9 P1 P2 B1 B2."""

FRAME = np.stack(np.meshgrid(np.linspace(-18.0, 18.0, 9), np.linspace(-12.0, 12.0, 7)), axis=-1).reshape(-1, 2)


DISTORTION_PARAMETERS = CAMERA_PARAMETERS[3:12]


def coefficients(**values):
    return np.array([values.get(name, 0.0) for name in DISTORTION_PARAMETERS])


def distorted(xy, coefficients):
    """Return measured coordinates (n, 2) of ideal ones, for a polynomial at ideal coordinates."""
    return np.stack(distorted_with_partials(tuple(coefficients.T), *xy.T)[:2], axis=1)


def corrected(xy, coefficients):
    """Return ideal coordinates (n, 2) of measured ones, for a polynomial at measured coordinates."""
    return np.stack(corrected_with_partials(tuple(coefficients.T), *xy.T)[:2], axis=1)


def test_the_order_of_the_coefficients_is_that_of_the_camera():
    assert DISTORTION_PARAMETERS == ("A1", "A3", "A5", "A7", "A9", "P1", "P2", "B1", "B2")


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        # at (3, 4): r² = 25
        ("A1", (3.0, 4.0)),
        ("A3", (75.0, 100.0)),
        ("A5", (1875.0, 2500.0)),
        ("A7", (46875.0, 62500.0)),
        ("A9", (1171875.0, 1562500.0)),
        ("P1", (25.0 + 18.0, 24.0)),
        ("P2", (24.0, 25.0 + 32.0)),
        ("B1", (3.0, 0.0)),
        ("B2", (4.0, 0.0)),
    ],
)
def test_each_term_at_a_point_by_hand(name, expected):
    found = distorted(np.array([[3.0, 4.0]]), coefficients(**{name: 1e-5}))
    # numbers below 20 are rounded to 2e-15
    assert np.allclose(found, [[3.0, 4.0]] + 1e-5 * np.array([expected]), rtol=0.0, atol=2e-14)


def test_positive_radial_distortion_moves_the_image_outwards():
    radius = np.hypot(*FRAME.T)
    assert np.allclose(np.hypot(*distorted(FRAME, coefficients(A3=1e-5)).T), radius + 1e-5 * radius**3, atol=1e-13)


def test_terms_add_up():
    one_by_one = sum(
        distorted(FRAME, coefficients(**{name: value})) - FRAME
        for name, value in zip(DISTORTION_PARAMETERS, SMALL_FORMAT, strict=True)
    )
    # nine differences of numbers below 19, each rounded to 4e-15
    assert np.allclose(distorted(FRAME, SMALL_FORMAT) - FRAME, one_by_one, rtol=0.0, atol=3e-14)


def test_coefficients_of_each_point_are_its_own():
    own = SMALL_FORMAT * np.linspace(0.0, 2.0, len(FRAME))[:, None]
    together = distorted(FRAME, own)
    for row in (0, 7, 40):
        alone = distorted(FRAME[row : row + 1], own[row])
        assert np.array_equal(together[row], alone[0])


def test_distortion_is_removed_to_a_picometre():
    measured = distorted(FRAME, SMALL_FORMAT)
    # Newton's steps end below 1e-12 mm, and rounding of 18 mm is 4e-15
    assert np.allclose(remove_distortion(measured, SMALL_FORMAT), FRAME, atol=2e-12)


@given(
    st.tuples(st.floats(-18.0, 18.0), st.floats(-12.0, 12.0)), st.lists(st.floats(-1.0, 1.0), min_size=9, max_size=9)
)
def test_removing_and_adding_distortion_cancel(xy, share):
    given_coefficients = SMALL_FORMAT * share
    xy = np.array([xy])
    ideal = remove_distortion(xy, given_coefficients)
    assert np.allclose(distorted(ideal, given_coefficients), xy, atol=2e-12)


def test_where_the_polynomial_is_not_monotone_there_is_no_ideal_point_and_no_crash():
    # r - 1e-3 r³ has its maximum of 12.2 mm at r = 18.3 mm: nothing is imaged at 15 mm
    found = remove_distortion(np.array([[15.0, 0.0], [5.0, 0.0], [0.0, 0.0]]), coefficients(A3=-1e-3))
    assert np.isnan(found[0]).all()
    assert np.isfinite(found[1:]).all()


@pytest.mark.parametrize("radius", [12.5, 13.0, 15.0, 17.0, 19.0, 25.0, 31.0, 40.0, 100.0, 1e3, 1e60])
def test_one_point_outside_the_image_circle_does_not_take_the_others_along(radius):
    strong = coefficients(A3=-1e-3)
    inside = np.array([[3.0, 4.0], [-6.0, 6.0], [8.0, 0.0]])
    measured = distorted(inside, strong)
    found = remove_distortion(np.vstack([[[radius, 0.0]], measured]), strong)
    assert np.isnan(found[0]).all()
    assert np.allclose(found[1:], inside, atol=1e-11)


def test_no_points_have_no_distortion():
    none = np.empty((0, 2))
    assert remove_distortion(none, SMALL_FORMAT).shape == (0, 2)
    assert corrected(none, SMALL_FORMAT).shape == (0, 2)


def test_correction_at_measured_coordinates_by_hand():
    # first the affinity: x' = 3 - 0.01 * 3 - 0.02 * 4 = 2.89; then the radial part at (2.89, 4)
    found = corrected(np.array([[3.0, 4.0]]), coefficients(A3=1e-3, B1=0.01, B2=0.02))
    square = 2.89**2 + 16.0
    assert np.allclose(found, [[2.89 - 1e-3 * square * 2.89, 4.0 - 1e-3 * square * 4.0]], atol=1e-15)


def test_both_arguments_agree_on_a_camera_with_an_affinity_alone():
    # 'measured' takes B off the measured coordinate, 'ideal' adds it to the ideal one: inverse of each other up to B²
    shear = coefficients(B1=4e-4, B2=-3e-4)
    ideal = corrected(FRAME, shear)
    back = distorted(ideal, shear)
    assert np.allclose(back, FRAME, atol=1.1 * (4e-4 * 18.0 + 3e-4 * 12.0) * 4e-4)


def test_four_radial_terms_of_another_program_are_reproduced():
    """Metashape's frame camera of a drone with k4: u, v count in pixels, v down, from the middle of the frame."""
    f, pitch, width, height = 3713.0, 0.0033, 5280, 3956
    cx, cy, k1, k2, k3, k4, p1, p2 = 12.4, -7.9, -0.112, 0.051, 0.082, -0.0761, 3.1e-4, -2.2e-4
    u, v = np.meshgrid(np.linspace(0.0, width, 23), np.linspace(0.0, height, 17))
    x, y = ((u - width / 2.0) / f).ravel(), ((v - height / 2.0) / f).ravel()
    r2 = x**2 + y**2
    radial = 1.0 + k1 * r2 + k2 * r2**2 + k3 * r2**3 + k4 * r2**4
    column = width / 2.0 + cx + f * (x * radial + p1 * (r2 + 2.0 * x**2) + 2.0 * p2 * x * y)
    row = height / 2.0 + cy + f * (y * radial + p2 * (r2 + 2.0 * y**2) + 2.0 * p1 * x * y)

    c = f * pitch
    ours = coefficients(A3=k1 / c**2, A5=k2 / c**4, A7=k3 / c**6, A9=k4 / c**8, P1=p1 / c, P2=-p2 / c)
    principal_point = np.array([cx * pitch, -cy * pitch])
    found = principal_point + distorted(c * np.stack([x, -y], axis=1), ours)
    expected = np.stack([(column - width / 2.0) * pitch, -(row - height / 2.0) * pitch], axis=1)
    # coordinates below 15 mm are rounded to 2e-15 mm, some ten times each
    assert np.abs(found - expected).max() / pitch < 1e-11
    without = principal_point + distorted(c * np.stack([x, -y], axis=1), np.where(np.arange(9) == 4, 0.0, ours))
    assert np.abs(found - without).max() / pitch > 50.0


def test_both_arguments_describe_one_camera_when_each_has_its_own_polynomial():
    # one mapping: measured = ideal (1 + 1e-5 r²); the series of its inverse in the measured radius s is
    # ideal = measured (1 - k s² + 3 k² s⁴ - 12 k³ s⁶ ...), the inverse of a cubic
    k = 1e-5
    measured = distorted(FRAME, coefficients(A3=k))
    inverse = coefficients(A3=k, A5=-3.0 * k**2, A7=12.0 * k**3)
    found = corrected(measured, inverse)
    # the next term is 55 k⁴ s⁹ = 55e-20 * 21.7⁹ mm
    assert np.allclose(found, FRAME, atol=55e-20 * 21.8**9)


def test_mixing_the_two_arguments_is_an_error_of_the_size_that_the_conventions_name():
    # 0.3 mm at 21.6 mm: some 15 µm
    k = 0.3 / 21.6**3
    corner = np.array([[18.0, 12.0]])
    measured = distorted(corner, coefficients(A3=k))
    mixed = corrected(measured, coefficients(A3=k))
    assert 0.010 < np.hypot(*(mixed - corner)[0]) < 0.020


@pytest.mark.parametrize(
    "parameters", [(10.0, 1e-5, -2e-8, 3e-11), (148.0, -3e-8, 2e-13, 5e-18), (0.0, 1e-5, 0.0, 0.0)]
)
def test_isp_form_is_the_same_curve(parameters):
    r0, a1, a2, a3 = parameters
    polynomial = polynomial_from_isp(parameters)
    for radius in np.linspace(0.0, 1.5 * max(r0, 10.0), 31):
        isp = radius * (a1 * (radius**2 - r0**2) + a2 * (radius**4 - r0**4) + a3 * (radius**6 - r0**6))
        terms = polynomial * radius ** np.array([1, 3, 5, 7, 9])
        # to the last digit of the largest term: near R0 the terms cancel
        assert abs(terms.sum() - isp) <= 4e-15 * np.abs(terms).max()


@given(st.floats(1.0, 200.0), st.floats(-1e-5, 1e-5), st.floats(-1e-9, 1e-9), st.floats(-1e-13, 1e-13))
def test_isp_coefficients_are_exact(r0, a1, a2, a3):
    found = polynomial_from_isp((r0, a1, a2, a3))
    assert found[1:].tolist() == [a1, a2, a3, 0.0]
    terms = np.array([a1 * r0**2, a2 * r0**4, a3 * r0**6])
    assert abs(found[0] + terms.sum()) <= 1e-15 * np.abs(terms).sum() + np.finfo(np.float64).tiny


@pytest.mark.parametrize("largest", [15.0, 150.0])
def test_curve_of_16_points_gives_its_polynomial_back(largest):
    radius = np.linspace(largest / 16.0, largest, 16)
    truth = np.array([2e-4, -3e-2 / largest**2, 1e-2 / largest**4, -4e-3 / largest**6])
    distortion = radius[:, None] ** np.array([1, 3, 5, 7]) @ truth
    found, residuals = polynomial_from_curve(list(zip(radius, distortion, strict=True)))
    assert np.allclose(found, [*truth, 0.0], rtol=1e-10, atol=0.0)
    assert np.abs(residuals).max() < 1e-14  # rounding of distortions of up to 4 mm


def test_points_off_the_curve_show_in_the_residuals():
    radius = np.linspace(1.0, 16.0, 16)
    distortion = 1e-4 * radius
    distortion[7] += 0.010
    _, residuals = polynomial_from_curve(list(zip(radius, distortion, strict=True)))
    assert np.argmax(np.abs(residuals)) == 7
    assert residuals[7] == pytest.approx(-0.010, abs=0.004)


def test_curve_with_the_centre_and_a_radius_twice_counts_different_radii():
    points = [(0.0, 0.0), (5.0, 0.001), (5.0, 0.001), (10.0, 0.002), (15.0, 0.003)]
    with pytest.raises(ValueError, match="3 different radii greater than zero, 4 are needed"):
        polynomial_from_curve(points)
    found, residuals = polynomial_from_curve([*points, (20.0, 0.004)])
    assert found[0] == pytest.approx(2e-4, rel=1e-9)
    assert len(residuals) == 6
    with pytest.raises(ValueError, match="0 different radii"):
        polynomial_from_curve([])


@pytest.mark.parametrize(
    "parameters",
    [(10.0, 1e-5, -2e-8, 3e-11), (148.0, -3e-8, 2e-13, 5e-18), (12.5, 8e-5, 0.0, 0.0), (0.0, 1e-5, -2e-8, 1e-12)],
)
def test_isp_form_comes_back_from_its_polynomial(parameters):
    r0, *rest = isp_from_polynomial(polynomial_from_isp(parameters))
    # the polynomials of these have no second zero nearer to the centre
    assert r0 == pytest.approx(parameters[0], rel=1e-12)
    assert rest == list(parameters[1:])


@given(st.floats(1.0, 200.0), st.floats(-1.0, 1.0), st.floats(-1.0, 1.0), st.floats(0.1, 1.0))
def test_isp_form_found_is_the_same_curve_as_the_polynomial(r0, a1, a2, a3):
    # of millimetres anywhere on the frame
    polynomial = polynomial_from_isp((r0, a1 / r0**2, a2 / r0**4, a3 / r0**6))
    found = isp_from_polynomial(polynomial)
    assert found[0] <= r0 * (1.0 + 1e-4)  # it may have a zero nearer to the centre
    back = polynomial_from_isp(found)
    assert back[1:].tolist() == polynomial[1:].tolist()
    # R0 is as exact as a root is, and A1 with it
    assert back[0] == pytest.approx(polynomial[0], rel=1e-6, abs=1e-9)


@pytest.mark.parametrize(
    "polynomial",
    [
        (1e-3, 0.0, 0.0, 0.0, 0.0),
        (1e-3, 1e-6, 0.0, 0.0, 0.0),
        (-1e-3, -1e-6, -1e-9, -1e-12, 0.0),
        (-1e-3, 1e-5, 0.0, 0.0, 1e-15),
    ],
)
def test_polynomial_without_a_zero_or_with_a_ninth_degree_has_no_isp_form(polynomial):
    with pytest.raises(ValueError, match="ISP form"):
        isp_from_polynomial(polynomial)


def test_polynomial_as_a_curve_of_16_points_and_back():
    truth = polynomial_from_isp((8.0, 4e-5, -3e-8, 2e-11))
    radii = np.linspace(1.0, 16.0, 16)
    distortion = curve_from_polynomial(truth, radii)
    by_hand = [
        radius * (truth[0] + truth[1] * radius**2 + truth[2] * radius**4 + truth[3] * radius**6) for radius in radii
    ]
    assert np.allclose(distortion, by_hand, rtol=1e-13, atol=1e-16)
    found, _ = polynomial_from_curve(list(zip(radii.tolist(), distortion.tolist(), strict=True)))
    assert np.allclose(found, truth, rtol=1e-9, atol=0.0)
