"""Data snooping of all kinds of observation: the wrong one is named alone, the inseparable ones together."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from bundle.solving import with_error, with_photos
from monte_carlo.kinds_study import (
    CONTROL_ERROR,
    DIRECTION_ERROR,
    DISTANCE_ERROR,
    ELEMENT_ERROR,
    observed_block,
)
from support.synthetic_block import synthetic_block

from orip.adjustment.residual_sums import joint_effects
from orip.bundle.diagnosis import diagnose
from orip.bundle.snooping.findings import snooping_diagnosis, without_blunders
from orip.bundle.snooping.search import Snooped, SnoopingSettings, snoop
from orip.bundle.solve import solve_block
from orip.records.block import Block
from orip.structs import replace

STRICT = SnoopingSettings("apriori", 1e-6)
"""Of all right observations of all tests none fails this by chance."""


def snooped(block: Block, settings: SnoopingSettings = STRICT) -> Snooped:
    return snoop(block, settings, lambda _: None, lambda: False)


def told(found: Snooped) -> list[str]:
    return [diagnosis.text for diagnosis in snooping_diagnosis(found.solved, found.findings)]


def freed(clean: Block, found: Snooped) -> list[str]:
    """Return the points of which fewer unknowns are determined than without errors."""
    before = solve_block(clean, lambda _: None, lambda: False).normals.removed
    columns = np.flatnonzero(found.solved.normals.removed & ~before)
    return list(dict.fromkeys(found.solved.problem.unknowns.names[column].name for column in columns))


def with_wrong_distance(block: Block) -> Block:
    first = block.distances[0]
    return replace(
        block, distances=(replace(first, distance=first.distance + 20 * DISTANCE_ERROR), *block.distances[1:])
    )


def with_wrong_direction(block: Block) -> Block:
    first, second, *others = block.directions
    return replace(
        block, directions=(first, replace(second, direction=second.direction + 20 * DIRECTION_ERROR), *others)
    )


def with_wrong_zenith(block: Block) -> Block:
    first, second, *others = block.directions
    return replace(block, directions=(first, replace(second, zenith=second.zenith - 20 * DIRECTION_ERROR), *others))


def with_wrong_target(block: Block) -> Block:
    first, second, *others = block.directions
    return replace(
        block,
        directions=(
            first,
            replace(
                second, direction=second.direction + 20 * DIRECTION_ERROR, zenith=second.zenith + 20 * DIRECTION_ERROR
            ),
            *others,
        ),
    )


def with_wrong_element(block: Block) -> Block:
    first = block.elements[0]
    return replace(block, elements=(replace(first, value=first.value + 25 * ELEMENT_ERROR), *block.elements[1:]))


def with_wrong_station(block: Block) -> Block:
    elements = [
        replace(element, value=element.value + 12 * ELEMENT_ERROR)
        if element.name == block.elements[0].name
        else element
        for element in block.elements
    ]
    return replace(block, elements=tuple(elements))


def with_wrong_control(block: Block) -> Block:
    first = block.control_points[1]
    moved = tuple(value + 10 * CONTROL_ERROR for value in first.coordinates)
    return replace(
        block, control_points=(block.control_points[0], replace(first, coordinates=moved), *block.control_points[2:])
    )


CASES: dict[str, tuple[Callable[[Block], Block], set[tuple[str, str]]]] = {
    "distance": (with_wrong_distance, {("distance", "XYZ")}),
    "direction": (with_wrong_direction, {("direction", "direction")}),
    "zenith angle": (with_wrong_zenith, {("direction", "zenith")}),
    "target": (with_wrong_target, {("direction", "direction"), ("direction", "zenith")}),
    "element": (with_wrong_element, {("element", "X0")}),
    "station": (with_wrong_station, {("element", "X0"), ("element", "Y0"), ("element", "Z0")}),
    "control point": (with_wrong_control, {("control", "X"), ("control", "Y"), ("control", "Z")}),
}


@pytest.mark.parametrize("sigma0", ["apriori", "posteriori"])
@pytest.mark.parametrize("case", CASES)
def test_a_wrong_observation_of_any_kind_is_named_and_nothing_else(case: str, sigma0: str) -> None:
    spoil, expected = CASES[case]
    found = snooped(spoil(observed_block(1).block), SnoopingSettings(sigma0, 1e-6))
    assert {(blunder.kind, blunder.component) for blunder in found.blunders} == expected
    assert {blunder.order for blunder in found.blunders} == {1}
    # residuals of the adjustment without it contradict nothing: 0.80 to 1.20 at a redundancy of some 500
    assert found.solved.variance.sigma0 == pytest.approx(1.0, abs=0.2)


@pytest.mark.parametrize("case", CASES)
def test_the_block_without_the_blunders_has_the_same_solution(case: str) -> None:
    block = CASES[case][0](observed_block(1).block)
    found = snooped(block)
    again = solve_block(without_blunders(block, found.blunders), lambda _: None, lambda: False)
    assert again.variance.redundancy == found.solved.variance.redundancy
    # both stop at ENP 3: coordinates within a thousandth of their standard deviations
    assert np.allclose(again.state.points, found.solved.state.points, atol=1e-4)


def test_a_wrong_observation_of_each_kind_at_once() -> None:
    block = observed_block(2).block
    for case in ("distance", "direction", "element", "control point"):
        block = CASES[case][0](block)
    block = with_error(block, 40, 0, 30.0)
    assert {blunder.kind for blunder in snooped(block).blunders} == {
        "distance", "direction", "element", "control", "photo"
    }  # fmt: skip


def test_the_rays_of_a_point_in_two_photos_are_named_together_and_its_loss_is_told() -> None:
    made = with_photos(synthetic_block("strip", "two rays", precision_mm=0.005), 2)
    points = made.block.photo_points
    tie = next(
        index
        for index, name in enumerate(made.block.point_names)
        if name not in {point.name for point in made.block.control_points} and np.sum(points.point == index) == 2
    )
    ray = int(np.flatnonzero(points.point == tie)[0])
    # across the base: that direction alone is checked
    found = snooped(with_error(made.block, ray, 1, 60.0))
    (blunder,) = found.blunders
    name = made.block.point_names[tie]
    one, other = (f"photo {photo} point {name}" for photo in ("P1", "P2"))
    assert {f"photo {blunder.photo} point {blunder.point}", blunder.alternatives} == {one, other}
    (text,) = told(found)
    assert "cannot be told apart from" in text
    assert f"nothing else determines point {name}" in text
    assert freed(made.block, found) == [name]
    assert any(name in diagnosis.where for diagnosis in diagnose(found.solved))


def test_control_that_alone_fixes_the_scale_is_kept_and_told() -> None:
    made = synthetic_block("convergent", "kept", precision_mm=0.005, control="none")
    place = {name: index for index, name in enumerate(made.block.point_names)}
    some = synthetic_block("convergent", "kept", precision_mm=0.005).block.control_points
    # two full points and a height: seven coordinates beside the one that is checked
    chosen = [some[0], some[4], some[8]]
    wrong = replace(chosen[1], coordinates=tuple(value + 0.2 for value in chosen[1].coordinates))
    block = replace(made.block, control_points=(chosen[0], wrong, chosen[2]))
    assert all(name.name in place for name in chosen)
    found = snooped(block)
    assert found.blunders == ()
    assert found.solved.normals.removed.sum() == 0
    (text, *_) = told(found)
    assert "so it was not left out" in text


def test_everything_that_becomes_undetermined_is_told() -> None:
    made = synthetic_block("strip", "undetermined", precision_mm=0.005)
    block, random = made.block, np.random.default_rng(5)
    for ray in random.choice(len(block.photo_points.point), 12, replace=False):
        block = with_error(block, int(ray), 1, 50.0)
    found = snooped(block)
    lost = freed(made.block, found)
    text = "\n".join(told(found))
    assert lost
    for name in lost:
        assert f"nothing else determines point {name}" in text


def test_cofactors_are_those_of_the_adjustment_with_constant_distances_too() -> None:
    block = observed_block(1).block
    first, *others = block.distances
    held = replace(block, distances=(replace(first, error=0.0), *others))
    for tested in (block, held):
        solved = solve_block(tested, lambda _: None, lambda: False)
        rows = np.arange(len(solved.equations.residual))
        effects = joint_effects(solved.equations, solved.normals, solved.problem.layout, rows)
        ordinary = ~solved.equations.exact
        # the same product by another way: nothing but rounding at a condition of some 1e6
        assert np.allclose(np.diag(effects.cofactor)[ordinary], solved.cofactors.leverage[ordinary], atol=1e-8)
