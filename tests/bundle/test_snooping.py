"""Data snooping: single gross errors, shifted control, clean data."""

from __future__ import annotations

import numpy as np
import pytest
from bundle.aerial_block import CONTROL_ERROR, PRECISION_MM, aerial_block
from bundle.solving import controlled, noisy, redefined, solution, started_off, with_error
from support.synthetic_block import synthetic_block

from orip.bundle.snooping.findings import without_blunders
from orip.bundle.snooping.search import SnoopingSettings, snoop
from orip.structs import replace

MADE = {"aerial": aerial_block("snooping"), "around an object": synthetic_block("convergent", "snooping")}
APRIORI, POSTERIORI = SnoopingSettings("apriori", 0.001), SnoopingSettings("posteriori", 0.001)
STRICT = SnoopingSettings("apriori", 1e-6)
"""Of the thousands of observations of all runs none fails this by chance; a blunder of 12 sigma and more does."""


def snooped(block, chosen=APRIORI):
    return snoop(block, chosen, lambda _: None, lambda: False)


def names_of(block, photo_point):
    points = block.photo_points
    return block.photos[points.photo[photo_point]].name, block.point_names[points.point[photo_point]]


@pytest.mark.parametrize("chosen", [STRICT, SnoopingSettings("posteriori", 1e-6)], ids=["apriori", "posteriori"])
@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("scene", MADE)
def test_a_single_gross_error_is_found_with_its_size(scene, seed, chosen):
    random = np.random.default_rng(seed)
    block = noisy(MADE[scene], seed)
    place, component = int(random.integers(len(block.photo_points.photo))), int(random.integers(2))
    size = float(random.choice([-1.0, 1.0]) * random.uniform(15.0, 60.0))
    found = snooped(with_error(block, place, component, size), chosen)
    (blunder,) = found.blunders
    assert (blunder.kind, (blunder.photo, blunder.point)) == ("photo", names_of(block, place))
    assert blunder.component == "xy"[component]
    assert blunder.order == 1
    assert blunder.statistic > blunder.limit
    assert blunder.sd > PRECISION_MM * 0.9
    assert abs(blunder.size - size * PRECISION_MM) < 3.0 * blunder.sd


@pytest.mark.parametrize("seed", range(4))
def test_a_shifted_control_point_is_named_though_all_photos_agree(seed):
    made = MADE["aerial"]
    block = noisy(made, seed)
    shifted = block.control_points[3 * seed]
    shift = np.array([0.5, -0.7, 0.9])
    wrong = tuple(
        replace(point, coordinates=tuple((np.array(point.coordinates) + shift).tolist()))
        if point.name == shifted.name
        else point
        for point in block.control_points
    )
    found = snooped(replace(block, control_points=wrong), STRICT)
    assert {(blunder.kind, blunder.point) for blunder in found.blunders} == {("control", shifted.name)}
    assert [blunder.component for blunder in found.blunders] == ["X", "Y", "Z"]
    assert {blunder.order for blunder in found.blunders} == {1}
    for blunder, moved in zip(found.blunders, shift, strict=True):
        assert blunder.sd > CONTROL_ERROR * 0.9
        assert abs(blunder.size - moved) < 3.5 * blunder.sd


def test_a_point_whose_three_shifts_are_each_too_small_is_found_as_a_group():
    block = noisy(MADE["aerial"], 12)
    first = block.control_points[5]
    # 3.2 times the precision in each coordinate: less than the limit of one, together more than that of three
    by = 3.2 * CONTROL_ERROR * np.array([1.0, 1.0, -1.0])
    true = MADE["aerial"].points[block.point_index()[first.name]]
    wrong = tuple(
        replace(point, coordinates=tuple((true + by).tolist())) if point is first else point
        for point in block.control_points
    )
    found = snooped(replace(block, control_points=wrong), APRIORI)
    assert first.name in {blunder.point for blunder in found.blunders if blunder.kind == "control"}


@pytest.mark.slow
@pytest.mark.parametrize("chosen", [APRIORI, POSTERIORI], ids=["apriori", "posteriori"])
@pytest.mark.parametrize("scene", MADE)
def test_clean_data_have_hardly_a_blunder(scene, chosen):
    named = total = 0
    for seed in range(12):
        found = snooped(noisy(MADE[scene], seed), chosen)
        named += len(found.blunders)
        total += len(MADE[scene].block.photo_points.photo)
    # some 4000 photo points, of which one in a thousand fails by chance
    assert named <= 12
    assert named / total < 0.003


def test_error_free_data_have_none():
    assert snooped(MADE["aerial"].block).blunders == ()


def test_several_blunders_are_all_found_and_the_solution_is_that_without_them():
    made = MADE["around an object"]
    block = started_off(made, noisy(made, 20), 21, 0.002)
    wrong = {5: (0, 40.0), 77: (1, -25.0), 78: (0, 55.0), 160: (1, 18.0), 299: (0, -33.0)}
    spoilt = block
    for place, (component, size) in wrong.items():
        spoilt = with_error(spoilt, place, component, size)
    found = snooped(spoilt, STRICT)
    assert {(blunder.photo, blunder.point) for blunder in found.blunders} == {names_of(block, place) for place in wrong}
    assert sorted(blunder.order for blunder in found.blunders) == [1, 2, 3, 4, 5]
    used = block.photo_points.used.copy()
    used[list(wrong)] = False
    clean = solution(
        redefined(replace(block, photo_points=replace(block.photo_points, used=used)), start_down_weight=20)
    )
    assert np.allclose(found.solved.state.points, clean.points.values, atol=1e-6)
    assert found.solved.variance.sigma0 == pytest.approx(clean.sigma0, rel=1e-6)
    again = solution(redefined(without_blunders(spoilt, found.blunders), start_down_weight=20))
    assert np.allclose(again.points.values, clean.points.values, atol=1e-6)
    assert again.redundancy == clean.redundancy


def test_constant_control_cannot_be_named_but_shows_in_the_photos():
    made = MADE["aerial"]
    block = controlled(made, noisy(made, 3), made.block.point_names[::4])
    place = block.point_index()[made.block.point_names[8]]
    start = block.point_start.copy()
    start[place] += [0.0, 0.0, 3.0]
    found = snooped(replace(block, point_start=start))
    assert {blunder.kind for blunder in found.blunders} == {"photo"}
    assert found.blunders[0].point == block.point_names[place]


def test_snooping_does_not_reduce_weights_and_stops_when_asked():
    block = with_error(noisy(MADE["aerial"], 1), 30, 0, 50.0)
    found = snoop(block, APRIORI, lambda _: None, lambda: True)
    assert found.blunders == ()
    factors = found.solved.weight_factors
    assert set(factors[found.solved.equations.active].tolist()) == {1.0}


def test_rounding_in_data_without_errors_is_no_blunder() -> None:
    assert snooped(MADE["aerial"].block, POSTERIORI).blunders == ()


def test_many_blunders_need_few_adjustments() -> None:
    block, random = noisy(MADE["aerial"], 2), np.random.default_rng(8)
    wrong = random.choice(len(block.photo_points.point), 30, replace=False)
    for place in wrong:
        block = with_error(
            block, int(place), int(random.integers(2)), float(random.choice([-1, 1]) * random.uniform(10, 60))
        )
    adjustments = []
    found = snoop(
        block,
        STRICT,
        lambda record: adjustments.append(record.iteration) if record.iteration == 1 else None,
        lambda: False,
    )
    assert len({blunder.order for blunder in found.blunders}) >= 28
    # the first, one without the large blunders and one without the small ones; perhaps one with what is taken back
    assert len(adjustments) <= 5
