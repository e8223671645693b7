"""Additional parameters: orthogonal on their grids, by hand at a point, partials, base and a-priori errors."""

from __future__ import annotations

import numpy as np
import pytest

from orip.interior.additional_parameters import (
    PARAMETER_SETS,
    additional_with_partials,
    base_of_frame,
    default_error,
)

SETS = ("EBNER", "GRUEN")
BASE = 92.0
"""0.4 of a 230 mm aerial frame."""

GRUEN_SUM = (
    "14", "23", "32", "41", "15", "24", "33", "42", "51", "25", "34", "43", "52", "35", "44", "53", "45", "54", "55"
)  # fmt: skip


def names(set_name):
    return PARAMETER_SETS[set_name].parameter_names


def points(count=40):
    return np.random.default_rng(5).uniform(-1.2 * BASE, 1.2 * BASE, (count, 2))


def typical_values(set_name):
    """Values of both signs, each of the size of its a-priori error for 5 µm."""
    errors = [default_error(set_name, index, BASE, 0.005) for index in range(len(names(set_name)))]
    return np.random.default_rng(6).standard_normal(len(errors)) * errors


def unit_terms(set_name, xy, base):
    """The design matrix (2n, k) at the points."""
    k = len(names(set_name))
    return additional_with_partials(set_name, xy, base, np.zeros(k)).by_values.reshape(-1, k)


def grid_of(set_name, base):
    x, y = np.meshgrid(*2 * [base * np.array(PARAMETER_SETS[set_name].grid)])
    return np.stack([x.ravel(), y.ravel()], axis=1)


def orientation_effects(xy):
    """The design matrix (2n, 6) of the exterior orientation over flat ground, in vertical photos."""
    x, y = xy.T
    one, zero = np.ones_like(x), np.zeros_like(x)
    effects = [(one, zero), (zero, one), (x, y), (-y, x), (x * x, x * y), (x * y, y * y)]
    return np.stack([np.stack(effect, axis=1).ravel() for effect in effects], axis=1)


def normalised(columns):
    return columns / np.linalg.norm(columns, axis=0)


def test_names_are_those_of_the_literature():
    assert names("EBNER") == tuple(f"EBNER.{number}" for number in range(1, 13))
    low = ["A12", "A21", "A22", "B22", "A31", "B13"]
    high = [f"{letter}{pair}" for letter in "AB" for pair in GRUEN_SUM]
    assert names("GRUEN") == tuple(f"GRUEN.{name}" for name in low + high)
    assert len(set(names("GRUEN"))) == 44


@pytest.mark.parametrize("base", [1.0, 9.6, BASE])
@pytest.mark.parametrize("set_name", SETS)
def test_terms_are_orthogonal_to_each_other_and_to_the_orientation_on_the_grid(set_name, base):
    grid = grid_of(set_name, base)
    terms = normalised(unit_terms(set_name, grid, base))
    effects = normalised(orientation_effects(grid))
    k = terms.shape[1]
    # sums of 50 products at most, each rounded in its 16th digit
    assert np.abs(terms.T @ terms - np.eye(k)).max() < 5e-15
    assert np.abs(terms.T @ effects).max() < 5e-15
    assert np.linalg.matrix_rank(np.hstack([terms, effects])) == k + 6


def test_with_the_orientation_each_set_takes_up_all_that_its_grid_can_show():
    # 9 points have 18 coordinates: nothing is left. 25 points have 50.
    for set_name in SETS:
        grid = grid_of(set_name, BASE)
        assert 2 * len(grid) == len(names(set_name)) + 6


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        # at (2, 4) with b = 3: k = 4 - 6 = -2, l = 16 - 6 = 10
        ("1", (2.0, -4.0)),
        ("2", (4.0, 2.0)),
        ("3", (4.0, 8.0)),
        ("4", (8.0, -20.0)),
        ("5", (10.0, 0.0)),
        ("6", (0.0, -2.0)),
        ("7", (20.0, 0.0)),
        ("8", (0.0, -8.0)),
        ("9", (-8.0, 0.0)),
        ("10", (0.0, 20.0)),
        ("11", (-20.0, 0.0)),
        ("12", (0.0, -20.0)),
    ],
)
def test_each_term_of_ebner_at_a_point_by_hand(name, expected):
    values = 1e-3 * (np.array(names("EBNER")) == f"EBNER.{name}")
    value = additional_with_partials("EBNER", np.array([[2.0, 4.0]]), 3.0, values).value
    assert np.allclose(value, 1e-3 * np.array([expected]), rtol=1e-14, atol=0.0)


# at (1, 3) with b = 2: k = 1 - 2 = -1, p = 1 - 3.4 = -2.4, r = 1 - 31/7 + 72/35 = -48/35
# l = 9 - 2 = 7, q = 27 - 10.2 = 16.8, s = 81 - 279/7 + 72/35 = 1512/35 = 43.2
GRUEN_LOW = {
    "A12": (1.0, -3.0),
    "A21": (3.0, 1.0),
    "A22": (3.0, -10.0),
    "B22": (10.0 / 7.0, 3.0),
    "A31": (7.0, 0.0),
    "B13": (0.0, -1.0),
}
GRUEN_PRODUCTS = {
    "14": -2.4,  # p
    "23": -3.0,  # y k
    "32": 7.0,  # x l
    "41": 16.8,  # q
    "15": -48.0 / 35.0,  # r
    "24": -7.2,  # y p
    "33": -7.0,  # k l
    "42": 16.8,  # x q
    "51": 43.2,  # s
    "25": -144.0 / 35.0,  # y r
    "34": -16.8,  # l p
    "43": -16.8,  # q k
    "52": 43.2,  # x s
    "35": -9.6,  # l r
    "44": -40.32,  # p q
    "53": -43.2,  # k s
    "45": -23.04,  # q r
    "54": -103.68,  # s p
    "55": -43.2 * 48.0 / 35.0,  # r s
}


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        *GRUEN_LOW.items(),
        *((f"A{pair}", (product, 0.0)) for pair, product in GRUEN_PRODUCTS.items()),
        *((f"B{pair}", (0.0, product)) for pair, product in GRUEN_PRODUCTS.items()),
    ],
)
def test_each_term_of_gruen_at_a_point_by_hand(name, expected):
    values = 1e-3 * (np.array(names("GRUEN")) == f"GRUEN.{name}")
    assert values.any()
    value = additional_with_partials("GRUEN", np.array([[1.0, 3.0]]), 2.0, values).value
    assert np.allclose(value, 1e-3 * np.array([expected]), rtol=1e-14, atol=0.0)


@pytest.mark.parametrize("set_name", SETS)
def test_partials_by_the_coordinates(set_name):
    xy, values, step = points(), typical_values(set_name), 0.01
    analytic = additional_with_partials(set_name, xy, BASE, values).by_xy
    for axis in (0, 1):
        shift = step * np.eye(2)[axis]
        ahead, behind, far_ahead, far_behind = (
            additional_with_partials(set_name, xy + share * shift, BASE, values).value for share in (1, -1, 2, -2)
        )
        # exact for polynomials up to the fourth degree, which the terms are along either axis
        numerical = (8.0 * (ahead - behind) - (far_ahead - far_behind)) / (12.0 * step)
        # values of some 10 mm, rounded in the 15th digit, over the step
        assert np.allclose(analytic[:, :, axis], numerical, rtol=0.0, atol=1e-11)


@pytest.mark.parametrize("set_name", SETS)
def test_partials_by_the_values(set_name):
    xy, values = points(), typical_values(set_name)
    found = additional_with_partials(set_name, xy, BASE, values)
    for index in range(len(values)):
        step = values[index] * np.eye(len(values))[index]
        ahead, behind = (additional_with_partials(set_name, xy, BASE, values + s * step).value for s in (1.0, -1.0))
        # linear in the values; the sum of all terms is rounded
        tolerance = 1e-14 * np.abs(found.by_values * values).sum(axis=2).max()
        assert np.allclose(found.by_values[:, :, index] * 2.0 * values[index], ahead - behind, rtol=0.0, atol=tolerance)


@pytest.mark.parametrize("set_name", SETS)
def test_points_may_have_their_own_base_and_values(set_name):
    xy = points(6)
    bases = np.linspace(10.0, 100.0, 6)
    values = np.linspace(0.5, 2.0, 6)[:, None] * typical_values(set_name)
    together = additional_with_partials(set_name, xy, bases, values)
    for row in range(6):
        alone = additional_with_partials(set_name, xy[row : row + 1], bases[row], values[row])
        for array, of_one in zip(together, alone, strict=True):
            # the sums may be taken in another order
            assert np.allclose(array[row], of_one[0], rtol=1e-12, atol=1e-14 * np.abs(of_one).max())


@pytest.mark.parametrize("set_name", SETS)
def test_a_larger_base_stretches_the_pattern(set_name):
    # a term of degree d is b to the power d times its form on the unit grid
    share = points(25) / BASE
    unit = unit_terms(set_name, share, 1.0)
    stretched = unit_terms(set_name, BASE * share, BASE)
    doubled = unit_terms(set_name, 2.0 * share, 2.0)
    degree = np.round(np.log2(np.linalg.norm(doubled, axis=0) / np.linalg.norm(unit, axis=0)))
    assert degree.max() == (4.0 if set_name == "EBNER" else 8.0)
    assert np.allclose(stretched / BASE**degree, unit, rtol=1e-12, atol=1e-14)


def test_base_is_four_tenths_of_the_shorter_side():
    assert base_of_frame(230.0, 230.0) == pytest.approx(92.0)
    assert base_of_frame(36.0, 24.0) == base_of_frame(24.0, 36.0) == pytest.approx(9.6)


@pytest.mark.parametrize("set_name", SETS)
def test_default_error_lets_every_term_reach_ten_photo_errors_in_the_corner(set_name):
    corner = np.array([[BASE, BASE]])
    for index, _ in enumerate(names(set_name)):
        values = np.zeros(len(names(set_name)))
        values[index] = default_error(set_name, index, BASE, 0.005)
        value = additional_with_partials(set_name, corner, BASE, values).value
        assert np.abs(value).max() == pytest.approx(0.05, rel=1e-12)


def test_default_error_by_hand():
    # EBNER.3 in the corner: dx = -2 b²/3, dy = b²; EBNER.12: (b²/3)²; GRUEN.A55: (3/140 b⁴)²
    assert default_error("EBNER", 2, BASE, 0.005) == pytest.approx(0.05 / BASE**2)
    assert default_error("EBNER", 11, BASE, 0.005) == pytest.approx(9.0 * 0.05 / BASE**4)
    last = names("GRUEN").index("GRUEN.A55")
    assert default_error("GRUEN", last, BASE, 0.005) == pytest.approx(0.05 * (140.0 / 3.0) ** 2 / BASE**8)


@pytest.mark.parametrize("set_name", SETS)
def test_no_points_and_no_deformation(set_name):
    k = len(names(set_name))
    found = additional_with_partials(set_name, np.empty((0, 2)), BASE, np.zeros(k))
    assert [array.shape for array in found] == [(0, 2), (0, 2, 2), (0, 2, k)]
    none = additional_with_partials(set_name, points(3), BASE, np.zeros(k))
    assert not none.value.any()
    assert not none.by_xy.any()


def test_sets_cannot_be_changed():
    with pytest.raises(ValueError, match="read-only"):
        PARAMETER_SETS["EBNER"].factors[0, 0, 0, 0] = 1.0
