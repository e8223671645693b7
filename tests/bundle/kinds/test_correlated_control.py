"""Control points with correlated errors against dense generalised least squares, whose weights are a full matrix."""

from __future__ import annotations

import numpy as np
import pytest
from bundle.solving import OFF, rows, solution, solved
from support.synthetic_block import synthetic_block

from orip.bundle.problem import pose_problem
from orip.bundle.results.reliability import NON_CENTRALITY, reliability_of
from orip.bundle.results.solution import solution_of
from orip.bundle.snooping.search import SnoopingSettings, snoop
from orip.records.block import Block
from orip.records.control import PointCorrelation
from orip.structs import replace

MADE = synthetic_block("convergent", "correlated control", noise_mm=0.005, control_error=0.02, **OFF)
TOGETHER = 5
"""Control points of the network, the first ones."""

FACTORS = np.array([[1.0, 0.0, 0.0], [0.5, 0.8, 0.0], [-0.6, 0.3, 0.7]])


def drawn(random: np.random.Generator, network: bool = True) -> tuple[Block, np.ndarray]:
    """Return the block with errors of control drawn from a covariance of all of it, and that covariance."""
    points = MADE.block.control_points
    sigma = points[0].errors[0]
    place = {name: row for row, name in enumerate(MADE.block.point_names)}
    covariance = np.kron(np.eye(len(points)), FACTORS @ FACTORS.T) * sigma**2
    if network:
        size = 3 * TOGETHER
        common = np.kron(np.ones((TOGETHER, TOGETHER)), np.diag([1.0, 1.5, 4.0])) * sigma**2
        covariance[:size, :size] += common
    error = np.sqrt(np.diag(covariance)).reshape(-1, 3)
    offset = (np.linalg.cholesky(covariance) @ random.normal(size=3 * len(points))).reshape(-1, 3)
    correlation = covariance / np.outer(error.ravel(), error.ravel())
    blocks = correlation.reshape(len(points), 3, len(points), 3)
    control = tuple(
        replace(
            point,
            coordinates=tuple((MADE.points[place[point.name]] + offset[row]).tolist()),
            errors=tuple(error[row].tolist()),
            correlations=tuple(blocks[row, [0, 0, 1], row, [1, 2, 2]].tolist()),
        )
        for row, point in enumerate(points)
    )
    pairs = tuple(
        PointCorrelation(points[a].name, points[b].name, tuple(map(tuple, blocks[a, :, b].tolist())))
        for a in range(TOGETHER if network else 0)
        for b in range(a)
    )
    random_xy = MADE.block.photo_points
    return replace(MADE.block, control_points=control, control_correlations=pairs, photo_points=random_xy), covariance


class Dense:
    """The adjustment with a full weight matrix, from the design of the same block without correlations."""

    def __init__(self, block: Block, covariance: np.ndarray) -> None:
        self.found = solved(block)
        alone = tuple(replace(point, correlations=None) for point in block.control_points)
        problem = pose_problem(replace(block, control_correlations=(), control_points=alone))
        equations = problem.linearise(self.found.state)
        parts = [kind.rows for kind in problem.observations]
        error = np.concatenate([part.error for part in parts])
        self.control = np.flatnonzero(
            np.repeat([part.kind.name == "control" for part in parts], [len(part.error) for part in parts])
        )
        design = equations.design.toarray() * error[:, None]
        design = design[:, np.abs(design).max(axis=0) > 0.0]
        self.v = equations.residual * error
        full = np.diag(error**2)
        full[np.ix_(self.control, self.control)] = covariance
        self.covariance, self.weight = full, np.linalg.inv(full)
        normal = design.T @ self.weight @ design
        scale = np.sqrt(np.diag(normal))
        inverse = np.linalg.inv(normal / np.outer(scale, scale)) / np.outer(scale, scale)
        self.correction = -inverse @ (design.T @ self.weight @ self.v)
        self.sd = np.sqrt(np.diag(inverse))
        self.of_residuals = full - design @ inverse @ design.T
        self.redundancy = np.diag(self.of_residuals @ self.weight)
        self.sigma0 = np.sqrt(self.v @ self.weight @ self.v / self.redundancy.sum())


@pytest.mark.parametrize("network", [False, True], ids=["points", "network"])
def test_the_solution_is_that_of_generalised_least_squares(network: bool) -> None:
    block, covariance = drawn(np.random.default_rng(1), network)
    dense = Dense(block, covariance)
    found = solution_of(dense.found)
    assert np.abs(dense.correction / dense.sd).max() < 1e-5
    assert found.sigma0 == pytest.approx(dense.sigma0, rel=1e-9)
    control, own = rows(found, "control"), dense.control
    assert found.residuals.residual[control] == pytest.approx(dense.v[own], abs=1e-9)
    assert found.residuals.redundancy_number == pytest.approx(dense.redundancy, abs=1e-7)
    weighted, both = dense.weight @ dense.v, dense.weight @ dense.of_residuals @ dense.weight
    w = np.abs(weighted[own]) / np.sqrt(np.diag(both)[own]) / dense.sigma0
    assert found.residuals.w[control] == pytest.approx(w, rel=1e-6)
    reliability = reliability_of(found)
    bias = NON_CENTRALITY / np.sqrt(np.diag(both)[own])
    assert reliability.minimal_detectable_bias[control] == pytest.approx(bias, rel=1e-6)
    influence = np.diag(dense.weight @ (dense.covariance - dense.of_residuals) @ dense.weight)[own]
    assert reliability.external[control] == pytest.approx(bias * np.sqrt(np.maximum(influence, 0.0)), rel=1e-6)
    adjusted = np.sqrt(np.diag(dense.covariance - dense.of_residuals)[own]) * dense.sigma0
    assert reliability.adjusted_sd[control] == pytest.approx(adjusted, rel=1e-6)


def test_without_a_point_the_others_have_their_own_covariance() -> None:
    """Taken out of the block, disregarded, or left out by snooping, a point leaves the same solution."""
    block, _ = drawn(np.random.default_rng(4))
    gone = block.control_points[1]
    without = solution(replace(block, control_points=tuple(one for one in block.control_points if one is not gone)))
    only_compared = replace(gone, errors=tuple(-error for error in gone.errors))
    points = tuple(only_compared if one is gone else one for one in block.control_points)
    compared = solution(replace(block, control_points=points))
    assert compared.points.values == pytest.approx(without.points.values, abs=1e-9)
    assert compared.points.sd == pytest.approx(without.points.sd, rel=1e-7)
    wrong = replace(gone, coordinates=tuple(value + 40.0 * gone.errors[0] for value in gone.coordinates))
    points = tuple(wrong if one is gone else one for one in block.control_points)
    snooped = snoop(replace(block, control_points=points), SnoopingSettings(), lambda _: None, lambda: False)
    assert {blunder.point for blunder in snooped.blunders} == {gone.name}
    found = solution_of(snooped.solved)
    assert found.points.values == pytest.approx(without.points.values, abs=1e-7)
    assert found.points.sd / found.sigma0 == pytest.approx(without.points.sd / without.sigma0, rel=1e-6)


def scatter(runs: int) -> tuple[float, float, float]:
    """Return sigma0, and the root mean squares of errors of points and of w of control, over many adjustments."""
    random, squares, redundancy, normalised, w = np.random.default_rng(2), 0.0, 0.0, [], []
    exact = synthetic_block("convergent", "correlated control").block.photo_points.xy
    for _ in range(runs):
        block, _ = drawn(random)
        xy = exact + 0.005 * random.normal(size=exact.shape)
        found = solution(replace(block, photo_points=replace(block.photo_points, xy=xy)))
        squares += found.sigma0**2 * found.redundancy
        redundancy += found.redundancy
        normalised.append((found.points.values - MADE.points) / found.points.sd * found.sigma0)
        w.append(found.residuals.w[rows(found, "control")] * found.sigma0)
    return tuple(np.sqrt([squares / redundancy, np.mean(np.square(normalised)), np.mean(np.square(w))]).tolist())


def named(runs: int, size: float) -> int:
    """Return how often snooping names a control point of the network with an error of so many detectable ones."""
    random, count = np.random.default_rng(3), 0
    settings = SnoopingSettings(alpha=0.001)
    for run in range(runs):
        block, covariance = drawn(random)
        if run == 0:
            bias = reliability_of(solution(block)).minimal_detectable_bias[-len(covariance) :]
        point, axis = run % TOGETHER, run % 3
        control = list(block.control_points)
        coordinates, error = list(control[point].coordinates), size * bias[3 * point + axis]
        coordinates[axis] += error
        control[point] = replace(control[point], coordinates=tuple(coordinates))
        wrong = replace(block, control_points=tuple(control))
        blunders = snoop(wrong, settings, lambda _: None, lambda: False).blunders
        sizes = {blunder.component: blunder for blunder in blunders if blunder.point == control[point].name}
        if {(blunder.kind, blunder.point) for blunder in blunders} == {("control", control[point].name)}:
            count += 1
            found = sizes["XYZ"[axis]]
            assert abs(found.size - error) < 5.0 * found.sd
    return count


@pytest.mark.slow
def test_figures_hold_over_many_adjustments() -> None:
    sigma0, points, w = scatter(12)
    assert 0.94 < sigma0 < 1.06
    assert 0.85 < points < 1.15
    assert 0.85 < w < 1.15


@pytest.mark.slow
def test_a_wrong_point_of_a_network_is_named_and_not_the_network() -> None:
    assert named(10, 2.0) >= 9


@pytest.mark.long
@pytest.mark.timeout(1200)
def test_figures_hold_over_two_hundred_adjustments() -> None:
    assert all(0.97 < figure < 1.03 for figure in scatter(200))


@pytest.mark.long
@pytest.mark.timeout(1200)
def test_an_error_of_two_detectable_sizes_is_named() -> None:
    assert named(200, 2.0) >= 196
