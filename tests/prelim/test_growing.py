"""Growing on scenes whose truth is known: from two photos that are grown to all that can be added."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.synthetic_block import SyntheticBlock, synthetic_block

from orip.prelim.block_grower import BlockGrower
from orip.prelim.growing_block import FromModels, GrowingBlock, empty_growing_block, residual_lengths
from orip.prelim.rays import ImageRays, image_rays, photo_index
from orip.prelim.relative.orientation import OrientedPair, common_point_counts
from orip.prelim.resection.resection import Resected
from orip.structs import replace


def grower_of(rays: ImageRays, held: np.ndarray | None = None) -> BlockGrower:
    """Return what grows with nothing held, or some points."""
    nothing = np.full((len(rays.points), 3), np.nan)
    everyone = np.ones(len(rays.photos), dtype=bool)
    return BlockGrower(rays, photo_index(rays), common_point_counts(rays), nothing if held is None else held, everyone)


def first_two(made: SyntheticBlock, rays: ImageRays) -> GrowingBlock:
    """Return the system with the true orientation of the first two photos, and nothing else."""
    start = empty_growing_block(rays)
    for photo in (0, 1):
        rotation = Rotation.from_euler("XYZ", made.orientations[photo, 3:]).as_matrix()
        start = start.with_photo(photo, rotation, made.orientations[photo, :3], "true")
    return start


@pytest.fixture(scope="module")
def convergent() -> SyntheticBlock:
    return synthetic_block("convergent", "growing")


def errors(grown: GrowingBlock, made: SyntheticBlock) -> np.ndarray:
    """Return the distances of the centres from the truth, in distances from the object."""
    distance = np.median(np.linalg.norm(made.points.mean(axis=0) - made.orientations[:, :3], axis=1))
    return np.linalg.norm(grown.centres - made.orientations[:, :3], axis=1) / distance


def test_all_photos_are_added_at_their_true_places(convergent: SyntheticBlock) -> None:
    rays = image_rays(convergent.block)
    grower = grower_of(rays)
    grown = grower.grow(grower.intersected(first_two(convergent, rays)))
    assert grown.oriented.all()
    # the common points of the first two fix the datum in the adjustments to a millionth
    assert errors(grown, convergent).max() < 1e-5
    assert grown.known.all()
    assert grown.how[0] == grown.how[1] == "true"
    assert all(how for how in grown.how)


def test_a_photo_that_sees_no_known_point_is_not_added(convergent: SyntheticBlock) -> None:
    rays = image_rays(convergent.block)
    kept = rays.photo != 5
    lonely = replace(
        rays, photo=rays.photo[kept], point=rays.point[kept], xy=rays.xy[kept], vectors=rays.vectors[kept],
        error=rays.error[kept],
    )  # fmt: skip
    grower = grower_of(lonely)
    grown = grower.grow(grower.intersected(first_two(convergent, lonely)))
    assert np.flatnonzero(~grown.oriented).tolist() == [5]
    assert grown.how[5] == ""


def test_a_photo_whose_points_have_the_numbers_of_others_stays_out_of_the_way(convergent: SyntheticBlock) -> None:
    rays = image_rays(convergent.block)
    point = rays.point.copy()
    mine = np.flatnonzero(rays.photo == 4)
    point[mine] = np.roll(point[mine], 7)
    confused = replace(rays, point=point)
    grower = grower_of(confused)
    grown = grower.grow(grower.intersected(first_two(convergent, confused)))
    others = np.arange(len(rays.photos)) != 4
    assert grown.oriented[others].all()
    assert errors(grown, convergent)[others].max() < 1e-4
    assert not grown.oriented[4]


def test_held_points_do_not_move(convergent: SyntheticBlock) -> None:
    rays = image_rays(convergent.block)
    held = np.full((len(rays.points), 3), np.nan)
    held[::4] = convergent.points[::4] + 0.001
    start = replace(
        empty_growing_block(rays), coordinates=held.copy(), deviations=np.where(np.isnan(held), np.nan, 0.0)
    )
    grown = grower_of(rays, held).grow(start)
    assert grown.oriented.all()
    np.testing.assert_array_equal(grown.coordinates[::4], held[::4])
    assert (grown.deviations[::4] == 0.0).all()


def test_a_resection_needs_known_points_that_agree(convergent: SyntheticBlock) -> None:
    rays = image_rays(convergent.block)
    grower = grower_of(rays)
    grown = grower.intersected(first_two(convergent, rays))
    found = grower.resection(grown, rays, 2, grown.known)
    assert isinstance(found, Resected)
    np.testing.assert_allclose(found.centre, convergent.orientations[2, :3], atol=1e-6)
    mixed = replace(grown, coordinates=np.roll(grown.coordinates, 3, axis=0))
    assert grower.resection(mixed, rays, 2, mixed.known) is None
    few = grown.coordinates.copy()
    few[3:] = np.nan
    assert grower.resection(grown, rays, 2, np.isfinite(few).all(axis=1)) is None


def test_a_photo_whose_known_points_are_close_together_tells_so(convergent: SyntheticBlock) -> None:
    rays = image_rays(convergent.block)
    mine = np.flatnonzero(rays.photo == 2)
    near = mine[np.argsort(np.linalg.norm(rays.xy[mine] - rays.xy[mine[0]], axis=1))[:6]]
    held = np.full((len(rays.points), 3), np.nan)
    held[rays.point[near]] = convergent.points[rays.point[near]]
    known = np.isfinite(held).all(axis=1)
    start = empty_growing_block(rays)
    start = replace(start, coordinates=held, deviations=np.where(np.isnan(held), np.nan, 0.0))
    found = grower_of(rays, held).resection(start, rays, 2, known)
    assert found is not None
    assert found.how.startswith("space resection from 6 points; the known points span ")
    assert "5% are wanted: measure more known points, farther apart" in found.how


def test_three_known_points_and_the_rays_of_the_others_orient_a_photo(convergent: SyntheticBlock) -> None:
    rays = image_rays(convergent.block)
    mine = np.flatnonzero(rays.photo == 2)
    # the first photo shows the others, too: their rays tell which of the positions is the true one
    others = np.isin(rays.point, rays.point[mine])
    kept = (rays.photo == 2) | ((rays.photo == 0) & others)
    alone = replace(
        rays, photo=rays.photo[kept], point=rays.point[kept], xy=rays.xy[kept], vectors=rays.vectors[kept],
        error=rays.error[kept],
    )  # fmt: skip
    corners = mine[[rays.xy[mine, 0].argmin(), rays.xy[mine, 0].argmax(), rays.xy[mine, 1].argmax()]]
    held = np.full((len(rays.points), 3), np.nan)
    held[rays.point[corners]] = convergent.points[rays.point[corners]]
    rotation = Rotation.from_euler("XYZ", convergent.orientations[0, 3:]).as_matrix()
    start = empty_growing_block(alone).with_photo(0, rotation, convergent.orientations[0, :3], "true")
    start = replace(start, coordinates=held, deviations=np.where(np.isnan(held), np.nan, 0.0))
    found = grower_of(alone, held)._by_three_points(start)
    assert found is not None
    assert found.how[2].startswith("space resection from 3 points, without a check")
    assert errors(found, convergent)[2] < 1e-6


def test_errors_of_held_points_count_as_errors_of_their_photo_points(convergent: SyntheticBlock) -> None:
    rays = image_rays(convergent.block)
    held = convergent.points.copy()
    held[::2] = np.nan
    exact = grower_of(rays, held)
    weighted = replace(exact, held_errors=np.full(len(held), 0.02))
    grown = exact.intersected(first_two(convergent, rays))
    assert exact.seen(grown) is rays
    seen = weighted.seen(grown)
    counted = (rays.photo < 2) & (rays.point % 2 == 1)
    assert counted.sum() > 10
    assert (seen.error[~counted] == rays.error[~counted]).all()
    distance = np.linalg.norm(convergent.points[rays.point] - convergent.orientations[rays.photo, :3], axis=1)
    in_photo = convergent.block.cameras[0].parameters[0] * 0.02 / distance
    assert seen.error[counted] ** 2 == pytest.approx((rays.error**2 + in_photo**2)[counted])
    assert (weighted.intersected(grown).deviations[1::2] == 0.02).all()
    assert (grown.deviations[1::2] == 0.0).all()


def test_control_with_errors_puts_no_photo_in_the_wrong_place(convergent: SyntheticBlock) -> None:
    rays = image_rays(convergent.block)
    distance = np.median(np.linalg.norm(convergent.points.mean(axis=0) - convergent.orientations[:, :3], axis=1))
    error = 20.0 * float(rays.error[0]) * distance / convergent.block.cameras[0].parameters[0]
    noise = np.random.default_rng(7).normal(size=convergent.points.shape)
    held = convergent.points + error * noise
    exact = grower_of(rays, held)
    weighted = replace(exact, held_errors=np.full(len(held), error))
    for grower, fits in ((exact, False), (weighted, True)):
        grown = grower.grow(grower.intersected(first_two(convergent, rays)))
        lengths = residual_lengths(grower.seen(grown), grown)
        assert (np.median(lengths) < 2.0) == fits


def test_a_pair_that_has_kept_its_points_is_not_oriented_again(convergent: SyntheticBlock) -> None:
    rays = image_rays(convergent.block)
    before = grower_of(rays)
    first = before.model(0, 1)
    assert isinstance(first, OrientedPair)
    # other rays of the block: without those of another photo, and without a point of the pair
    without_third, without_point = rays.of(rays.photo != 2), rays.of(rays.point != rays.point[first.rows[0][0]])
    kept, changed = (
        replace(grower_of(some), from_models=before.from_models.of_other_rays()).model(0, 1)
        for some in (without_third, without_point)
    )
    alone = replace(grower_of(without_point), from_models=FromModels()).model(0, 1)
    assert isinstance(kept, OrientedPair)
    assert isinstance(changed, OrientedPair)
    assert isinstance(alone, OrientedPair)
    assert kept.solution is first.solution
    # rows of rays are those of the rays that are left
    assert (without_third.photo[kept.rows[0]] == 0).all()
    assert (without_third.point[kept.rows[1]] == rays.point[first.rows[1]]).all()
    assert changed.solution is not first.solution
    assert (changed.solution.parallax == alone.solution.parallax).all()


@pytest.mark.parametrize(("turned", "fits"), [(0.0, True), (2.0, False)])
def test_a_point_of_parallel_rays_does_not_tell_that_a_photo_is_in_the_wrong_place(turned: float, fits: bool) -> None:
    # the base is a three-hundredth of the distance; if the second photo is turned, the rays no longer agree
    vectors = np.array([[3.0, -2.0, -50.0], [3.0 - 50.0 / 300.0, -2.0, -50.0]])
    at = np.arange(2)
    rays = ImageRays(("A", "B"), ("1",), at, np.zeros(2, dtype=np.int64), vectors[:, :2], vectors, np.full(2, 0.005))
    grown = empty_growing_block(rays)
    for photo in (0, 1):
        rotation = Rotation.from_euler("x", photo * turned, degrees=True).as_matrix()
        grown = grown.with_photo(photo, rotation, np.array([photo / 300.0, 0.0, 0.0]), "")
    lengths = residual_lengths(rays, grown)
    assert (np.isnan(lengths) if fits else np.isinf(lengths)).all()
