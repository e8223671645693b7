"""Parts of a block placed on the ground together, checked with vertical photos of flat ground; when a block fits."""

from __future__ import annotations

import numpy as np
import pytest
from monte_carlo.preliminary_records import gathered
from monte_carlo.weakly_joined_blocks import weakly_joined_records
from scipy import stats

from orip.geometry.rotation import rotation_about_axes
from orip.prelim import joint_placing as placing
from orip.prelim.found_values import fits_by_chance, is_strong, rays_that_count, redundancy, robust_square_sum
from orip.prelim.growing_block import residual_lengths
from orip.prelim.joint_placing import levelling, place_parts, tilts
from orip.prelim.joint_routes import best_models, by_level_photos
from orip.prelim.measured_block import measured_block
from orip.prelim.parts import LOOKING_DOWN, UPRIGHT, assembled_at, single_photo, supported_photos, ties_between
from orip.prelim.rays import ImageRays, image_rays
from orip.records.preliminary import PartialBlock
from orip.structs import replace

C = 0.15
AZIMUTHS = np.radians([3.0, 182.0, -5.0, 95.0])
HEIGHTS = np.array([900.0, 1000.0, 1100.0, 950.0])
CENTRES = np.column_stack([[0.0, 400.0, 800.0, 400.0], [0.0, 50.0, 0.0, 500.0], HEIGHTS])
GROUND = np.array([[x, y, 20.0] for x in range(-200, 1001, 200) for y in range(-200, 701, 150)], dtype=float)
CONTROL = (0, 6, 40)
LEVEL = np.stack([np.eye(3)] * 4)


def about_up(azimuth: float) -> np.ndarray:
    c, s = np.cos(azimuth), np.sin(azimuth)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def vertical_photos() -> list[PartialBlock]:
    """Return four vertical photos of flat ground as parts of their own, in the systems of their images."""
    parts = []
    for photo, (centre, azimuth) in enumerate(zip(CENTRES, AZIMUTHS, strict=True)):
        seen = (GROUND - centre) @ about_up(azimuth)
        image = seen * C / -seen[:, 2:]
        points = np.flatnonzero(np.abs(image[:, :2]).max(axis=1) < 0.1)
        parts.append(
            PartialBlock(
                f"P{photo}", np.array([photo]), np.eye(3)[None], np.zeros((1, 3)), points, image[points],
                np.full((len(points), 3), 0.01),
            )
        )  # fmt: skip
    return parts


def control() -> np.ndarray:
    known = np.full_like(GROUND, np.nan)
    known[list(CONTROL)] = GROUND[list(CONTROL)]
    return known


@pytest.mark.parametrize("rounds", [1, 3])
def test_vertical_photos_of_flat_ground_are_placed_where_they_were_taken(rounds: int) -> None:
    parts = vertical_photos()
    placed = place_parts(ties_between(parts, control()), LEVEL, rounds)
    assert placed is not None
    # linear equations, except for the 1e-10 that keep them regular: a millionth of the flying height
    assert placed.misfit < 1e-3
    block = assembled_at(parts, placed.movements)
    np.testing.assert_allclose(block.centres, CENTRES, atol=1e-3)
    np.testing.assert_allclose(block.rotations, [about_up(azimuth) for azimuth in AZIMUTHS], atol=1e-6)
    np.testing.assert_allclose(block.coordinates, GROUND[block.points], atol=1e-3)


def test_many_parts_are_placed_where_few_are(monkeypatch: pytest.MonkeyPatch) -> None:
    ties = ties_between(vertical_photos(), control())
    full = place_parts(ties, LEVEL, 2)
    monkeypatch.setattr(placing, "_DENSE", 0)
    sparse = place_parts(ties, LEVEL, 2)
    assert full is not None
    assert sparse is not None
    # the same equations, whose condition is some 1e6
    np.testing.assert_allclose(sparse.movements.shift, full.movements.shift, atol=1e-6)
    np.testing.assert_allclose(sparse.movements.scale, full.movements.scale, rtol=1e-9)


def test_a_photo_tied_by_one_point_gets_the_usual_scale() -> None:
    parts = vertical_photos()
    first = parts[0]
    shared = int(np.flatnonzero(np.isin(first.points, parts[1].points))[0])
    arrays = first.points, first.coordinates, first.deviations
    of_one_point = [np.repeat(array[[shared]], 2, axis=0) for array in arrays]
    parts.append(PartialBlock("P4", np.array([4]), np.eye(3)[None], np.zeros((1, 3)), *of_one_point))
    placed = place_parts(ties_between(parts, control()), np.stack([np.eye(3)] * 5), 3)
    assert placed is not None
    heights = placed.movements.shift[:, 2] - 20.0
    assert 0.5 * np.median(heights) < heights[4] < 2.0 * np.median(heights)


def test_models_with_a_common_photo_get_its_azimuth() -> None:
    """Two models of two photos each, turned against each other by half a circle, with nothing else to tell it."""
    parts = vertical_photos()
    models = [joined(parts[:2], CENTRES[:2], AZIMUTHS[:2], 0.0), joined(parts[1:3], CENTRES[1:3], AZIMUTHS[1:3], 3.0)]
    placed = place_parts(ties_between(models, control()), np.stack([np.eye(3)] * 2), 1)
    assert placed is not None
    block = assembled_at(models, placed.movements)
    np.testing.assert_allclose(block.centres, CENTRES[:3], atol=1e-3)
    np.testing.assert_allclose(block.coordinates, GROUND[block.points], atol=1e-3)


def joined(parts: list[PartialBlock], centres: np.ndarray, azimuths: np.ndarray, turn: float) -> PartialBlock:
    """Return vertical photos as one part, in a system of its own that is turned about the vertical."""
    system = about_up(turn)
    points = np.unique(np.concatenate([part.points for part in parts]))
    rotations = np.stack([system.T @ about_up(azimuth) for azimuth in azimuths])
    return PartialBlock(
        parts[0].name, np.concatenate([part.photos for part in parts]), rotations, 1e-3 * centres @ system, points,
        1e-3 * GROUND[points] @ system, np.full((len(points), 3), 0.01),
    )  # fmt: skip


@pytest.mark.parametrize("axis", [LOOKING_DOWN, UPRIGHT])
def test_a_levelled_photo_has_its_axis_upwards(axis: int) -> None:
    photo = vertical_photos()[0]
    turned = replace(photo, rotations=tilts(np.array([[0.3, -0.2]])))
    level = levelling(turned, axis)
    assert level is not None
    np.testing.assert_allclose((level @ turned.rotations[0])[:, axis], [0.0, 0.0, 1.0], atol=1e-15)


def test_tilts_give_the_horizontal_plane_its_slopes_and_are_the_smallest_that_do() -> None:
    slopes = np.array([[0.0, 0.0], [0.3, -0.2], [-2.0, 1.0]])
    for rotation, (x, y) in zip(tilts(slopes), slopes, strict=True):
        normal = rotation @ [0.0, 0.0, 1.0]
        np.testing.assert_allclose(-normal[:2] / normal[2], [x, y], atol=1e-14)
        # the smallest rotation turns about a horizontal axis, by the angle of the slope
        angle = np.arctan(np.hypot(x, y))
        axis = np.array([y, -x, 0.0]) / (np.hypot(x, y) or 1.0)
        np.testing.assert_allclose(rotation, rotation_about_axes(angle * axis), atol=1e-14)


def test_photos_that_look_in_opposite_directions_have_no_level() -> None:
    part = vertical_photos()[0]
    both = PartialBlock(
        "P0", np.array([0, 1]), np.array([np.eye(3), np.diag([1.0, -1.0, -1.0])]), np.zeros((2, 3)), part.points,
        part.coordinates, part.deviations,
    )  # fmt: skip
    assert levelling(both, LOOKING_DOWN) is None


def weak_rays() -> tuple[ImageRays, np.ndarray]:
    block = gathered(weakly_joined_records(101))
    rays = image_rays(block)
    known = np.full((len(rays.points), 3), np.nan)
    known[[rays.points.index(point.name) for point in block.control_points]] = 0.0
    return rays, known


def test_a_photo_with_too_few_equations_is_not_supported() -> None:
    rays, known = weak_rays()
    assert supported_photos(rays, known).all()
    of_first = np.flatnonzero(rays.photo == 0)
    # two points give at most four equations for six unknowns
    fewer = rays.of(np.delete(np.arange(len(rays.photo)), of_first[2:]))
    assert not supported_photos(fewer, known)[0]


def test_a_single_photo_shows_its_points_in_one_plane() -> None:
    rays, _ = weak_rays()
    part = single_photo(rays, 1, np.flatnonzero(rays.photo == 1))
    assert np.ptp(part.coordinates[:, 2]) == 0.0
    image = part.coordinates[:, :2] / -part.coordinates[:, 2:]
    rows = np.flatnonzero(rays.photo == 1)
    np.testing.assert_allclose(image, rays.vectors[rows, :2] / -rays.vectors[rows, 2:], rtol=1e-12)


@pytest.mark.parametrize("degrees", [1, 3, 9, 40, 300])
def test_what_measuring_errors_explain_is_exceeded_once_in_a_thousand_blocks(degrees: int) -> None:
    sums = np.linspace(0.0, 6.0 * degrees + 20.0, 20001)
    limit = sums[[fits_by_chance(square_sum, degrees) for square_sum in sums]].max()
    # Wilson and Hilferty's quantile is good to some tenths of its probability
    assert 5e-4 < stats.chi2.sf(limit, degrees) < 2e-3


def test_large_residuals_count_as_the_limit_and_missing_ones_do_not() -> None:
    assert robust_square_sum(np.array([1.0, np.nan, np.inf])) == pytest.approx(1.0 + robust_square_sum(np.array([1e6])))


def test_redundancy_counts_what_takes_part() -> None:
    rays, known = weak_rays()
    held = np.isfinite(known).all(axis=1)
    found = redundancy(rays, held, rays_that_count(rays, np.ones(len(rays.photos), dtype=bool), held))
    # every point is seen twice, or is control
    assert found == 2 * len(rays.photo) - 6 * 4 - 3 * np.count_nonzero(~held)
    assert not is_strong(found, 4)
    assert is_strong(40, 4)
    alone = rays_that_count(rays, np.arange(4) == 0, held)
    assert alone.any()
    assert held[rays.point[alone]].all()


def test_no_parts_are_no_block() -> None:
    assert place_parts(ties_between([], np.zeros((3, 3))), np.zeros((0, 3, 3)), 1) is None


def test_level_photos_lead_to_a_block_only_where_they_fit() -> None:
    measured = measured_block(gathered(weakly_joined_records(4)))
    held, known = measured.grower(measured.full_control()), measured.known_control()
    (system,) = by_level_photos(held, known).systems
    assert system.oriented.all()
    assert np.median(residual_lengths(held.seen(system), system)) < 1.0
    # control that is the mirror image of the ground: no place of the photos fits
    mirrored = known[:, [1, 0, 2]]
    held = measured.grower(measured.full_control()[:, [1, 0, 2]])
    assert not by_level_photos(held, mirrored).systems


def test_of_many_models_the_best_of_each_photo_are_placed_and_those_that_join_the_others() -> None:
    random = np.random.default_rng(7)
    # two lots of photos, all pairs in each, and one poor model between them
    of_lot = np.stack(np.triu_indices(15, 1), axis=1)
    photos = np.vstack([of_lot, of_lot + 15, [[3, 20]]])
    worths = np.concatenate([random.uniform(1.0, 2.0, 2 * len(of_lot)), [0.1]])
    kept = best_models(photos, worths, np.arange(30))
    assert kept[-1]
    assert np.count_nonzero(kept) < 5 * 30 < len(kept)
    for photo in range(30):
        own = np.flatnonzero((photos == photo).any(axis=1))
        assert kept[own[np.argsort(-worths[own])][:4]].all()
    # photos that are joined already need no poor model
    assert not best_models(photos, worths, np.zeros(30, dtype=np.int64))[-1]
