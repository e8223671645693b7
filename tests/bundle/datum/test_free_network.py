"""Free networks: inner constraints, cofactors and redundancy numbers against dense matrices, what fixes scale."""

from __future__ import annotations

import numpy as np
import pytest
from bundle.free_networks import MADE, SUBSET, datum_points, dense_free_cofactors, free
from bundle.solving import noisy, redefined, rows, solution, solved, started_off

from orip.errors import InputError
from orip.records.control import ControlDistance
from orip.records.photo import PHOTO_PARAMETERS
from orip.structs import replace


def inner_conditions(block, found):
    """Return the sums that are zero over the datum points, in units of what they could be: shifts, rotations, scale."""
    chosen = datum_points(block)
    start, correction = block.point_start[chosen], found.points.values[chosen] - block.point_start[chosen]
    offset = start - start.mean(axis=0)
    size = np.linalg.norm(correction) * np.linalg.norm(offset)
    return np.r_[
        correction.sum(axis=0) / np.linalg.norm(correction),
        np.cross(offset, correction).sum(axis=0) / size,
        np.sum(offset * correction) / size,
    ]


@pytest.mark.parametrize("names", [(), SUBSET])
@pytest.mark.parametrize("scene", MADE)
def test_corrections_of_datum_points_hold_the_inner_constraints(scene, names):
    block = free(scene, names)
    found = solution(block)
    assert found.status == "converged"
    assert found.singular == ()
    # corrections are some 1e-5 of the block's size: what is not linear in them is smaller still
    assert np.abs(inner_conditions(block, found)).max() < 1e-3


def assert_cofactors(found, dense):
    m = found.problem.layout.reduced
    root = np.sqrt(np.diag(dense))
    assert np.allclose(
        found.cofactors.reduced / np.outer(root[:m], root[:m]), dense[:m, :m] / np.outer(root[:m], root[:m]), atol=1e-5
    )
    for block in range(found.problem.layout.blocks):
        place = slice(m + 3 * block, m + 3 * block + 3)
        both = np.outer(root[place], root[place])
        assert np.allclose(found.cofactors.blocks[block] / both, dense[place, place] / both, atol=1e-5)


@pytest.mark.parametrize("names", [(), SUBSET])
@pytest.mark.parametrize("scene", MADE)
def test_cofactors_are_those_of_the_normal_matrix_with_inner_constraints(scene, names):
    block = free(scene, names)
    found = solved(block)
    assert_cofactors(found, dense_free_cofactors(block, found))


def test_cofactors_over_all_points_have_the_least_trace():
    block = free("aerial")
    least = sum(np.einsum("bii->", solved(block).cofactors.blocks[None, k]) for k in range(len(block.point_names)))
    for names in (SUBSET, ("101", "104", "120", "123")):
        other = solved(free("aerial", names))
        assert np.einsum("bii->", other.cofactors.blocks) > least


def least_constrained(block, state):
    """Return the block held by six elements of its first photo and one of its last, at a solution's values."""
    first, last = block.photos[0], block.photos[-1]
    return replace(
        redefined(block, datum="control", datum_points=()),
        control_points=(),
        photos=(
            replace(first, constant=PHOTO_PARAMETERS),
            *block.photos[1:-1],
            replace(last, constant=("X0",)),
        ),
        photo_orientation=np.hstack([state.centres, state.angles()]),
        point_start=state.points,
    )


@pytest.mark.parametrize("names", [(), SUBSET])
@pytest.mark.parametrize("scene", MADE)
def test_residuals_and_redundancy_numbers_do_not_depend_on_the_datum(scene, names):
    block = free(scene, names)
    network = solved(block)
    other = solution(least_constrained(block, network.state))
    found = solution(block)
    photo = rows(found, "photo")
    assert np.allclose(found.residuals.redundancy_number[photo], other.residuals.redundancy_number[photo], atol=1e-6)
    assert np.allclose(found.residuals.residual[photo], other.residuals.residual[photo], atol=1e-7)
    assert found.sigma0 == pytest.approx(other.sigma0, rel=1e-6)
    assert (found.redundancy, found.unknowns) == (other.redundancy, other.unknowns + 7)


def test_control_is_listed_without_influence():
    block = free("aerial")
    spoilt = replace(
        block,
        control_points=tuple(
            replace(point, coordinates=tuple(value + 100.0 for value in point.coordinates))
            for point in block.control_points
        ),
    )
    found, other = solution(block), solution(spoilt)
    control = rows(found, "control")
    assert len(control) == 3 * len(block.control_points)
    assert np.array_equal(found.points.values, other.points.values)
    assert np.allclose(other.residuals.residual[control], found.residuals.residual[control] - 100.0, atol=1e-9)
    assert np.isnan(found.residuals.weight_factor[control]).all()


def scale_bar(made, start, end, error, factor=1.0):
    place = made.block.point_index()
    length = float(np.linalg.norm(made.points[place[end]] - made.points[place[start]]))
    return ControlDistance(f"{start}-{end}", start, end, "XYZ", factor * length, error)


@pytest.mark.parametrize("error", [0.001, 0.0])
def test_a_distance_gives_scale_and_leaves_six_movements(error):
    made = MADE["around an object"]
    bar = scale_bar(made, "101", "120", error, 1.02)
    block = free("around an object", distances=(bar,))
    found = solved(block)
    assert found.problem.defect == 6
    result = solution(block)
    assert result.status == "converged"
    assert result.unknowns == solution(free("around an object")).unknowns
    place = block.point_index()
    length = np.linalg.norm(result.points.values[place["101"]] - result.points.values[place["120"]])
    assert length == pytest.approx(bar.distance, rel=1e-4 if error else 1e-10)
    # without the scale the constraints of shifts and rotations still hold
    assert np.abs(inner_conditions(block, result)[:6]).max() < 1e-2


def test_cofactors_with_a_distance_are_those_of_six_inner_constraints():
    bar = scale_bar(MADE["around an object"], "101", "120", 0.001)
    block = free("around an object", distances=(bar,))
    found = solved(block)
    dense = dense_free_cofactors(block, found, slice(0, 6))
    assert_cofactors(found, dense)


def test_two_distances_check_each_other():
    made = MADE["around an object"]
    bars = (scale_bar(made, "101", "120", 0.001), scale_bar(made, "105", "130", 0.001))
    one, two = (
        solution(free("around an object", distances=bars[:1])),
        solution(free("around an object", distances=bars)),
    )
    assert two.redundancy == one.redundancy + 1
    assert one.residuals.redundancy_number[rows(one, "distance")] == pytest.approx([0.0], abs=1e-8)
    # the rest of the new redundancy is in the photo points, which the two scales check
    assert 0.5 < two.residuals.redundancy_number[rows(two, "distance")].sum() <= 1.0 + 1e-9


def test_the_datum_does_not_depend_on_how_far_off_the_start_is():
    # started elsewhere the network lies elsewhere, but has the same shape
    made = MADE["aerial"]
    block = redefined(started_off(made, noisy(made, 3), 5, 0.002), datum="free")
    near, far = solution(free("aerial")), solution(block)
    assert far.status == "converged"
    assert far.sigma0 == pytest.approx(near.sigma0, rel=1e-5)

    def shape(found):
        offset = found.points.values - found.points.values.mean(axis=0)
        return np.linalg.norm(offset, axis=1) / np.linalg.norm(offset)

    assert np.allclose(shape(far), shape(near), rtol=1e-6)


def test_datum_points_that_are_not_there_or_do_not_suffice_are_refused():
    with pytest.raises(InputError, match="999"):
        solution(free("aerial", ("101", "999", "105")))
    with pytest.raises(InputError, match="do not determine"):
        solution(free("aerial", ("101", "102")))
