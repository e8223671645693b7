"""A-priori errors of groups of observations, estimated: against dense matrices, known errors and one another."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest
from bundle.solving import solved
from monte_carlo.grouped_blocks import grouped_block

from orip.bundle.results.solution import solution_of
from orip.bundle.solve import SolvedBlock, iteration_settings
from orip.bundle.variance import components as estimation
from orip.bundle.variance.components import (
    EstimatedErrors,
    VarianceEquations,
    estimate_errors,
    variance_equations,
)
from orip.bundle.variance.groups import VarianceGroup, variance_groups, with_errors_times
from orip.records.block import Block
from orip.records.results.tests import VarianceComponent
from orip.structs import replace

PHOTO = VarianceGroup("photo", "CAM", "xy")
LEVEL, HEIGHT = VarianceGroup("control", "", "XY"), VarianceGroup("control", "", "Z")
STATIONS, BARS = VarianceGroup("element", "PHOTO", "X0 Y0 Z0"), VarianceGroup("distance")
ALL = (PHOTO, LEVEL, HEIGHT, STATIONS, BARS)


def estimated(block: Block) -> EstimatedErrors:
    return estimate_errors(solved(block), iteration_settings(block.definition), lambda _: None, lambda: False)


def by_group(found: EstimatedErrors) -> dict[VarianceGroup, VarianceComponent]:
    return {VarianceGroup(row.kind, row.of, row.component): row for row in found.components}


def given_as(block: Block, factors: Mapping[VarianceGroup, float]) -> Block:
    """The block with a-priori errors that are wrong by factors: the true ones are as many times larger."""
    return with_errors_times(block, {group: 1.0 / factor for group, factor in factors.items()})


def dense_matrix(found: SolvedBlock) -> np.ndarray:
    """Helmert's matrix from the whole design matrix, all weights 1."""
    design = found.problem.design(found.state).toarray()[found.equations.active]
    design = design[:, np.abs(design).any(axis=0)]
    orthonormal = np.linalg.qr(design / np.linalg.norm(design, axis=0))[0]
    squares = (np.eye(len(design)) - orthonormal @ orthonormal.T) ** 2
    place = np.cumsum(found.equations.active) - 1
    rows = [place[part.rows] for part in variance_groups(found)]
    return np.array([[squares[np.ix_(mine, other)].sum() for other in rows] for mine in rows])


def test_equations_are_those_of_dense_matrices() -> None:
    found = solved(grouped_block("none", 1).block)
    assert (found.weight_factors[found.equations.active] == 1.0).all(), "the dense matrix knows no weights"
    equations = variance_equations(found, variance_groups(found))
    # of a thousand equations with a condition of some 1e4 after scaling, squared in the normal equations
    np.testing.assert_allclose(equations.matrix, dense_matrix(found), rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(equations.matrix.sum(axis=1), equations.redundancy, rtol=1e-6)


def with_cameras(block: Block, count: int) -> Block:
    """The block with its photos taken by several cameras in turn."""
    of_photo = np.arange(len(block.photos)) % count
    names = [f"CAM{number + 1}" for number in range(count)]
    return replace(
        block,
        cameras=tuple(replace(block.cameras[0], name=name) for name in names),
        photos=tuple(
            replace(photo, camera=names[place]) for photo, place in zip(block.photos, of_photo.tolist(), strict=True)
        ),
        photo_camera=of_photo,
    )


@pytest.mark.parametrize(("cameras", "most_exact"), [(2, 600), (4, 600), (1, 10), (2, 10)])
def test_standard_deviations_are_those_of_dense_matrices_for_several_cameras_and_many_on_the_ground(
    cameras: int, most_exact: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(estimation, "_MOST_EXACT", most_exact)
    found = solved(with_cameras(grouped_block("none", 1).block, cameras))
    equations = variance_equations(found, variance_groups(found))
    dense, every = dense_matrix(found), np.ones(cameras + 4, dtype=bool)
    # what two cameras share is a sixth to a third of the redundancy of each: deviations would be too small by a tenth
    assert dense[0, cameras - 1] > 0.05 * dense[0, 0]
    # 32 samples on the dozens of unknowns that groups share: 3 % of a fifth of H, and a half of that in deviations
    exact = np.sqrt(np.diag(np.linalg.inv(dense)))
    np.testing.assert_allclose(np.sqrt(equations.cofactors(every)), exact, rtol=0.01)
    np.testing.assert_allclose(equations.matrix.sum(axis=1), equations.redundancy, rtol=1e-6)


def test_errors_that_are_right_stay() -> None:
    found = estimated(grouped_block("none", 2).block)
    assert [VarianceGroup(row.kind, row.of, row.component) for row in found.components] == list(ALL)
    for row in found.components:
        assert abs(row.factor - 1.0) < 4.0 * row.sd, row.name
        assert row.p > 1e-4, row.name


def test_wrong_errors_are_found_and_the_same_solution_whatever_is_given() -> None:
    block = grouped_block("none", 3).block
    wrong = dict(zip(ALL, (3.0, 0.4, 0.5, 2.5, 1.0), strict=True))
    right, off = estimated(block), estimated(given_as(block, wrong))
    for group, row in by_group(right).items():
        # either ended when variances changed by less than a thousandth, in steps that become quadratically smaller
        assert by_group(off)[group].factor == pytest.approx(row.factor * wrong[group], rel=2e-3), row.name
    assert by_group(off)[PHOTO].p < 1e-6
    points, others = (solution_of(found.solved).points for found in (right, off))
    assert (np.abs(others.values - points.values) < 0.01 * points.sd).all()


def test_sigma0_is_one_with_the_estimated_errors() -> None:
    found = estimated(given_as(grouped_block("none", 4).block, {PHOTO: 2.0, STATIONS: 2.0}))
    assert found.solved.variance.sigma0 == pytest.approx(1.0, abs=1e-3)


def test_a_group_without_redundancy_keeps_its_errors() -> None:
    block = grouped_block("none", 5).block
    one_bar = replace(block, distances=block.distances[:1])
    (bar,) = [row for row in estimated(one_bar).components if row.kind == "distance"]
    assert (bar.number, bar.redundancy < 1.0) == (1, True)
    assert np.isnan([bar.factor, bar.sd, bar.p]).all()


def test_groups_that_cannot_be_told_apart_are_left_out() -> None:
    alike = np.array([[5.0, 4.999, 0.1], [4.999, 5.0, 0.1], [0.1, 0.1, 9.0]])
    equations = VarianceEquations(np.ones(3), np.array([10.0, 9.0, 9.2]), alike)
    assert equations.estimable(1.0).tolist() == [True, False, True]
    assert equations.estimable(9.5).tolist() == [True, False, False]


def test_constant_and_compared_control_stays_as_it_is() -> None:
    block = grouped_block("none", 6).block
    scaled = with_errors_times(block, {LEVEL: 2.0, HEIGHT: 3.0, STATIONS: 5.0})
    for before, after in zip(block.control_points, scaled.control_points, strict=True):
        x, y, z = before.errors
        factors = (2.0, 2.0, 3.0) if before.kind == "control" else (1.0, 1.0, 1.0)
        assert after.errors == pytest.approx((x * factors[0], y * factors[1], z * factors[2]), rel=1e-15)
    assert [element.error for element in scaled.elements] == [5.0 * element.error for element in block.elements]
    assert scaled.photo_points.error is not None
    np.testing.assert_array_equal(scaled.photo_points.error, block.photo_points.error)
