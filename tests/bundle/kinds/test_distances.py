"""Distances: the seven codes, constants that are met exactly, and what they do to a block."""

from __future__ import annotations

import numpy as np
import pytest
from bundle.aerial_block import aerial_block
from bundle.solving import OFF, noisy, redefined, rows, solution
from support.synthetic_block import synthetic_block

from orip.bundle.solve import solve_block
from orip.errors import InputError
from orip.records.control import ControlDistance
from orip.structs import replace

MADE = aerial_block("distances", 6)
CODES = {
    "X": lambda d: d[0],
    "Y": lambda d: d[1],
    "Z": lambda d: d[2],
    "XY": lambda d: np.hypot(d[0], d[1]),
    "YZ": lambda d: np.hypot(d[1], d[2]),
    "ZX": lambda d: np.hypot(d[2], d[0]),
    "XYZ": np.linalg.norm,
}


def difference(points, block, start, end):
    place = block.point_index()
    return points[place[end]] - points[place[start]]


def with_distance(block, code, value, error, start="102", end="123"):
    return replace(block, distances=(ControlDistance("D1", start, end, code, float(value), error),))


@pytest.mark.parametrize(("start", "end"), [("102", "123"), ("123", "102")])
@pytest.mark.parametrize("code", CODES)
def test_residual_is_the_adjusted_distance_minus_the_observed_one(code, start, end):
    block = noisy(MADE, 1)
    true = CODES[code](difference(MADE.points, block, start, end))
    found = solution(with_distance(block, code, true + 3.0, 10.0, start, end))
    (row,) = rows(found, "distance")
    adjusted = CODES[code](difference(found.points.values, block, start, end))
    residuals = found.residuals
    assert (residuals.point[row], residuals.component[row]) == ("D1", code)
    assert residuals.residual[row] == pytest.approx(adjusted - (true + 3.0), abs=1e-9)
    assert residuals.residual[row] == pytest.approx(-3.0, abs=0.3)
    assert residuals.standard_residual[row] == pytest.approx(0.3, abs=0.03)


@pytest.mark.parametrize("code", ["X", "Y", "Z"])
def test_signed_codes_are_end_minus_start(code):
    block = redefined(noisy(MADE, 1), **OFF)
    true = CODES[code](difference(MADE.points, block, "102", "123"))
    wanted = solution(with_distance(block, code, true, 1e-4))
    turned = solution(with_distance(block, code, -true, 1e-4, "123", "102"))
    assert np.allclose(wanted.points.values, turned.points.values, atol=1e-6)
    assert np.abs(wanted.points.values - MADE.points).max() < 0.3


@pytest.mark.parametrize("code", CODES)
def test_a_constant_distance_is_met_exactly_and_does_what_a_very_precise_one_does(code):
    block = redefined(noisy(MADE, 1), **OFF)
    # 5 cm more than it is: two to three times the precision of a point
    value = CODES[code](difference(MADE.points, block, "102", "123")) + 0.05
    constant = solution(with_distance(block, code, value, 0.0))
    assert constant.status == "converged"
    met = CODES[code](difference(constant.points.values, block, "102", "123"))
    assert met == pytest.approx(value, abs=1e-9)
    assert constant.residuals.residual[rows(constant, "constant distance")] == pytest.approx([0.0], abs=1e-9)

    precise = solution(redefined(with_distance(block, code, value, 1e-5), enp_stop=6.0))
    assert np.allclose(constant.points.values, precise.points.values, atol=2e-5)
    assert np.allclose(constant.photos.values[:, :3], precise.photos.values[:, :3], atol=2e-4)
    assert constant.redundancy == precise.redundancy
    # not quite the same: a very precise observation is one of those that sigma0 is made of
    assert constant.sigma0_all == pytest.approx(precise.sigma0_all, rel=1e-3)


@pytest.mark.parametrize("code", CODES)
def test_a_constant_distance_does_not_slow_down_the_iterations(code):
    block = redefined(noisy(MADE, 1), **OFF)
    value = CODES[code](difference(MADE.points, block, "102", "123")) + 0.05
    assert len(solution(with_distance(block, code, value, 0.0)).iterations) <= 5


def bordered_inverse(solved):
    """Return all cofactors by Lagrange multipliers: the normal matrix without the constraints, bordered with them."""
    design, exact = solved.equations.design.toarray(), solved.equations.exact
    constraints = design[exact]
    normals = design[~exact].T @ (solved.weight_factors[~exact, None] * design[~exact])
    used = np.diag(normals) > 0.0
    scale = 1.0 / np.sqrt(np.where(used, np.diag(normals), 1.0))
    normals, constraints = normals * np.outer(scale, scale), (constraints * scale)[:, used]
    count = len(constraints)
    bordered = np.block([[normals[np.ix_(used, used)], constraints.T], [constraints, np.zeros((count, count))]])
    found = np.zeros_like(normals)
    found[np.ix_(used, used)] = np.linalg.inv(bordered)[:-count, :-count]
    return found * np.outer(scale, scale)


@pytest.mark.parametrize("codes", [("XYZ",), ("X", "YZ"), ("XY", "Z", "XYZ")])
@pytest.mark.parametrize("geometry", ["distances", "convergent"])
def test_cofactors_with_constant_distances_are_those_of_lagrange_multipliers(codes, geometry):
    if geometry == "distances":
        block, ends = redefined(noisy(MADE, 1), **OFF), [("102", "123"), ("103", "122"), ("112", "101")]
    else:
        block, ends = synthetic_block("convergent", "scale", noise_mm=0.005).block, [("130", "101"), ("110", "125")]
    made = [(code, *pair) for code, pair in zip(codes, ends, strict=False)]
    truth = MADE.points if geometry == "distances" else synthetic_block("convergent", "scale", noise_mm=0.005).points
    distances = tuple(
        ControlDistance(f"D{start}", start, end, code, float(CODES[code](difference(truth, block, start, end))), 0.0)
        for code, start, end in made
    )
    solved = solve_block(replace(block, distances=distances), lambda _: None, lambda: False)
    wanted = bordered_inverse(solved)
    m = solved.problem.layout.reduced
    scale = np.sqrt(np.diag(wanted))
    # the bordered matrix has a condition of some 1e6 after scaling
    reduced = np.asarray(solved.cofactors.reduced)
    assert np.allclose(
        reduced / np.outer(scale[:m], scale[:m]), wanted[:m, :m] / np.outer(scale[:m], scale[:m]), atol=1e-8
    )
    sd = np.sqrt(np.einsum("bii->bi", solved.cofactors.blocks).ravel())
    assert np.allclose(sd, scale[m:], rtol=1e-8)
    column = int(np.argmax(scale > 0.0))
    unit = np.eye(len(wanted))[:, [column]]
    assert np.allclose(solved.normals.solve(unit)[:, 0] / scale[column], wanted[:, column] / scale[column], atol=1e-8)
    design = solved.equations.design.toarray()
    numbers = 1.0 - solved.weight_factors * np.einsum("ij,jk,ik->i", design, wanted, design)
    numbers[solved.equations.exact] = 0.0
    found = solved.variance.redundancy_numbers
    taking_part = np.isfinite(found)
    assert np.allclose(found[taking_part], numbers[taking_part], atol=1e-8)
    assert found[solved.equations.exact] == pytest.approx(0.0, abs=1e-12)
    assert np.nansum(found) == pytest.approx(solved.variance.redundancy, abs=1e-7)


def test_a_constant_distance_that_is_given_twice_is_checked_by_itself():
    block = redefined(noisy(MADE, 1), **OFF)
    value = float(CODES["XYZ"](difference(MADE.points, block, "102", "123")))
    twice = tuple(ControlDistance(name, "102", "123", "XYZ", value, 0.0) for name in ("D1", "D2"))
    solved = solve_block(replace(block, distances=twice), lambda _: None, lambda: False)
    assert solved.variance.redundancy_numbers[solved.equations.exact] == pytest.approx([0.5, 0.5])
    assert np.nansum(solved.variance.redundancy_numbers) == pytest.approx(solved.variance.redundancy, abs=1e-7)


def test_a_constant_distance_is_never_down_weighted():
    block = redefined(noisy(MADE, 1), max_iterations=60, start_down_weight=2)
    value = CODES["XYZ"](difference(MADE.points, block, "102", "123"))
    # a metre of contradiction to two control points: the photo points give way
    found = solution(with_distance(block, "XYZ", value + 1.0, 0.0))
    row = rows(found, "constant distance")
    assert found.residuals.weight_factor[row].tolist() == [1.0]
    assert abs(found.residuals.residual[row][0]) < 1e-6


def test_distances_sum_up_with_the_other_redundancy_numbers():
    block = noisy(MADE, 1)
    value = CODES["XYZ"](difference(MADE.points, block, "102", "123"))
    for error in (0.0, 0.05):
        found = solution(with_distance(block, "XYZ", value, error))
        assert abs(np.nansum(found.residuals.redundancy_number) - found.redundancy) < 1e-8


@pytest.mark.parametrize("error", [-0.01, -1.0])
def test_a_disregarded_distance_is_listed_without_influence(error):
    block = noisy(MADE, 1)
    without = solution(block)
    found = solution(with_distance(block, "XYZ", 5.0, error))
    (row,) = rows(found, "distance")
    true = np.linalg.norm(difference(found.points.values, block, "102", "123"))
    assert found.residuals.residual[row] == pytest.approx(true - 5.0)
    assert np.isnan(found.residuals.weight_factor[row])
    assert np.isnan(found.residuals.redundancy_number[row])
    assert np.allclose(found.points.values, without.points.values, atol=1e-7)
    assert (found.redundancy, found.observations) == (without.redundancy, without.observations)


def test_a_distance_scales_a_free_network():
    made = synthetic_block("convergent", "scale", noise_mm=0.005)
    place = made.block.point_index()
    true = np.linalg.norm(made.points[place["130"]] - made.points[place["101"]])
    free = redefined(made.block, datum="free")
    scaled = solution(replace(free, distances=(ControlDistance("D", "101", "130", "XYZ", float(2.0 * true), 0.001),)))
    size = np.linalg.norm(scaled.points.values - scaled.points.values.mean(axis=0))
    assert size / np.linalg.norm(made.points - made.points.mean(axis=0)) == pytest.approx(2.0, rel=1e-3)


def test_a_distance_may_not_be_ten_thousand_times_as_precise_as_the_photos():
    block = noisy(MADE, 1)
    value = CODES["XYZ"](difference(MADE.points, block, "102", "123"))
    with pytest.raises(InputError, match=r"distance D1 has an a-priori error of 1e-07.*or 0 for a distance"):
        solution(with_distance(block, "XYZ", value, 1e-7))
